"""What every phase method and every matcher promises, and what each matching mode can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from ideal_phases import Patch, ideal_phases
from simulated_captures import only, plate_before_wall

from models.errors import CaptureError
from models.geometry.rectification import rectify
from models.geometry.rig import Rig
from models.phase.fringe import PhaseExtractor
from models.phase.nstep import NStep
from models.phase.wft import WindowedFourierTransform
from models.points import Reason
from models.stereo.matcher import MATCHINGS, CanvasMatches, Matcher, Matching, PhaseMatcher

RANGE = (400.0, 670.0)
SLANTED = Patch(520.0, slope_x=0.35, slope_y=-0.2)


def extractor(name: str) -> PhaseExtractor:
    return NStep() if name == "nstep" else WindowedFourierTransform(plate_before_wall().rig)


@pytest.mark.parametrize("name", ["nstep", "wft"])
class TestPhaseExtractor:
    def test_shapes_and_types(self, name: str) -> None:
        phases = extractor(name).extract(plate_before_wall())
        assert set(phases) == {"left", "right"}
        for phase in phases.values():
            assert phase.carriers.shape == (2, 480, 640)
            assert phase.carriers.dtype == torch.complex64
            assert phase.texture.shape == phase.mask.shape == (480, 640)
            assert (phase.texture.dtype, phase.mask.dtype) == (torch.float32, torch.uint8)
            assert phase.periods == (9.0, 14.0)
            for extra in (phase.misfit, phase.column):
                assert extra is None or (extra.shape == (480, 640) and extra.dtype == torch.float32)

    def test_what_is_valid_is_finite_and_modulated(self, name: str) -> None:
        phase = extractor(name).extract(plate_before_wall())["left"]
        valid = phase.mask == Reason.VALID
        assert valid.float().mean() > 0.8
        assert torch.isfinite(phase.wrapped[:, valid]).all()
        assert (phase.modulation[:, valid] > 0).all()
        assert (phase.wrapped.abs() <= np.pi + 1e-6).all()
        assert torch.isfinite(phase.texture).all()

    def test_reasons_are_those_of_a_phase(self, name: str) -> None:
        phase = extractor(name).extract(plate_before_wall())["left"]
        told = set(phase.mask.unique().tolist())
        assert told <= {Reason.VALID, Reason.UNLIT, Reason.LOW_MODULATION, Reason.SATURATED}

    def test_needed_groups_suffice_and_their_absence_is_named(self, name: str) -> None:
        method = extractor(name)
        needed = method.required_kinds()
        capture = plate_before_wall()
        assert set(method.extract(only(capture, needed))) == {"left", "right"}
        for kind in needed:
            with pytest.raises(CaptureError, match=kind):
                method.extract(only(capture, capture.plan.kinds - {kind}))

    def test_one_view_is_enough(self, name: str) -> None:
        capture = plate_before_wall()
        assert set(extractor(name).extract(replace(capture, images={"left": capture.images["left"]}))) == {"left"}

    def test_both_methods_tell_the_same_phase(self, name: str) -> None:
        phase = extractor(name).extract(plate_before_wall())["left"]
        truth = plate_before_wall().truth
        assert truth is not None
        seen = truth.foreground & (phase.mask.numpy() == Reason.VALID)
        for carrier, period in zip(phase.carriers.numpy(), phase.periods, strict=True):
            expected = np.exp(2j * np.pi * truth.projector_column[seen] / period)
            assert np.median(np.abs(np.angle(carrier[seen] * expected.conj()))) < 0.15


def canvas_truth(rig: Rig, patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """Right canvas column (h, w) of what the left canvas pixels see, and whether it stands on the right sensor."""
    rectification = rectify(rig)
    width, height = rectification.sizes["left"]
    y, x = np.mgrid[0:height, 0:width].astype(float)
    across, down = (x - rectification.cx["left"]) / rectification.focal, (y - rectification.cy) / rectification.focal
    rays = np.stack([across, down, np.ones_like(x)], axis=-1) @ rectification.rotation
    points = rays * (patch.depth / (rays @ [-patch.slope_x, -patch.slope_y, 1.0]))[..., None]
    return rectification.canvas_coordinates("right", points)[..., 0], rig.right.contains(rig.right.project(points))


@pytest.mark.parametrize("name", MATCHINGS)
@pytest.mark.parametrize("columns", [False, True], ids=["wrapped", "absolute"])
class TestMatcher:
    def match(self, rig: Rig, name: Matching, columns: bool, noise: float = 0.0) -> CanvasMatches:
        phases, _ = ideal_phases(rig, [SLANTED], columns=columns, noise=noise)
        matcher: Matcher = PhaseMatcher(name)
        return matcher.match(phases, rig, RANGE)

    def test_shapes_and_types(self, rig: Rig, name: Matching, columns: bool) -> None:
        matches = self.match(rig, name, columns)
        assert PhaseMatcher(name).name == name
        width, height = rectify(rig).sizes["left"]
        for array in (matches.x_right, matches.cost, matches.margin):
            assert array.shape == (height, width)
            assert array.dtype == np.float32
        assert matches.reason.shape == (height, width)
        assert matches.reason.dtype == np.uint8

    def test_a_match_stands_exactly_where_the_reason_says_so(self, rig: Rig, name: Matching, columns: bool) -> None:
        matches = self.match(rig, name, columns)
        assert np.array_equal(np.isfinite(matches.x_right), matches.reason == Reason.VALID)
        assert set(np.unique(matches.reason)) <= {Reason.VALID, Reason.NO_MATCH, Reason.AMBIGUOUS}
        found = matches.x_right[matches.reason == Reason.VALID]
        assert found.min() >= 0
        assert found.max() <= rectify(rig).sizes["right"][0] - 1

    def test_a_slanted_plane_is_matched(self, rig: Rig, name: Matching, columns: bool) -> None:
        matches = self.match(rig, name, columns, noise=0.02)
        truth, visible = canvas_truth(rig, SLANTED)
        valid = (matches.reason == Reason.VALID) & visible
        assert valid.sum() > 0.95 * visible.sum()
        off = np.abs(matches.x_right - truth)[valid]
        assert np.median(off) < 0.05
        assert (off > 1).mean() < 0.005

    def test_nothing_is_matched_without_light(self, rig: Rig, name: Matching, columns: bool) -> None:
        phases, _ = ideal_phases(rig, [SLANTED], columns=columns)
        dark = {s: replace(p, mask=torch.ones_like(p.mask)) for s, p in phases.items()}
        matches = PhaseMatcher(name).match(dark, rig, RANGE)
        assert (matches.reason == Reason.NO_MATCH).all()


def test_only_the_projector_tells_a_plane_from_its_alias(rig: Rig) -> None:
    """One carrier repeats every fringe: the pair is lost, the projector is not."""
    phases, _ = ideal_phases(rig, [SLANTED], periods=(9.0,))
    truth, visible = canvas_truth(rig, SLANTED)
    right = {}
    for name in MATCHINGS:
        matches = PhaseMatcher(name).match(phases, rig, RANGE)
        with np.errstate(invalid="ignore"):
            right[name] = (np.abs(matches.x_right - truth)[visible] < 0.5).mean()
    assert right["trinocular"] > 0.9
    assert right["stereo"] < 0.5


def test_absolute_columns_need_both_views(rig: Rig) -> None:
    phases, _ = ideal_phases(rig, [SLANTED], columns=True)
    half = {"left": phases["left"], "right": replace(phases["right"], column=None)}
    matches = PhaseMatcher("trinocular").match(half, rig, RANGE)  # type: ignore[arg-type]
    assert (matches.reason == Reason.VALID).mean() > 0.4
