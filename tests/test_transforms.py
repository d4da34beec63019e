"""The transform methods: against planes of known phase and the simulator's columns, and what all single shots share."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch
from simulated_captures import exposed, objects_before_wall, only, plate_before_wall

from benchmarks import select_transforms
from models.capture import Capture, CaptureRecord
from models.errors import CaptureError
from models.patterns import Pattern, PatternPlan
from models.phase.atoms import Columns
from models.phase.fringe import FringePhase
from models.phase.ridge import ridge
from models.phase.shearlet import Shearlet
from models.phase.single_exposure import SingleExposure
from models.phase.transform_settings import PATH, chosen_settings
from models.phase.wavelet1d import Wavelet1d, Wavelet1dSettings
from models.phase.wavelet2d import Wavelet2d, Wavelet2dSettings
from models.phase.wft import WindowedFourierTransform
from models.points import Reason

PERIODS = (9.0, 14.0)
Method = type[WindowedFourierTransform | Wavelet1d | Wavelet2d | Shearlet]
TRANSFORMS: list[Method] = [Wavelet1d, Wavelet2d, Shearlet]
SINGLE_SHOTS: list[Method] = [WindowedFourierTransform, *TRANSFORMS]
each_transform = pytest.mark.parametrize("method", TRANSFORMS, ids=lambda m: m.__name__)
each_single_shot = pytest.mark.parametrize("method", SINGLE_SHOTS, ids=lambda m: m.__name__)


def view(column: np.ndarray, gain: np.ndarray | float = 0.6, **pattern: object) -> Capture:
    """One composite exposure at the given columns (H, W), twelve bits."""
    shot = Pattern.model_validate({"name": "composite", "kind": "composite", "period": PERIODS, **pattern})
    image = np.rint(4095 * np.clip(0.02 + gain * shot.evaluate(column) / 255, 0, 1)).astype(np.uint16)
    return Capture(PatternPlan(patterns=(shot,)), {"left": {"composite": image}}, record=CaptureRecord(bit_depth=12))


def plane(slope: float = 1.05, tilt: float = 0.1) -> np.ndarray:
    y, x = np.mgrid[0:240, 0:320].astype(float)
    return slope * x + tilt * y


@lru_cache(maxsize=32)
def extracted(method: Method, scene: Callable[[], Capture]) -> dict[str, FringePhase]:
    capture = only(scene(), {"composite"})
    return dict(method(capture.rig).extract(capture))


def for_planes(method: Method) -> SingleExposure:
    """With windows that part the carriers and a dense bank; the chosen windows are shorter, to follow objects."""
    if method is Wavelet1d:
        return Wavelet1d(settings=Wavelet1dSettings(**{**chosen_settings("wavelet1d"), "window": 0.9}))
    if method is Wavelet2d:
        return Wavelet2d(
            settings=Wavelet2dSettings(**{**chosen_settings("wavelet2d"), "window": 0.9, "orientations": 5})
        )
    return method()


def errors_inside(phase: FringePhase, column: np.ndarray) -> np.ndarray:
    """Phase errors (2, h, w), rad, three low fringes from the borders."""
    expected = np.stack([np.exp(2j * np.pi * column / p) for p in phase.periods])
    return np.angle(phase.carriers.numpy() * expected.conj())[:, 40:-40, 40:-40]


@each_transform
@pytest.mark.parametrize("slope", [0.95, 1.05, 1.2])
def test_phase_and_modulation_of_a_plane(method: Method, slope: float) -> None:
    column = plane(slope)
    phase = for_planes(method).extract(view(column))["left"]
    assert np.sqrt((errors_inside(phase, column) ** 2).mean(axis=(1, 2))).max() < 0.05
    modulation = phase.modulation.numpy()[:, 40:-40, 40:-40].mean(axis=(1, 2))
    assert modulation == pytest.approx([0.6 * 63.75 / 255] * 2, rel=0.05)
    assert np.median(phase.texture.numpy()) == pytest.approx(0.02 + 0.3, abs=0.01)


@each_transform
def test_chosen_settings_on_a_plane(method: Method) -> None:
    phase = method().extract(view(plane()))["left"]
    assert np.sqrt((errors_inside(phase, plane()) ** 2).mean(axis=(1, 2))).max() < 0.12
    modulation = phase.modulation.numpy()[:, 40:-40, 40:-40].mean(axis=(1, 2))
    assert modulation == pytest.approx([0.6 * 63.75 / 255] * 2, rel=0.15)


@each_transform
def test_each_carrier_is_found_without_the_other(method: Method) -> None:
    """What one carrier's field holds of the other, at the other's own frequency."""
    column = plane(1.05, 0.0)
    carriers = for_planes(method).extract(view(column))["left"].carriers.numpy()[:, 40:-40, 40:-40]
    waves = np.stack([np.exp(2j * np.pi * column / p) for p in PERIODS])[:, 40:-40, 40:-40]
    # Whole beats of both carriers (126 columns are 120 px), so that they are orthogonal over the patch.
    heard = np.abs((carriers[:, None] * waves.conj()[None])[..., :120].mean(axis=(2, 3)))
    assert heard[0, 1] < 0.03 * heard[1, 1]
    assert heard[1, 0] < 0.03 * heard[0, 0]


@each_transform
@pytest.mark.parametrize("offsets", [(0.7, -2.1), (math.pi, 1.0)])
def test_offsets_of_the_pattern_are_taken_off(method: Method, offsets: tuple[float, float]) -> None:
    column = plane()
    phase = for_planes(method).extract(view(column, phase_offset=offsets))["left"]
    assert np.sqrt((errors_inside(phase, column) ** 2).mean()) < 0.05


@each_single_shot
def test_brightness_scales_the_modulation_not_the_phase(method: Method) -> None:
    full = extracted(method, plate_before_wall)["left"]
    capture = only(exposed(plate_before_wall(), 0.5), {"composite"})
    dim = method(capture.rig).extract(capture)["left"]
    both = (dim.mask == Reason.VALID) & (full.mask == Reason.VALID)
    assert both.float().mean() > 0.8
    assert float(torch.angle(dim.carriers * full.carriers.conj())[:, both].abs().median()) < 0.05
    assert float((dim.modulation / full.modulation)[:, both].median()) == pytest.approx(0.5, rel=0.05)


@each_single_shot
def test_what_the_light_does_not_reach_has_no_phase(method: Method) -> None:
    gain = np.full((240, 320), 0.6)
    gain[:, 200:] = 0.0
    phase = method().extract(view(plane(), gain))["left"]
    mask = phase.mask.numpy()
    assert (mask[40:-40, 40:160] == Reason.VALID).mean() > 0.99
    # Four fringes off; nearer, what an atom or a shearlet smears over the edge is a weak phase that looks sound.
    assert np.isin(mask[:, 255:300], (Reason.UNLIT, Reason.LOW_MODULATION)).mean() > 0.8
    assert phase.modulation.numpy()[:, :, 240:].mean() < 0.02 * phase.modulation.numpy()[:, :, :160].mean()


@each_single_shot
def test_saturated_pixels_are_told(method: Method) -> None:
    capture = view(plane(), 1.2)
    image = capture.stack("left", "composite")[0]
    mask = method().extract(capture)["left"].mask.numpy()
    assert (image >= 1.0).sum() > 500
    assert (mask[image >= 1.0] == Reason.SATURATED).all()


@each_single_shot
def test_two_views_at_once_are_as_one_by_one(method: Method) -> None:
    capture = only(plate_before_wall(), {"composite"})
    pair = extracted(method, plate_before_wall)
    for side in capture.sides:
        alone = method(capture.rig).extract(replace(capture, images={side: capture.images[side]}))[side]
        assert torch.equal(alone.carriers, pair[side].carriers)
        assert torch.equal(alone.mask, pair[side].mask)


@each_single_shot
def test_views_of_different_sizes(method: Method) -> None:
    left, right = view(plane()), view(plane()[:200, :300])
    images = {"left": left.images["left"], "right": right.images["left"]}
    phases = method().extract(replace(left, images=images))  # type: ignore[arg-type]
    assert list(phases) == ["left", "right"]
    assert np.sqrt((errors_inside(phases["right"], plane()[:200, :300]) ** 2).mean()) < 0.12


@each_single_shot
def test_arrays_of_the_result(method: Method) -> None:
    for phase in extracted(method, objects_before_wall).values():
        assert phase.carriers.shape == (2, 480, 640)
        assert phase.misfit is not None
        assert phase.texture.shape == phase.mask.shape == phase.misfit.shape == (480, 640)
        assert phase.carriers.dtype == torch.complex64
        assert phase.texture.dtype == phase.misfit.dtype == torch.float32
        assert phase.mask.dtype == torch.uint8
        assert phase.periods == PERIODS
        assert phase.column is None
        assert torch.isfinite(phase.carriers.abs()).all()
        assert torch.isfinite(phase.texture).all()
        assert set(phase.mask.unique().tolist()) <= {
            Reason.VALID,
            Reason.UNLIT,
            Reason.LOW_MODULATION,
            Reason.SATURATED,
        }


@each_single_shot
def test_two_runs_give_the_same_bits(method: Method) -> None:
    capture = view(plane())
    once, again = (method().extract(capture)["left"] for _ in range(2))
    assert torch.equal(once.carriers, again.carriers)
    assert torch.equal(once.mask, again.mask)


@each_single_shot
def test_a_capture_without_a_composite_is_refused(method: Method) -> None:
    assert isinstance(method(), SingleExposure)
    with pytest.raises(CaptureError, match=f"method {method().name} needs the pattern groups composite"):
        method().extract(only(plate_before_wall(), {"high", "low"}))


@pytest.mark.parametrize(
    ("method", "least"), [(WindowedFourierTransform, 0.75), (Wavelet1d, 0.8), (Wavelet2d, 0.8), (Shearlet, 0.6)]
)
@pytest.mark.parametrize("scene", [objects_before_wall, plate_before_wall], ids=["objects", "plate"])
def test_most_phases_of_simulated_scenes_are_right(method: Method, least: float, scene: Callable[[], Capture]) -> None:
    high, low, kept = select_transforms.shares(scene(), extracted(method, scene)["left"])
    assert high >= least
    assert low >= least
    assert kept >= 0.9


def test_the_ridge_lies_between_the_atoms() -> None:
    """Answers of a parabola's shape, peaking between the atoms, in a turned complex plane."""
    r, t = np.mgrid[0:5, 0:4]
    modulus = 1 - 0.03 * (r - 2.3) ** 2 - 0.05 * (t - 1.6) ** 2
    answers = torch.tensor(modulus * np.exp(0.8j), dtype=torch.complex64)[..., None, None]
    (found,) = ridge(answers).flatten().tolist()
    assert found == pytest.approx(np.exp(0.8j), abs=1e-5)


