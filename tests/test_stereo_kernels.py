"""The compiled kernels of matching, each against a truth that can be written down."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.points import Reason
from models.stereo.absolute import match_columns
from models.stereo.aggregate import aggregate, cheapest
from models.stereo.candidates import Candidates, find_candidates, wrap, wrap_any
from models.stereo.resample import resample
from models.stereo.sensor_grid import refine_on_sensor
from models.stereo.surfaces import claimed_twice, label_surfaces

HEIGHT, WIDTH = 24, 120
FRAME = np.array([1000.0, 120.0, 60.0, 400.0, 12.0, 1.0])
"""focal, baseline, cx_left, cx_right, cy, row step: disparity is 1000 * 120 / z, columns differ by 340 px more."""
UPRIGHT = np.eye(3)
SCALES = (0.9, 0.9, 0.7, 1.0, 0.5)
KEEP_ALL = 1e3
NO_PROJECTOR = np.zeros(0)


class Plane:
    """Both canvases of a slanted plane under fringes whose column grows by ``rate`` per left pixel.

    Right column x_r of left pixel x: offset + stretch * x, the same on all rows.
    """

    def __init__(self, depth: float = 500.0, stretch: float = 0.98, rate: float = 1.1, right_width: int = 420) -> None:
        x = np.arange(WIDTH, dtype=np.float64)
        middle = FRAME[2]
        offset = FRAME[3] - FRAME[0] * FRAME[1] / depth - stretch * middle
        self.x_right = np.broadcast_to(offset + stretch * x, (HEIGHT, WIDTH))
        self.column_l = np.broadcast_to(100 + rate * x, (HEIGHT, WIDTH)).astype(np.float32)
        right = np.arange(right_width, dtype=np.float64)
        self.column_r = np.broadcast_to(100 + rate * (right - offset) / stretch, (HEIGHT, right_width)).astype(
            np.float32
        )

    def phases(self, columns: np.ndarray, periods: tuple[float, ...] = (9.0, 14.0)) -> np.ndarray:
        return np.stack([wrapped(2 * np.pi / p * columns.astype(np.float64)) for p in periods]).astype(np.float32)

    def candidates(
        self,
        periods: tuple[float, ...] = (9.0, 14.0),
        limit: int = 16,
        surplus: float = KEEP_ALL,
        direction: float = 1.0,
    ) -> Candidates:
        left, right = self.phases(self.column_l, periods), self.phases(self.column_r, periods)
        flat_l, flat_r = np.full(left.shape[1:], 0.5, np.float32), np.full(right.shape[1:], 0.5, np.float32)
        found = find_candidates(
            left, right, flat_l > 0, flat_r > 0, flat_l, flat_r, 0 * flat_l, 0 * flat_r,
            FRAME, UPRIGHT, np.array([400.0, 670.0]), NO_PROJECTOR, np.array(periods),
            np.array([*SCALES, surplus]), limit, direction,
        )  # fmt: skip
        return Candidates(*found)


def wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


@given(st.floats(-1e4, 1e4), st.floats(-3 * math.pi, 3 * math.pi - 1e-9))
def test_wrap(far: float, near: float) -> None:
    for angle, result in ((far, wrap_any(far)), (near, wrap_any(near)), (near, wrap(near))):
        assert -math.pi - 1e-9 <= result <= math.pi + 1e-9
        assert math.cos(result - angle) == pytest.approx(1, abs=1e-9)


class TestCandidates:
    @pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
    def test_the_match_is_among_them_to_a_hundredth_of_a_pixel(self, stretch: float) -> None:
        plane = Plane(stretch=stretch)
        found = plane.candidates()
        away = np.nanmin(np.abs(found.x_right - plane.x_right[..., None]), axis=2)
        assert away.max() < 0.01

    def test_it_is_found_where_columns_fall_along_the_rows(self) -> None:
        plane = Plane(rate=-1.1)
        found = plane.candidates(direction=-1.0)
        best = np.take_along_axis(found.x_right, found.cost.argmin(axis=2)[..., None], axis=2)[..., 0]
        assert np.abs(best - plane.x_right).max() < 0.01
        assert plane.candidates().count.max() == 0

    def test_they_are_one_fringe_apart_and_in_order(self) -> None:
        found = Plane(stretch=1.0, rate=1.1).candidates()
        assert found.count.min() >= 5
        steps = np.diff(found.x_right, axis=2)
        inner = np.isfinite(steps)
        assert np.abs(steps[inner] - 9 / 1.1).max() < 0.01

    def test_the_match_is_cheapest(self) -> None:
        plane = Plane()
        found = plane.candidates()
        best = np.take_along_axis(found.x_right, found.cost.argmin(axis=2)[..., None], axis=2)[..., 0]
        assert np.abs(best - plane.x_right).max() < 0.01

    def test_much_dearer_ones_are_dropped_and_the_order_kept(self) -> None:
        whole, few = Plane().candidates(), Plane().candidates(surplus=0.8)
        assert np.array_equal(few.count, (whole.cost <= whole.cost.min(axis=2, keepdims=True) + 0.8).sum(axis=2))
        assert few.count.max() < whole.count.max()
        slots = np.arange(few.x_right.shape[2]) < few.count[..., None]
        assert np.array_equal(np.isfinite(few.x_right), slots)
        assert np.array_equal(np.isfinite(few.cost), slots)
        steps = np.diff(few.x_right, axis=2)
        assert (steps[np.isfinite(steps)] > 0).all()

    def test_without_a_second_carrier_all_cost_the_same(self) -> None:
        found = Plane().candidates(periods=(9.0,))
        assert found.cost[np.isfinite(found.x_right)].max() < 1e-3

    def test_they_lie_within_the_depth_range_and_the_limit(self) -> None:
        found = Plane().candidates()
        x = np.arange(WIDTH)[:, None]
        with np.errstate(invalid="ignore"):
            disparity = (x - FRAME[2]) - (found.x_right - FRAME[3])
        seen = disparity[np.isfinite(disparity)]
        assert seen.min() >= 120_000 / 670 - 1e-2
        assert seen.max() <= 120_000 / 400 + 1e-2
        assert Plane().candidates(limit=3).count.max() == 3


class TestAggregate:
    def test_a_slanted_plane_wins_over_its_aliases(self) -> None:
        """Noise makes many an alias cheaper at its own pixel; together the pixels tell."""
        plane = Plane(stretch=0.9)
        found = plane.candidates()
        rng = np.random.default_rng(0)
        there = np.isfinite(found.x_right)
        cost = np.where(there, rng.uniform(0, 1, found.cost.shape) * 1.0, np.inf).astype(np.float32)
        true = np.abs(found.x_right - plane.x_right[..., None]) < 0.5
        cost[true] *= 0.7
        alone = np.take_along_axis(true, cost.argmin(axis=2)[..., None], axis=2).mean()
        index, margin = cheapest(aggregate(Candidates(found.x_right, cost, found.count), 6.0), found.count)
        together = np.take_along_axis(true, index[..., None].astype(int), axis=2).mean()
        assert alone < 0.5
        assert together > 0.99
        assert margin.min() >= 0

    def test_a_step_between_two_depths_is_kept(self) -> None:
        near, far = Plane(depth=450.0), Plane(depth=600.0)
        a, b = near.candidates(), far.candidates()
        right_half = np.arange(WIDTH) >= 60
        x = np.where(right_half[:, None], b.x_right, a.x_right)
        cost = np.where(right_half[:, None], b.cost, a.cost)
        count = np.where(right_half, b.count, a.count).astype(np.uint8)
        index, _ = cheapest(aggregate(Candidates(x, cost, count), 1.0), count)
        best = np.take_along_axis(x, index[..., None].astype(int), axis=2)[..., 0]
        truth = np.where(right_half, far.x_right, near.x_right)
        assert (np.abs(best - truth) < 0.05).mean() > 0.98

    def test_pixels_without_candidates_break_no_path(self) -> None:
        found = Plane().candidates()
        count = found.count.copy()
        count[:, 40:50] = 0
        total = aggregate(Candidates(found.x_right, found.cost, count), 6.0)
        slots = np.arange(total.shape[2]) < count[..., None]
        assert np.isfinite(total[slots]).all()
        assert (total[~slots] == 0).all()


def test_cheapest_and_its_margin_against_a_sort() -> None:
    rng = np.random.default_rng(3)
    total = rng.uniform(0, 9, (20, 30, 7)).astype(np.float32)
    count = rng.integers(0, 8, (20, 30)).astype(np.uint8)
    index, margin = cheapest(total, count)
    for y, x in np.ndindex(20, 30):
        known = np.sort(total[y, x, : count[y, x]])
        if count[y, x]:
            assert total[y, x, index[y, x]] == known[0]
        assert margin[y, x] == (np.float32(known[1] - known[0]) if count[y, x] > 1 else np.inf)


class TestAbsolute:
    def match(self, plane: Plane, column_r: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        column_r = plane.column_r if column_r is None else column_r
        lit_l, lit_r = np.isfinite(plane.column_l), np.isfinite(column_r)
        return match_columns(
            plane.column_l,
            np.nan_to_num(column_r),
            lit_l,
            lit_r,
            FRAME,
            UPRIGHT,
            np.array([400.0, 670.0]),
            NO_PROJECTOR,
        )  # type: ignore[no-any-return]

    @pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
    def test_equal_columns_are_found(self, stretch: float) -> None:
        plane = Plane(stretch=stretch)
        x_right, reason = self.match(plane)
        assert (reason == Reason.VALID).all()
        assert np.abs(x_right - plane.x_right).max() < 1e-3

    def test_a_column_that_stands_nowhere_matches_nothing(self) -> None:
        plane = Plane()
        x_right, reason = self.match(plane, plane.column_r + 500)
        assert np.isnan(x_right).all()
        assert (reason == Reason.NO_MATCH).all()

    def test_gaps_are_not_bridged(self) -> None:
        plane = Plane()
        gap = plane.column_r.copy()
        gap[:, 150:160] = np.nan
        x_right, _ = self.match(plane, gap)
        assert not ((x_right > 149) & (x_right < 160)).any()

    def test_a_column_that_stands_twice_is_ambiguous_without_a_projector(self) -> None:
        plane = Plane(stretch=1.0)
        twice = plane.column_r.copy()
        twice[:, 165:190] = twice[:, 140:165]  # the same columns once more, 25 px to the right
        x_right, reason = self.match(plane, twice)
        clash = reason == Reason.AMBIGUOUS
        assert clash.any()
        assert np.isnan(x_right[clash]).all()
        sure = reason == Reason.VALID
        assert sure.any()
        exact = np.abs(x_right - plane.x_right) < 1e-3
        moved = np.abs(x_right - plane.x_right - 25) < 1e-3
        assert (exact | moved)[sure].all()


def joined(value: np.ndarray, tolerance: float) -> np.ndarray:
    """Labels by plain flood filling."""
    labels = np.full(value.shape, -1)
    for start in zip(*np.nonzero(np.isfinite(value)), strict=True):
        if labels[start] >= 0:
            continue
        number, todo = labels.max() + 1, [start]
        labels[start] = number
        while todo:
            y, x = todo.pop()
            for j, i in ((y, x + 1), (y, x - 1), (y + 1, x), (y - 1, x)):
                inside = 0 <= j < value.shape[0] and 0 <= i < value.shape[1]
                if inside and labels[j, i] < 0 and abs(value[j, i] - value[y, x]) < tolerance:
                    labels[j, i] = number
                    todo.append((j, i))
    return labels


class TestSurfaces:
    @settings(max_examples=30)
    @given(seed=st.integers(0, 10_000), holes=st.floats(0.0, 0.6), levels=st.integers(1, 4))
    def test_labels_are_those_of_flood_filling(self, seed: int, holes: float, levels: int) -> None:
        rng = np.random.default_rng(seed)
        value = 3.0 * rng.integers(0, levels, (14, 17)) + rng.uniform(0, 0.5, (14, 17))
        value[rng.random(value.shape) < holes] = np.nan
        labels, sizes = label_surfaces(value, 1.0)
        expected = joined(value, 1.0)
        assert np.array_equal(labels < 0, expected < 0)
        pairs = set(zip(labels.ravel().tolist(), expected.ravel().tolist(), strict=True))
        assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
        assert np.array_equal(sizes, np.bincount(labels[labels >= 0], minlength=len(sizes)))

    def test_a_gentle_slope_is_one_surface_and_a_step_is_not(self) -> None:
        slope = np.broadcast_to(0.9 * np.arange(50.0), (10, 50)).copy()
        assert len(label_surfaces(slope, 1.0)[1]) == 1
        slope[:, 25:] += 1.0
        assert len(label_surfaces(slope, 1.0)[1]) == 2


class TestClaimedTwice:
    def claims(self, cost_far: float) -> np.ndarray:
        """Two surfaces on one row that end on the same right pixels: columns 0..9 and 50..59."""
        x_left = np.arange(60.0)[None].repeat(3, axis=0)
        x_right = np.full((3, 60), np.nan)
        x_right[:, :10] = np.arange(10.0) + 20
        x_right[:, 50:] = np.arange(10.0) + 20
        cost = np.full((3, 60), 0.5, np.float32)
        cost[:, 50:] = cost_far
        y = np.arange(3.0)[:, None].repeat(60, axis=1)
        return claimed_twice(x_left, x_right, y, cost, 3, 60, 2.5)  # type: ignore[no-any-return]

    def test_the_worse_match_loses(self) -> None:
        assert self.claims(0.9)[:, 50:].all()
        assert not self.claims(0.9)[:, :50].any()
        assert self.claims(0.1)[:, :10].all()
        assert not self.claims(0.1)[:, 10:].any()

    def test_neighbours_on_one_surface_share_a_pixel(self) -> None:
        """A steep surface shows several left pixels on one right pixel."""
        x_left = np.arange(40.0)[None]
        x_right = 10 + 0.4 * x_left
        lost = claimed_twice(x_left, x_right, np.zeros((1, 40)), np.random.default_rng(0).random((1, 40)), 1, 60, 2.5)
        assert not lost.any()


class TestResample:
    def test_a_quadratic_is_exact(self) -> None:
        y, x = np.mgrid[0:30, 0:40].astype(np.float64)
        image = 0.3 + 0.02 * x - 0.01 * y + 0.001 * x * y + 0.0005 * x**2
        where = np.random.default_rng(0).uniform(3, 25, (50, 60, 2)).astype(np.float32)
        out, good = resample(image[None].astype(np.float32), np.ones((30, 40), np.bool_), where, 0)
        u, v = where[..., 0].astype(np.float64), where[..., 1].astype(np.float64)
        assert np.abs(out[0] - (0.3 + 0.02 * u - 0.01 * v + 0.001 * u * v + 0.0005 * u**2)).max() < 1e-5
        assert good.all()

    def test_fringes_keep_their_phase_better_than_in_opencv(self) -> None:
        x = np.arange(400.0)
        field = np.exp(2j * np.pi * x / 8.2)[None].repeat(20, axis=0)
        where = np.random.default_rng(1).uniform(5, 14, (40, 300, 2))
        where[..., 0] = np.random.default_rng(2).uniform(5, 390, (40, 300))
        where = where.astype(np.float32)
        truth = np.exp(2j * np.pi * where[..., 0].astype(np.float64) / 8.2)
        channels = np.stack([field.real, field.imag]).astype(np.float32)
        out, _ = resample(channels, np.ones((20, 400), np.bool_), where, 0)
        ours = np.angle((out[0] + 1j * out[1]) * truth.conj())
        theirs = [cv2.remap(c, where[..., 0], where[..., 1], cv2.INTER_CUBIC) for c in channels]
        rounded = np.angle((theirs[0] + 1j * theirs[1]) * truth.conj())
        assert np.abs(ours).max() < 0.01
        assert ours.std() < 0.4 * rounded.std()

    def test_linear_channels_take_only_the_nearest_four(self) -> None:
        image = np.zeros((1, 10, 10), np.float32)
        image[0, :, 6:] = 1e6
        out, _ = resample(image, np.ones((10, 10), np.bool_), np.full((1, 1, 2), 4.5, np.float32), 1)
        assert out[0, 0, 0] == 0

    def test_usable_means_all_four_neighbours_and_inside(self) -> None:
        usable = np.ones((10, 12), np.bool_)
        usable[4, 5] = False
        y, x = np.mgrid[-1.5:12:0.5, -1.5:14:0.5]
        where = np.stack([x, y], axis=-1).astype(np.float32)
        _, good = resample(np.zeros((1, 10, 12), np.float32), usable, where, 0)
        inside = (x >= 0) & (y >= 0) & (x <= 11) & (y <= 9)
        assert not good[~inside].any()
        touched = (np.abs(x - 5) < 1) & (np.abs(y - 4) < 1)
        assert not good[touched].any()
        clear = inside & ((np.abs(x - 5) > 1) | (np.abs(y - 4) > 1))
        assert good[clear].all()


class TestRefine:
    """A canvas pixel of the left view is a sensor pixel here, but shifted by a fraction."""

    def refine(
        self, plane: Plane, start: np.ndarray, noise: float = 0.0, weights: tuple[float, float] = (1.0, 0.0)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        shift = np.array([0.37, 0.21])
        y, x = np.mgrid[0 : HEIGHT - 2, 0 : WIDTH - 2].astype(np.float64)
        canvas = np.stack([x + shift[0], y + shift[1]], axis=-1)
        slope = float(plane.x_right[0, 1] - plane.x_right[0, 0])
        rate = float(plane.column_l[0, 1] - plane.column_l[0, 0])
        truth = plane.x_right[0, 0] + slope * canvas[..., 0]
        phase = plane.phases(100 + rate * canvas[..., 0])
        phase = phase + np.random.default_rng(0).normal(0, noise, phase.shape).astype(np.float32)
        found, low = refine_on_sensor(
            start.astype(np.float32), canvas.astype(np.float32), phase, np.ones_like(phase),
            np.ones(phase.shape[1:], np.bool_), plane.phases(plane.column_r),
            np.ones(plane.column_r.shape, np.bool_), np.array(weights),
        )  # fmt: skip
        return found, low, truth

    @pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
    def test_sub_pixel_accuracy_from_rough_matches(self, stretch: float) -> None:
        plane = Plane(stretch=stretch)
        rough = plane.x_right + np.random.default_rng(1).uniform(-0.7, 0.7, plane.x_right.shape)
        found, low, truth = self.refine(plane, rough)
        assert np.isfinite(found).mean() > 0.999
        assert np.nanmax(np.abs(found - truth)) < 0.005
        assert np.abs(low).max() < 0.005

    def test_low_phase_difference_is_reported(self) -> None:
        """A match one fringe off leaves 2 pi * 9 / 14 of low phase."""
        plane = Plane(stretch=1.0, rate=1.125)
        found, low, truth = self.refine(plane, plane.x_right + 8.0)
        assert np.nanmax(np.abs(found - truth - 8)) < 0.005
        assert np.abs(low) == pytest.approx(2 * np.pi * (1 - 9 / 14), abs=0.02)

    def test_fusing_the_carriers_lowers_the_noise(self) -> None:
        plane = Plane()
        alone, fused = (
            np.nanstd(np.subtract(*self.refine(plane, plane.x_right, 0.03, w)[::2])) for w in ((1.0, 0.0), (1.0, 1.0))
        )
        # column variance of a carrier is period^2: fused 1 / (1 + (9 / 14)^2)
        assert fused / alone == pytest.approx((1 + (9 / 14) ** 2) ** -0.5, rel=0.05)

    def test_no_match_no_column(self) -> None:
        plane = Plane()
        start = plane.x_right.copy()
        start[:, 50:70] = np.nan
        found, _, _ = self.refine(plane, start)
        assert np.isnan(found[:, 50:69]).all()
        assert np.isfinite(found[:, :49]).all()

    def test_a_match_far_from_any_solution_is_dropped(self) -> None:
        plane = Plane()
        off_canvas = np.full_like(plane.x_right, 5000.0)
        assert np.isnan(self.refine(plane, off_canvas)[0]).all()
