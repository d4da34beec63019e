"""Figures of point maps whose errors were put there by hand."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.capture import Truth
from models.geometry.rig import Rig
from models.metrics import (
    Figures,
    Reference,
    aggregate,
    bootstrap,
    common_mask,
    compare,
    compare_all,
    differences_as_json,
    figures_as_json,
    paired_bootstrap,
    table_rows,
    table_text,
)
from models.metrics.histogram import BINS, count, quantile
from models.metrics.layout import markdown_table, text_table
from models.metrics.tables import CLASS_TABLE, DEPTH_TABLE, MAIN_TABLE, class_rows, difference_rows
from models.points import PointMap, Reason

PERIOD = 9.0
RANGE = (400.0, 670.0)
SHAPE = (20, 25)
PIXELS = SHAPE[0] * SHAPE[1]
PHASE_FIGURES = ("order_accuracy", "order_accuracy_literal", "mae_phase", "rmse_phase")


def rays(rig: Rig) -> np.ndarray:
    """Lines of sight of pixels spread over the middle of the left image, (H, W, 3)."""
    v, u = np.meshgrid(np.linspace(140, 340, SHAPE[0]), np.linspace(200, 440, SHAPE[1]), indexing="ij")
    return rig.left.rays(np.stack([u, v], axis=-1))


def column_of(rig: Rig, points: np.ndarray) -> np.ndarray:
    return rig.projector.project(points)[..., 0]


@pytest.fixture(scope="module")
def scene(rig) -> tuple[np.ndarray, Reference]:
    """A tilted plane, points (H, W, 3), and what is known of it."""
    depth = np.linspace(480, 530, SHAPE[1], dtype=np.float32) + np.zeros(SHAPE, np.float32)
    points = (rays(rig) * depth[..., None]).astype(np.float32)
    return points, Reference(points[..., 2], column_of(rig, points), np.ones(SHAPE, bool))


def map_of(points: np.ndarray, phase: np.ndarray, invalid: np.ndarray | None = None) -> PointMap:
    """A point map with these points and high phases; the rest is of no concern here."""
    gone = np.zeros(SHAPE, bool) if invalid is None else invalid
    mask = np.where(gone, np.uint8(Reason.AMBIGUOUS), np.uint8(Reason.VALID))
    points = np.where(gone[..., None], np.float32(np.nan), points).astype(np.float32)
    return dataclasses.replace(PointMap.empty(SHAPE), points=points, mask=mask, phase_high=phase.astype(np.float32))


def phase_of(reference: Reference) -> np.ndarray:
    return np.mod(2 * np.pi * reference.column / PERIOD, 2 * np.pi)


def first(share: float) -> np.ndarray:
    """The first share of the pixels in row order."""
    return np.arange(PIXELS).reshape(SHAPE) < share * PIXELS


def moved(points: np.ndarray, millimetres: float | np.ndarray) -> np.ndarray:
    """Points moved along their lines of sight by so much depth."""
    z = points[..., 2:].astype(float)
    return points * (1 + np.broadcast_to(millimetres, SHAPE)[..., None] / z)


def figures_of(points: PointMap, reference: Reference, rig: Rig) -> Figures:
    return aggregate([compare(points, reference, rig, PERIOD, RANGE)])


def test_the_truth_itself_is_without_error(rig, scene):
    points, reference = scene
    result = figures_of(map_of(points, phase_of(reference)), reference, rig)
    assert (result.samples, result.pixels) == (1, PIXELS)
    for name in ("valid", "order_accuracy", "order_accuracy_literal", "within_1mm", "within_3mm"):
        assert getattr(result, name) == 100, name
    for name in ("mae_depth", "rmse_depth", "gross"):
        assert getattr(result, name) == 0, name
    assert result.mae_phase == pytest.approx(0, abs=1e-5)
    assert result.p95_depth < 1e-4
    assert result.median_depth < 1e-4


def test_invalid_pixels_lower_shares_but_not_errors(rig, scene):
    points, reference = scene
    result = figures_of(map_of(points, phase_of(reference), first(0.25)), reference, rig)
    assert result.valid == result.within_1mm == result.within_3mm == result.order_accuracy == 75
    assert result.order_accuracy_literal == 75
    assert result.mae_depth == result.rmse_depth == 0


def test_depth_errors_of_a_tenth_of_the_pixels(rig, scene):
    points, reference = scene
    result = figures_of(map_of(moved(points, 5 * first(0.1)), phase_of(reference)), reference, rig)
    assert result.mae_depth == pytest.approx(0.5, rel=1e-4)
    assert result.rmse_depth == pytest.approx(math.sqrt(0.1) * 5, rel=1e-4)
    assert result.p95_depth == pytest.approx(5, rel=0.005)
    assert result.median_depth < 1e-3
    assert result.within_1mm == result.within_3mm == 90
    assert result.gross == 100
    assert result.order_accuracy == 100  # 5 mm are a fifth of a fringe
    assert result.mae_phase == pytest.approx(0, abs=1e-5)


def test_shares_are_of_the_foreground_and_errors_of_the_valid_pixels(rig, scene):
    points, reference = scene
    invalid = first(0.5) & ~first(0.1)  # of 60 % valid, a sixth is off by 2 mm
    result = figures_of(map_of(moved(points, -2 * first(0.1)), phase_of(reference), invalid), reference, rig)
    assert result.valid == 60
    assert (result.within_1mm, result.within_3mm) == (50, 60)
    assert result.mae_depth == pytest.approx(2 / 6, rel=1e-4)
    assert result.rmse_depth == pytest.approx(2 / math.sqrt(6), rel=1e-4)
    assert result.gross == 0


def test_thresholds_are_strict(rig):
    depth = np.full(SHAPE, 500, np.float32)
    flat = np.stack([0 * depth, 0 * depth, depth], axis=-1)
    reference = Reference(depth, np.full(SHAPE, np.nan), np.ones(SHAPE, bool))
    for error, within_1mm, within_3mm, gross in ((1, 0, 100, 0), (3, 0, 0, 0), (3.5, 0, 0, 1000)):
        result = figures_of(map_of(flat + np.array([0, 0, error]), 0 * depth), reference, rig)
        assert (result.within_1mm, result.within_3mm, result.gross) == (within_1mm, within_3mm, gross)


def test_wrong_fringe_orders_are_told_by_geometry(rig, scene):
    points, reference = scene
    wrong = first(0.2)
    shifted = moved(points, 60 * wrong)
    orders = np.round((column_of(rig, shifted) - reference.column) / PERIOD)
    assert (np.abs(orders[wrong]) >= 1).all()
    assert (orders[~wrong] == 0).all()
    result = figures_of(map_of(shifted, phase_of(reference)), reference, rig)
    assert result.order_accuracy == result.order_accuracy_literal == 80
    assert result.mae_phase == pytest.approx(2 * np.pi * np.abs(orders).mean(), rel=1e-5)
    assert result.rmse_phase == pytest.approx(2 * np.pi * math.sqrt((orders**2).mean()), rel=1e-5)


@pytest.mark.parametrize("error", [0.3, -0.3])
@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_phase_errors_count_whole_and_do_not_change_the_tolerant_order(rig, scene, error, turns):
    points, reference = scene
    phase = np.mod(phase_of(reference) + error, 2 * np.pi) + 2 * np.pi * turns  # any branch will do
    result = figures_of(map_of(points, phase), reference, rig)
    assert result.mae_phase == pytest.approx(0.3, rel=1e-4)
    assert result.rmse_phase == pytest.approx(0.3, rel=1e-4)
    assert result.order_accuracy == 100
    past_the_wrap = phase_of(reference) > 2 * np.pi - 0.3 if error > 0 else phase_of(reference) < 0.3
    assert 0 < past_the_wrap.mean() < 0.1
    assert result.order_accuracy_literal == pytest.approx(100 * (1 - past_the_wrap.mean()))


def test_a_point_without_phase_has_no_order(rig, scene):
    points, reference = scene
    phase = np.where(first(0.1), np.nan, phase_of(reference))
    result = figures_of(map_of(points, phase), reference, rig)
    assert (result.valid, result.order_accuracy) == (100, 90)
    assert result.mae_phase == pytest.approx(0, abs=1e-5)


def test_only_known_foreground_within_the_range_counts(rig, scene):
    points, reference = scene
    depth = reference.depth.copy()
    depth[0] = np.nan
    depth[1] = 399
    depth[2] = 671
    foreground = np.ones(SHAPE, bool)
    foreground[3] = False
    damaged = moved(points, 50 * (np.arange(SHAPE[0]) < 4)[:, None])
    result = figures_of(map_of(damaged, phase_of(reference)), Reference(depth, reference.column, foreground), rig)
    assert result.pixels == PIXELS - 4 * SHAPE[1]
    assert (result.valid, result.within_1mm, result.order_accuracy) == (100, 100, 100)


def test_without_a_projector_there_are_no_phase_figures(rig, scene):
    points, reference = scene
    result = figures_of(map_of(points, phase_of(reference)), reference, Rig(rig.left, rig.right))
    assert all(math.isnan(getattr(result, name)) for name in PHASE_FIGURES)
    assert (result.valid, result.within_1mm) == (100, 100)
    (_, row) = table_rows(MAIN_TABLE, {"wft": result})
    assert row == ["wft", "100.00", "-", "-", "-", "-", "0.000", "0.000", "100.00", "100.00"]


def test_a_failed_method_counts_as_all_invalid(rig, scene):
    points, reference = scene
    maps = {"good": map_of(points, phase_of(reference)), "failed": PointMap.empty(SHAPE)}
    result = {name: aggregate([e]) for name, e in compare_all(maps, reference, rig, PERIOD, RANGE).items()}
    assert len(maps["failed"]) == 0
    assert (result["failed"].valid, result["failed"].order_accuracy, result["failed"].within_3mm) == (0, 0, 0)
    assert math.isnan(result["failed"].mae_depth)
    assert math.isnan(result["failed"].p95_depth)
    assert result["good"].common_pixels == 0
    assert math.isnan(result["good"].common_mae_depth)


def test_common_figures_are_over_what_all_methods_have(rig, scene):
    points, reference = scene
    phase = phase_of(reference)
    maps = {
        "a": map_of(moved(points, np.where(first(0.5), 4, 1)), phase, first(0.2)),
        "b": map_of(moved(points, 2), phase, ~first(0.6)),
    }
    shared = first(0.6) & ~first(0.2)
    np.testing.assert_array_equal(common_mask(maps.values(), reference, RANGE), shared)
    result = {name: aggregate([e]) for name, e in compare_all(maps, reference, rig, PERIOD, RANGE).items()}
    assert result["a"].common_pixels == result["b"].common_pixels == shared.sum()
    assert result["a"].common_mae_depth == pytest.approx(0.75 * 4 + 0.25 * 1, rel=1e-4)
    assert result["a"].common_rmse_depth == pytest.approx(math.sqrt(0.75 * 16 + 0.25), rel=1e-4)
    assert result["b"].common_mae_depth == pytest.approx(2, rel=1e-4)
    assert result["a"].mae_depth == pytest.approx((3 * 4 + 5 * 1) / 8, rel=1e-4)


def test_sizes_must_agree(rig, scene):
    with pytest.raises(ValueError, match="reference"):
        compare(PointMap.empty((3, 4)), scene[1], rig, PERIOD, RANGE)


# References


def test_truth_is_taken_as_it_is(scene):
    points, _ = scene
    truth = Truth(points[..., 2], points[..., 0], first(0.5))
    reference = Reference.from_truth(truth)
    np.testing.assert_array_equal(
        reference.within((500, 520)), first(0.5) & (truth.depth >= 500) & (truth.depth <= 520)
    )


def test_a_reconstruction_as_reference_is_absolute_phase(rig, scene):
    points, known = scene
    gone = first(0.1)
    off = moved(points, 3)  # a calibration that is a little wrong must not change the order
    reference = Reference.from_points(map_of(off, phase_of(known), gone), rig, PERIOD)
    np.testing.assert_array_equal(reference.foreground, ~gone)
    np.testing.assert_allclose(reference.column[~gone], known.column[~gone], atol=1e-4)
    assert np.isnan(reference.column[gone]).all()
    blind = Reference.from_points(map_of(off, phase_of(known)), Rig(rig.left, rig.right), PERIOD)
    assert np.isnan(blind.column).all()


# Sums over samples


@given(seed=st.integers(0, 2**32 - 1), cut=st.integers(1, SHAPE[0] - 1))
def test_samples_add_up_to_all_their_pixels(rig, scene, seed, cut):
    points, reference = scene
    draw = np.random.default_rng(seed)
    estimate = map_of(
        moved(points, draw.normal(0, 5, SHAPE)),
        np.mod(phase_of(reference) + draw.normal(0, 1, SHAPE), 2 * np.pi),
        draw.random(SHAPE) < 0.3,
    )
    foreground = draw.random(SHAPE) < 0.8
    rows = np.arange(SHAPE[0])[:, None] < cut
    parts = [Reference(reference.depth, reference.column, foreground & part) for part in (rows, ~rows)]
    whole = figures_of(estimate, Reference(reference.depth, reference.column, foreground), rig)
    summed = aggregate([compare(estimate, part, rig, PERIOD, RANGE) for part in parts])
    assert summed.samples == 2
    for field in dataclasses.fields(Figures):
        if field.name != "samples":
            assert getattr(summed, field.name) == pytest.approx(getattr(whole, field.name), nan_ok=True), field.name


def test_no_samples_give_no_figures():
    nothing = aggregate([])
    assert (nothing.samples, nothing.pixels) == (0, 0)
    assert math.isnan(nothing.valid)
    assert all(math.isnan(low) for low, _ in bootstrap([], 0).values())


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(200, 5000),
    scale=st.floats(0.01, 100),
    share=st.sampled_from([0.5, 0.95]),
)
def test_quantiles_of_the_histogram_are_those_of_the_errors(seed, size, scale, share):
    errors = np.abs(np.random.default_rng(seed).standard_t(3, size)) * scale
    told = quantile(count(errors).astype(float), share)
    low, high = np.quantile(errors, [share - 1 / size, share + 1 / size])
    assert low * 0.995 <= told <= high * 1.005


def test_the_histogram_has_a_place_for_every_error():
    histogram = count(np.array([0.0, 1e-5, 1.0, 9e3, 1e9]))
    assert histogram.shape == (BINS,)
    assert histogram.sum() == 5
    assert (histogram[0], histogram[-1]) == (2, 1)
    assert quantile(histogram.astype(float), 1.0) == pytest.approx(1e4)


# Intervals


def many(rig: Rig, scene: tuple[np.ndarray, Reference], shares: np.ndarray) -> list:
    """One sample a share, of whose pixels that share is invalid."""
    points, reference = scene
    phase = phase_of(reference)
    return [compare(map_of(points, phase, first(s)), reference, rig, PERIOD, RANGE) for s in shares]


def test_intervals_have_the_width_of_the_scatter_between_scenes(rig, scene):
    samples = many(rig, scene, np.random.default_rng(1).uniform(0, 0.5, 40))
    valid = [aggregate([s]).valid for s in samples]
    low, high = bootstrap(samples, seed=3, resamples=2000)["valid"]
    assert low < np.mean(valid) < high
    assert high - low == pytest.approx(2 * 1.96 * np.std(valid) / math.sqrt(40), rel=0.12)


def test_intervals_repeat_with_their_seed(rig, scene):
    samples = many(rig, scene, np.array([0, 0.1, 0.2, 0.3, 0.9]))
    assert bootstrap(samples, seed=5) == bootstrap(samples, seed=5)
    assert bootstrap(samples, seed=5)["valid"] != bootstrap(samples, seed=6)["valid"]
    assert set(bootstrap(samples, seed=5)) < {f.name for f in dataclasses.fields(Figures)}


def test_equal_scenes_have_no_width_and_one_scene_no_interval(rig, scene):
    samples = many(rig, scene, np.array([0.2] * 5))
    assert bootstrap(samples, seed=0)["valid"] == (80, 80)
    assert math.isnan(bootstrap(samples[:1], seed=0)["valid"][0])


# Differences


def test_a_constant_advantage_is_certain_when_the_same_scenes_are_drawn(rig, scene):
    """Scenes differ by tens of points, the methods by two in each: only the paired interval can tell."""
    hard = np.random.default_rng(1).uniform(0.1, 0.7, 30)
    worse, better = many(rig, scene, hard), many(rig, scene, hard - 0.02)
    told = paired_bootstrap(better, worse, seed=3)["valid"]
    assert told.value == pytest.approx(2, abs=0.1)  # shares are cut to whole pixels
    assert 1.8 < told.low <= told.value <= told.high < 2.2
    assert told.excludes_zero
    (low, high), (low_worse, high_worse) = bootstrap(better, seed=3)["valid"], bootstrap(worse, seed=3)["valid"]
    assert low < high_worse
    assert low_worse < high
    assert high - low > 20 * (told.high - told.low)


def test_a_difference_turns_its_sign_with_its_rows(rig, scene):
    ours, theirs = (many(rig, scene, np.array(s)) for s in ([0.1, 0.3, 0.2], [0.3, 0.1, 0.3]))
    there, back = paired_bootstrap(ours, theirs, seed=1), paired_bootstrap(theirs, ours, seed=1)
    for name, told in there.items():
        assert (told.value, told.low, told.high) == pytest.approx(
            (-back[name].value, -back[name].high, -back[name].low), nan_ok=True
        )
    assert there["valid"].low < 0 < there["valid"].high
    assert not there["valid"].excludes_zero


def test_a_method_against_itself_differs_by_nothing(rig, scene):
    samples = many(rig, scene, np.array([0.1, 0.3]))
    told = paired_bootstrap(samples, samples, seed=1)["valid"]
    assert (told.value, told.low, told.high, told.excludes_zero) == (0, 0, 0, False)


def test_one_scene_has_a_difference_without_interval(rig, scene):
    (told,) = (paired_bootstrap(many(rig, scene, [0.1]), many(rig, scene, [0.3]), seed=1)["valid"],)
    assert told.value == pytest.approx(20)
    assert math.isnan(told.low)
    assert not told.excludes_zero


def test_only_the_same_scenes_can_be_paired(rig, scene):
    with pytest.raises(ValueError, match="2 samples cannot be paired with 1"):
        paired_bootstrap(many(rig, scene, [0.1, 0.2]), many(rig, scene, [0.1]), seed=0)


def test_differences_are_marked_where_their_interval_excludes_zero(rig, scene):
    same, worse = many(rig, scene, np.array([0.1, 0.2])), many(rig, scene, np.array([0.2, 0.4]))
    differences = {"worse": paired_bootstrap(worse, same, 0), "same": paired_bootstrap(same, same, 0)}
    rows = difference_rows(MAIN_TABLE, differences, "good")
    assert [row[:2] for row in rows] == [
        ["minus good", "Valid %"],
        ["worse", "-15.00*"],
        ["  95 %", "-20.00..-10.00 "],
        ["same", "+0.00 "],
        ["  95 %", "+0.00..+0.00 "],
    ]
    assert difference_rows(DEPTH_TABLE, differences, "good")[1][1] == "- "
    data = json.loads(json.dumps(differences_as_json(differences["worse"]), allow_nan=False))
    assert data["valid"] == {"difference": pytest.approx(-15), "interval": [-20, -10], "excludes_zero": True}
    assert data["common_mae_depth"] == {"difference": None, "interval": [None, None], "excludes_zero": False}


# Tables


def example(rig: Rig, scene: tuple[np.ndarray, Reference]) -> tuple[dict, dict]:
    samples = {"wft": many(rig, scene, np.array([0.1, 0.3])), "nstep": many(rig, scene, np.array([0.0, 0.0]))}
    intervals = {name: bootstrap(s, seed=0) for name, s in samples.items()}
    return {name: aggregate(s) for name, s in samples.items()}, intervals


def test_tables_have_a_row_a_method_and_a_column_a_figure(rig, scene):
    results, intervals = example(rig, scene)
    rows = table_rows(MAIN_TABLE, results)
    assert rows[0][:4] == ["method", "Valid %", "FOAcc %", "literal %"]
    assert [row[:3] for row in rows[1:]] == [["wft", "80.00", "80.00"], ["nstep", "100.00", "100.00"]]
    with_intervals = table_rows(MAIN_TABLE, results, intervals)
    assert [row[:2] for row in with_intervals[1:3]] == [["wft", "80.00"], ["  95 %", "70.00..90.00"]]
    assert len(with_intervals) == 5
    assert table_rows(DEPTH_TABLE, results, intervals)[2][1] == "-"
    assert [row[1] for row in table_rows(DEPTH_TABLE, results)[1:]] == ["-", "-"]
    text = table_text(results, intervals)
    assert "2 samples, 1000 foreground pixels" in text
    for block in text.split("\n\n")[:2]:
        assert len({len(line) for line in block.splitlines()}) == 1


def test_json_is_strict_and_complete(rig, scene):
    results, intervals = example(rig, scene)
    data = json.loads(json.dumps(figures_as_json(results["wft"], intervals["wft"]), allow_nan=False))
    assert data["valid"] == 80
    assert data["samples"] == 2
    assert data["common_mae_depth"] is None
    assert data["intervals"]["valid"] == [70, 90]
    assert set(data) == {f.name for f in dataclasses.fields(Figures)} | {"intervals"}


def test_the_table_of_classes_has_a_heading_and_its_rows_a_class(rig, scene):
    results, _ = example(rig, scene)
    rows = class_rows({"dark": results, "glossy": {"wft": results["wft"]}})
    assert rows[0] == ["class, method", *(column.heading for column in CLASS_TABLE)]
    assert rows[1] == ["dark: 2 samples, 1000 pixels"]
    assert [row[:2] for row in rows[2:4]] == [["  wft", "80.00"], ["  nstep", "100.00"]]
    assert [row[0] for row in rows[4:]] == ["glossy: 2 samples, 1000 pixels", "  wft"]


def test_headings_inside_tables_take_no_column():
    rows = [["method", "|e| mm"], ["a long heading of a class"], ["  wft", "1.5"]]
    assert text_table(rows).splitlines() == [
        "method  |e| mm",
        "--------------",
        "a long heading of a class",
        "  wft      1.5",
    ]
    assert markdown_table(rows).splitlines() == [
        "| method | \\|e\\| mm |",
        "| --- | ---: |",
        "| **a long heading of a class** |  |",
        "| wft | 1.5 |",
    ]