@pytest.mark.parametrize("place", [0, 4])
def test_the_ridge_does_not_leave_the_bank(place: int) -> None:
    """Answers that still grow at an end of the bank: the end's own answer counts."""
    answers = torch.zeros(5, 1, 1, 1, dtype=torch.complex64)
    answers[:, 0, 0, 0] = torch.exp(-(torch.arange(5.0) - place).abs())
    assert float(ridge(answers).abs()) == pytest.approx(1.0, abs=1e-6)


def test_columns_of_a_band() -> None:
    columns = Columns(100, (0.5, 1.0))
    assert columns.zeta[0] <= 0.5 < columns.zeta[1]
    assert columns.zeta[-2] < 1.0 <= columns.zeta[-1]
    beyond = Columns(100, (-0.2, 9.0))  # neither the mean nor negative frequencies belong to an analytic atom
    assert (beyond.first, beyond.last) == (1, 50)


def test_stored_settings_are_from_the_grids_and_not_from_the_published_scenes() -> None:
    stored = json.loads(PATH.read_text(encoding="utf-8"))
    assert stored["scenes"].get("seed") != select_transforms.PUBLISHED_SEED
    for name, grid in select_transforms.GRIDS.items():
        assert chosen_settings(name) == stored["methods"][name]["settings"]
        assert chosen_settings(name) in list(select_transforms.combinations(grid))
        assert stored["methods"][name]["figures"]["high_percent"] > 50


