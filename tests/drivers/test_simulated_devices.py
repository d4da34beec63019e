"""The simulated scene before virtual devices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.camera import AppliedSettings, CameraSettings, Trigger
from drivers.devices import RigDevices
from drivers.errors import DeviceConfigurationError, DeviceNotFoundError
from drivers.simulator.devices import SimulatedSource
from drivers.simulator.mix import random_scene
from drivers.simulator.optics import Optics
from drivers.simulator.rig import Observation, SimulatedRig
from drivers.virtual.rig import virtual_rig
from models.geometry.rig import SIDES, Side
from models.patterns import Pattern, make_pattern, make_plan

SEED, SCENE = 3, 2
WHITE, BLACK, COMPOSITE = (make_pattern(name) for name in ("white", "black", "composite"))
PLAN = make_plan("full").restricted_to(["white", "composite", "black"])
USUAL = AppliedSettings(8333.0, 0.0, 8, 255, (640, 480))


@pytest.fixture(scope="module")
def simulated() -> SimulatedRig:
    """One ray a pixel."""
    return SimulatedRig(optics=Optics(footprint=1), threads=1)


@pytest.fixture(scope="module")
def observation(simulated: SimulatedRig) -> Observation:
    return simulated.observe(random_scene(SEED, SCENE, simulated.rig))


@pytest.fixture(scope="module")
def source(simulated: SimulatedRig) -> SimulatedSource:
    return SimulatedSource(SEED, SCENE, simulated)


def image(
    source: SimulatedSource,
    pattern: Pattern | None,
    settings: AppliedSettings = USUAL,
    *,
    side: Side = "left",
    lit_us: float | None = None,
    brightness: float = 1.0,
    shot: int = 0,
) -> np.ndarray:
    if pattern is None:
        return source.view(side, None, settings, brightness=brightness, shot=shot).astype(float)
    lit = settings.exposure_us if lit_us is None else lit_us
    return source.image(side, pattern, settings, lit_us=lit, brightness=brightness, shot=shot).astype(float)


def sequence(devices: RigDevices) -> dict[Side, list[np.ndarray]]:
    devices.projector.load(PLAN, 10_000.0)
    for camera in devices.cameras.values():
        camera.arm(len(PLAN), Trigger.HARDWARE_EDGE)
    devices.projector.start()
    got = {side: [camera.wait_frame(0.0).image for _ in PLAN.patterns] for side, camera in devices.cameras.items()}
    for camera in devices.cameras.values():
        camera.disarm()
    return got


def opened(source: SimulatedSource, settings: CameraSettings | None = None) -> RigDevices:
    devices = virtual_rig(source, realtime=False)
    devices.projector.open()
    for camera in devices.cameras.values():
        camera.open()
        camera.configure(settings or CameraSettings())
    return devices


def test_a_sequence_is_what_the_simulated_rig_exposes(source: SimulatedSource, observation: Observation) -> None:
    """Bit for bit, with the seeds of the first shot."""
    got = sequence(opened(source))
    for side in SIDES:
        for pattern, taken in zip(PLAN.patterns, got[side], strict=True):
            assert (taken == observation.expose(side, pattern, (SEED, SCENE, 0))).all()


def test_two_shots_differ_by_their_noise_only(source: SimulatedSource, observation: Observation) -> None:
    first, second = (image(source, WHITE, shot=shot) for shot in (0, 1))
    difference = second - first
    assert (difference != 0).mean() > 0.2
    assert abs(difference.mean()) < 0.02
    # shot noise at full scale is 255 / sqrt(10,000) = 2.6 levels a shot
    assert np.abs(difference).max() < 8 * 2.6 * np.sqrt(2)
    rendered = observation.expose("left", WHITE, 99).astype(float)
    assert np.abs(rendered - first).mean() < 2.0


def test_a_fresh_source_gives_the_same_series(simulated: SimulatedRig) -> None:
    series = []
    for _ in range(2):
        devices = opened(SimulatedSource(SEED, SCENE, simulated))
        series.append([sequence(devices), sequence(devices)])
    for first, second in zip(*series, strict=True):
        for side in SIDES:
            assert all((a == b).all() for a, b in zip(first[side], second[side], strict=True))
    assert (series[0][0]["left"][0] != series[0][1]["left"][0]).any()


@pytest.mark.parametrize("share", [0.25, 0.5])
@pytest.mark.parametrize("by", ["brightness", "lit_us"])
def test_less_projector_light_leaves_the_ambient_light(source: SimulatedSource, by: str, share: float) -> None:
    dark, full = image(source, None), image(source, WHITE)
    less = image(source, WHITE, **{by: share * (USUAL.exposure_us if by == "lit_us" else 1.0)})
    unsaturated = full < 250
    expected = dark + share * (full - dark)
    assert abs((less - expected)[unsaturated].mean()) < 0.05
    assert dark.mean() < less.mean() < full.mean()


def test_without_light_from_the_projector_everything_is_ambient(source: SimulatedSource) -> None:
    off = image(source, WHITE, brightness=0.0)
    assert abs((off - image(source, None)).mean()) < 0.02


def test_black_lets_a_600th_of_the_light_through(source: SimulatedSource) -> None:
    """Averaged over the lit part, where it is a third of a grey level."""
    many = [image(source, BLACK, shot=s) - image(source, None, shot=s) for s in range(8)]
    white = image(source, WHITE) - image(source, None)
    bright = (white > 60) & (white < 240)
    assert np.mean(many, axis=0)[bright].mean() == pytest.approx(white[bright].mean() / 600, rel=0.25)


@pytest.mark.parametrize(
    ("settings", "factor"),
    [(replace(USUAL, exposure_us=4166.5), 0.5), (replace(USUAL, gain_db=-20 * np.log10(4)), 0.25)],
)
def test_exposure_and_gain_scale_the_reading(source: SimulatedSource, settings: AppliedSettings, factor: float) -> None:
    black_level = 1.0
    usual, other = image(source, COMPOSITE) - black_level, image(source, COMPOSITE, settings) - black_level
    unsaturated = usual < 240
    assert other[unsaturated].mean() == pytest.approx(factor * usual[unsaturated].mean(), rel=0.01)


def test_twelve_bits_show_the_same_finer(source: SimulatedSource) -> None:
    devices = opened(source, CameraSettings(bit_depth=12))
    applied = devices.left.read_settings()
    assert (applied.bit_depth, applied.white_level) == (12, 4095)
    taken = sequence(devices)["left"][0]
    assert taken.dtype == np.uint16
    assert taken.max() > 255
    assert (taken / 4095 * 255).mean() == pytest.approx(image(source, WHITE).mean(), rel=0.01)


def test_the_cameras_limits(source: SimulatedSource) -> None:
    devices = opened(source)
    for wrong in (
        CameraSettings(exposure_us=19.0),
        CameraSettings(exposure_us=350_001.0),
        CameraSettings(gain_db=24.1),
        CameraSettings(gain_db=-0.1),
    ):
        with pytest.raises(DeviceConfigurationError):
            devices.left.configure(wrong)
    assert devices.left.read_settings().exposure_us == 8333.0


def test_what_the_devices_say_of_themselves(source: SimulatedSource, simulated: SimulatedRig) -> None:
    devices = virtual_rig(source)
    infos = [camera.open() for camera in devices.cameras.values()]
    assert [i.serial for i in infos] == ["SIM-left", "SIM-right"]
    projector = devices.projector.open()
    assert {i.origin for i in (*infos, projector)} == {"simulated"}
    assert projector.raster == simulated.raster
    assert projector.stored is None


def test_what_is_known_of_the_scene(source: SimulatedSource, simulated: SimulatedRig, observation: Observation) -> None:
    assert source.calibration == simulated.rig
    assert source.provenance == {"seed": SEED, "scene": SCENE}
    assert source.object_id == observation.scene.object_id
    assert source.truth is not None
    assert np.array_equal(source.truth.depth, observation.truth.depth, equal_nan=True)


def test_scenes_are_numbers_of_the_series(simulated: SimulatedRig) -> None:
    source = SimulatedSource(SEED, 0, simulated)
    assert list(source.scenes) == [str(n) for n in range(12)]
    assert source.place(None) == source.scene == "0"
    assert source.place("0002") == source.scene == "2"
    assert source.place(None) == "2"
    assert source.object_id == random_scene(SEED, 2, simulated.rig).object_id
    first = image(source, WHITE)
    assert source.place("123456") == "123456"
    assert (image(source, WHITE) != first).mean() > 0.3


@pytest.mark.parametrize("name", ["", "-1", "1.5", "1000000", "two", "../2", " 2", "2\n", "٣"])
def test_other_names_are_no_scenes(source: SimulatedSource, name: str) -> None:
    with pytest.raises(DeviceNotFoundError) as caught:
        source.place(name)
    assert len(str(caught.value).splitlines()) == 1
    assert source.scene == str(SCENE)
