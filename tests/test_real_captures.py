"""Recorded sets of other rigs: what this package makes of them, against figures found independently."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from models.capture import Capture
from models.foreign import import_capture
from models.phase.nstep import NStep
from models.phase.wft import WindowedFourierTransform
from models.points import Reason
from models.reconstruct import Reconstruction, ReconstructionOptions, reconstruct

pytestmark = pytest.mark.realdata
MANIFESTS = Path(__file__).resolve().parents[1] / "examples" / "manifests"


@pytest.fixture(scope="module")
def plaster_head(real_data: Path) -> Capture:
    return import_capture(real_data / "stereo_small_mit", MANIFESTS / "stereo_small_mit.toml")


@pytest.fixture(scope="module")
def result(plaster_head: Capture) -> Reconstruction:
    return reconstruct(plaster_head, ReconstructionOptions("nstep", depth_range=(800.0, 1020.0)))


@pytest.fixture(scope="module")
def head(plaster_head: Capture, result: Reconstruction) -> np.ndarray:
    """The plaster head by its light alone: bright under white and strongly modulated; the cloth is neither."""
    modulation = result.phases["left"].modulation[0].numpy()
    return (plaster_head.stack("left", "white")[0] > 0.2) & (modulation > 0.05)


class TestPlasterHead:
    """Stereo pair, six Gray planes half a fringe fine, one carrier in four steps, JPEG; no projector calibration."""

    def test_the_head_is_decoded(self, result: Reconstruction, head: np.ndarray) -> None:
        """The set's unlit frame was taken under the room's lamps; taking it for black loses half of the head."""
        phase = result.phases["left"]
        assert phase.column is not None
        usable = (phase.mask.numpy() == Reason.VALID) & np.isfinite(phase.column.numpy())
        assert head.mean() > 0.3
        assert usable[head].mean() > 0.99

    def test_decoded_pixels_are_matched(self, result: Reconstruction, head: np.ndarray) -> None:
        phase = result.phases["left"]
        assert phase.column is not None
        usable = head & (phase.mask.numpy() == Reason.VALID) & np.isfinite(phase.column.numpy())
        assert result.points.valid[usable].mean() >= 0.98

    def test_the_head_stands_where_it_stood(self, result: Reconstruction, head: np.ndarray) -> None:
        depth = result.points.depth[head & result.points.valid]
        assert ((depth > 840) & (depth < 980)).mean() > 0.995
        assert np.ptp(np.percentile(depth, [1, 99])) > 80

    def test_the_surface_is_smooth(self, result: Reconstruction, head: np.ndarray) -> None:
        depth = np.where(head, result.points.depth, np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(depth, (5, 5))[::3, ::3]
        whole = np.isfinite(windows).all(axis=(2, 3))
        flat = windows[whole].reshape(-1, 25)
        assert len(flat) > 30_000
        assert np.median(np.abs(flat[:, 12] - np.median(flat, axis=1))) <= 0.3


class TestCompositeFringes:
    """One composite frame against each carrier alone in twelve steps; one camera, periods of 36 and 217 px."""

    @pytest.mark.parametrize(
        ("name", "median", "rms"),
        [("object", (0.025, 0.09), (0.37, 0.29)), ("plane", (0.015, 0.03), (0.15, 0.15))],
    )
    def test_single_shot_phases(
        self, real_data: Path, name: str, median: tuple[float, float], rms: tuple[float, float]
    ) -> None:
        capture = import_capture(real_data / "composite_fringe", MANIFESTS / f"composite_fringe_{name}.toml")
        truth = NStep().extract(capture)["left"]
        single = WindowedFourierTransform().extract(capture)["left"]
        bright = torch.from_numpy(capture.stack("left", "composite")[0]) < 0.998
        lit = (truth.modulation > 0.04).all(dim=0) & (truth.mask == Reason.VALID) & bright
        assert lit.float().mean() > 0.9
        assert (single.mask == Reason.VALID)[lit].float().mean() > 0.99
        for carrier in range(2):
            error = torch.angle(single.carriers[carrier] * truth.carriers[carrier].conj())[lit].abs()
            assert float(error.median()) <= median[carrier]
            assert float(error.square().mean().sqrt()) <= rms[carrier]