class TestSelection:
    def arguments(self, monkeypatch: pytest.MonkeyPatch, *words: object) -> None:
        monkeypatch.setattr("sys.argv", ["select_transforms", *map(str, words)])

    def test_published_scenes_are_refused(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        self.arguments(monkeypatch, "--seed", select_transforms.PUBLISHED_SEED)
        with pytest.raises(SystemExit):
            select_transforms.main()
        assert "kept for the published tables" in capsys.readouterr().err

    def test_the_best_of_the_grid_is_stored(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """A grid of a good and a hopeless setting each."""
        one = {
            name: {key: (value,) for key, value in chosen_settings(name).items()} for name in select_transforms.GRIDS
        }
        one["wavelet1d"]["window"] = (0.05, one["wavelet1d"]["window"][0])
        monkeypatch.setattr(select_transforms, "GRIDS", one)
        monkeypatch.setattr(select_transforms, "PATH", tmp_path / "chosen.json")
        monkeypatch.setattr(
            select_transforms, "validation_scenes", lambda options: [only(plate_before_wall(), {"composite"})]
        )
        self.arguments(monkeypatch, "--seed", 5, "--json")
        select_transforms.main()
        told = json.loads(capsys.readouterr().out)
        stored = json.loads((tmp_path / "chosen.json").read_text())
        assert stored["methods"]["wavelet1d"]["settings"] == chosen_settings("wavelet1d")
        assert told["results"]["wavelet1d"]["high_percent"] > 80
        assert set(told["results"]) == {"wft", "wavelet1d", "wavelet2d", "shearlet"}
