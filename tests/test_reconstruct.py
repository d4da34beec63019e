"""From a capture to a cloud: accuracy on simulated scenes, the contract of the result, and honest refusals."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from simulated_captures import exposed, objects_before_wall, only, plate_before_wall

from models.capture import Capture
from models.errors import CalibrationError, CaptureError, ReconstructionError
from models.export.npz import ARRAYS
from models.geometry.device import Device
from models.geometry.rig import Rig
from models.metrics import aggregate
from models.metrics.reference import Reference
from models.metrics.samples import compare
from models.points import Origin, Reason
from models.reconstruct import (
    METHODS,
    SINGLE_SHOT_METHODS,
    Method,
    Reconstruction,
    ReconstructionOptions,
    kinds_needed,
    reconstruct,
)
from models.stereo.matcher import MATCHINGS, Matching

EVERY_MODE = list(itertools.product(METHODS, MATCHINGS))
DISTINCT: tuple[Method, ...] = ("nstep", "wft", "refiner")
"""The other transforms differ from wft in their carriers alone: what they read and refuse is the same code."""


@lru_cache(maxsize=len(EVERY_MODE))
def reconstructed(method: Method, matching: Matching) -> Reconstruction:
    return reconstruct(objects_before_wall(), ReconstructionOptions(method, matching))


def figures(capture: Capture, result: Reconstruction):  # type: ignore[no-untyped-def]
    assert capture.truth is not None
    reference = Reference.from_truth(capture.truth)
    return aggregate([compare(result.points, reference, result.rig, 9.0, result.depth_range)])


class TestAccuracy:
    def test_reference_method(self) -> None:
        got = figures(objects_before_wall(), reconstructed("nstep", "trinocular"))
        assert got.valid >= 93
        assert got.median_depth <= 0.05
        assert got.gross <= 3
        assert got.order_accuracy >= got.valid - 0.5

    def test_reference_method_without_the_projector(self) -> None:
        got = figures(objects_before_wall(), reconstructed("nstep", "stereo"))
        assert got.valid >= 90
        assert got.median_depth <= 0.05
        assert got.gross <= 5

    @pytest.mark.parametrize(("matching", "order", "gross"), [("trinocular", 80, 60), ("stereo", 75, 90)])
    def test_single_shot(self, matching: Matching, order: float, gross: float) -> None:
        got = figures(objects_before_wall(), reconstructed("wft", matching))
        assert got.order_accuracy >= order
        assert got.within_1mm >= 65
        assert got.median_depth <= 0.5
        assert got.gross <= gross

    @pytest.mark.parametrize("method", METHODS)
    def test_planes_are_flat_and_where_they_stand(self, method: Method) -> None:
        capture = plate_before_wall()
        result = reconstruct(capture, ReconstructionOptions(method))
        bound = 0.06 if method == "nstep" else 0.5
        for depth in (460.0, 600.0):
            assert capture.truth is not None
            here = np.abs(capture.truth.depth - depth) < 1
            z = result.points.depth[here & result.points.valid]
            assert len(z) > 0.6 * here.sum()
            assert abs(np.median(z) - depth) < bound / 3
            assert np.median(np.abs(z - depth)) < bound

    @pytest.mark.parametrize("scene", [objects_before_wall, plate_before_wall], ids=["objects", "plate"])
    def test_points_of_camera_and_projector(self, scene) -> None:  # type: ignore[no-untyped-def]
        capture: Capture = scene()
        points = reconstruct(capture, ReconstructionOptions("nstep", "trinocular")).points
        filled = points.origin == Origin.LEFT_PROJECTOR
        assert capture.truth is not None
        error = np.abs(points.depth - capture.truth.depth)[filled]
        assert filled.sum() > 5000
        assert np.median(error) <= 0.12
        assert (error > 1).mean() <= 0.010
        assert (error > 3).mean() <= 0.003

    def test_phases_without_gray_planes_are_matched_wrapped(self) -> None:
        capture = only(objects_before_wall(), {"high", "low"})
        got = figures(capture, reconstruct(capture, ReconstructionOptions("nstep", "trinocular")))
        assert got.valid >= 88
        assert got.median_depth <= 0.05
        assert got.gross <= 10

    def test_one_carrier_and_gray_planes(self) -> None:
        capture = only(objects_before_wall(), {"white", "black", "high", "gray"})
        result = reconstruct(capture, ReconstructionOptions("nstep", "trinocular"))
        got = figures(capture, result)
        assert got.valid >= 45  # without a second carrier nothing settles the edges of the Gray words
        assert got.median_depth <= 0.06
        assert got.gross <= 3
        assert np.isnan(result.points.phase_low).all()
        assert np.isfinite(result.points.phase_high[result.points.valid]).all()

    def test_what_stands_outside_the_range_is_not_moved_inside(self) -> None:
        capture = plate_before_wall()
        assert capture.truth is not None
        result = reconstruct(capture, ReconstructionOptions("nstep", depth_range=(420.0, 520.0)))
        wall = capture.truth.depth > 590
        assert result.points.valid[wall].mean() < 0.002
        assert (result.points.mask[wall & capture.truth.foreground] != Reason.VALID).mean() > 0.99


@pytest.mark.parametrize(("method", "matching"), EVERY_MODE)
class TestContract:
    def test_arrays_of_the_result(self, method: Method, matching: Matching) -> None:
        points = reconstructed(method, matching).points
        shape = (480, 640)
        for name in ARRAYS:
            array = getattr(points, name)
            assert array.shape[:2] == shape
            assert array.dtype == (np.uint8 if name in ("origin", "mask") else np.float32)
        assert points.points.shape == points.normals.shape == (*shape, 3)

    def test_mask_is_zero_exactly_where_there_is_a_point(self, method: Method, matching: Matching) -> None:
        points = reconstructed(method, matching).points
        finite = np.isfinite(points.points)
        assert np.array_equal(finite.all(axis=2), points.mask == 0)
        assert np.array_equal(finite.any(axis=2), points.mask == 0)
        assert set(np.unique(points.mask)) <= {int(r) for r in Reason}
        assert len(points) == (points.mask == 0).sum() > 50_000

    def test_everything_beside_a_point_is_finite(self, method: Method, matching: Matching) -> None:
        points = reconstructed(method, matching).points
        for phase in (points.phase_high, points.phase_low):
            assert np.array_equal(np.isfinite(phase), points.valid)
            assert 0 <= phase[points.valid].min() <= phase[points.valid].max() < 2 * np.pi + 1e-6
        assert np.isfinite(points.intensity).all()
        assert np.isfinite(points.modulation).all()
        assert (points.confidence[~points.valid] == 0).all()
        assert 0 < points.confidence[points.valid].min() <= points.confidence.max() <= 1
        assert np.array_equal(points.origin == Origin.NONE, ~points.valid)

    def test_points_project_onto_their_own_pixels(self, method: Method, matching: Matching) -> None:
        result = reconstructed(method, matching)
        grid = result.rig.left.pixel_grid()
        off = result.rig.left.project(result.points.points[result.points.valid]) - grid[result.points.valid]
        assert np.abs(off).max() < 0.01

    def test_confidence_ranks_errors(self, method: Method, matching: Matching) -> None:
        points = reconstructed(method, matching).points
        truth = objects_before_wall().truth
        assert truth is not None
        known = points.valid & truth.foreground & np.isfinite(truth.depth)
        error, confidence = np.abs(points.depth - truth.depth)[known], points.confidence[known]
        doubtful = confidence <= np.quantile(confidence, 0.1)
        assert (error[doubtful] > 1).mean() > 1.5 * (error[~doubtful] > 1).mean()

    def test_points_lie_within_the_range(self, method: Method, matching: Matching) -> None:
        result = reconstructed(method, matching)
        near, far = result.depth_range
        depth = result.points.depth[result.points.valid]
        assert near - 1e-3 <= depth.min() <= depth.max() <= far + 1e-3

    def test_two_runs_give_the_same_bits(self, method: Method, matching: Matching) -> None:
        once = reconstructed(method, matching).points
        again = reconstruct(objects_before_wall(), ReconstructionOptions(method, matching)).points
        for name in ARRAYS:
            assert getattr(once, name).tobytes() == getattr(again, name).tobytes(), name


def test_stages_are_timed_and_reported() -> None:
    told: list[tuple[str, float]] = []
    result = reconstruct(
        plate_before_wall(), ReconstructionOptions("nstep"), progress=lambda stage, share: told.append((stage, share))
    )
    assert set(result.timings_s) == {"phase", "matching", "points"}
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_projector_is_used_where_there_is_one() -> None:
    capture = plate_before_wall()
    assert capture.rig is not None
    assert reconstruct(capture, ReconstructionOptions("nstep")).matching == "trinocular"
    cameras_only = Rig(capture.rig.left, capture.rig.right, quality={"working_range_mm": [400, 670]})
    assert reconstruct(capture, ReconstructionOptions("nstep"), rig=cameras_only).matching == "stereo"


@pytest.mark.parametrize("method", DISTINCT)
def test_a_method_reads_only_the_kinds_it_names(method: Method) -> None:
    capture = plate_before_wall()
    whole = reconstruct(capture, ReconstructionOptions(method)).points
    part = reconstruct(only(capture, kinds_needed(method)), ReconstructionOptions(method)).points
    assert np.array_equal(whole.points, part.points, equal_nan=True)


class TestRefusals:
    def test_no_calibration(self) -> None:
        with pytest.raises(CalibrationError, match="calibration"):
            reconstruct(replace(plate_before_wall(), rig=None), ReconstructionOptions())

    @pytest.mark.parametrize("method", METHODS)
    def test_one_view(self, method: Method) -> None:
        capture = plate_before_wall()
        with pytest.raises(CaptureError, match="two views"):
            reconstruct(replace(capture, images={"left": capture.images["left"]}), ReconstructionOptions(method))

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_images_of_another_size_than_the_calibration(self, side: str) -> None:
        capture = plate_before_wall()
        cut = {n: i[:, :600] for n, i in capture.images[side].items()}  # type: ignore[index]
        with pytest.raises(CaptureError, match=rf"{side}.*600x480.*640x480"):
            reconstruct(replace(capture, images={**capture.images, side: cut}), ReconstructionOptions())  # type: ignore[dict-item]

    @pytest.mark.parametrize("depth_range", [(600.0, 400.0), (500.0, 500.0), (0.0, 500.0), (-1.0, 5.0)])
    def test_impossible_depth_range(self, depth_range: tuple[float, float]) -> None:
        with pytest.raises(ReconstructionError, match="MIN must be positive and below MAX"):
            reconstruct(plate_before_wall(), ReconstructionOptions(depth_range=depth_range))

    def test_trinocular_without_a_projector(self) -> None:
        capture = plate_before_wall()
        assert capture.rig is not None
        cameras_only = Rig(capture.rig.left, capture.rig.right)
        with pytest.raises(CalibrationError, match="projector"):
            reconstruct(capture, ReconstructionOptions(matching="trinocular"), rig=cameras_only)

    def test_unknown_method_or_matching(self) -> None:
        with pytest.raises(ReconstructionError, match=r"'magic'.*nstep"):
            reconstruct(plate_before_wall(), ReconstructionOptions(method="magic"))  # type: ignore[arg-type]
        with pytest.raises(ReconstructionError, match=r"'quadri'.*trinocular"):
            reconstruct(plate_before_wall(), ReconstructionOptions(matching="quadri"))  # type: ignore[arg-type]

    @pytest.mark.parametrize(
        ("method", "lacking"), [("nstep", "high"), *((m, "composite") for m in SINGLE_SHOT_METHODS)]
    )
    def test_a_capture_without_the_patterns(self, method: Method, lacking: str) -> None:
        capture = plate_before_wall()
        rest = only(capture, capture.plan.kinds - {lacking})  # type: ignore[arg-type]
        with pytest.raises(CaptureError, match=lacking):
            reconstruct(rest, ReconstructionOptions(method))

    @pytest.mark.parametrize("method", DISTINCT)
    def test_a_dark_capture(self, method: Method) -> None:
        """Lens cap on: nothing but the sensor's noise."""
        rng = np.random.default_rng(0)
        capture = plate_before_wall()
        images = {
            side: {n: rng.integers(0, 4, i.shape).astype(i.dtype) for n, i in by.items()}
            for side, by in capture.images.items()
        }
        with pytest.raises(ReconstructionError, match=r"(lamp|exposure)"):
            reconstruct(replace(capture, images=images), ReconstructionOptions(method))

    @pytest.mark.parametrize("method", DISTINCT)
    def test_a_saturated_capture(self, method: Method) -> None:
        with pytest.raises(ReconstructionError, match=r"saturated.*lower the exposure"):
            reconstruct(exposed(plate_before_wall(), 60.0), ReconstructionOptions(method))

    @pytest.mark.parametrize("capture", [objects_before_wall, plate_before_wall], ids=["objects", "plate"])
    @pytest.mark.parametrize("method", DISTINCT)
    def test_swapped_views(self, method: Method, capture) -> None:  # type: ignore[no-untyped-def]
        right_way = capture()
        exchanged = {"left": right_way.images["right"], "right": right_way.images["left"]}
        with pytest.raises(ReconstructionError, match="swapped"):
            reconstruct(replace(right_way, images=exchanged), ReconstructionOptions(method, "trinocular"))

    def test_the_wrong_scene_depth(self) -> None:
        with pytest.raises(ReconstructionError, match="depth range"):
            reconstruct(plate_before_wall(), ReconstructionOptions("nstep", depth_range=(900.0, 2000.0)))

    def test_a_rig_that_cannot_be_rectified(self) -> None:
        capture = plate_before_wall()
        rig = capture.rig
        assert rig is not None
        ahead = Device(rig.right.size, rig.right.matrix, rig.right.distortion, np.eye(3), [0, 0, -100.0], name="right")
        with pytest.raises(CalibrationError, match="rectified"):
            reconstruct(
                capture,
                ReconstructionOptions("nstep", depth_range=(400.0, 670.0)),
                rig=Rig(rig.left, ahead, rig.projector, rig.raster),
            )
