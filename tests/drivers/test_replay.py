"""Recorded captures before virtual devices: the same images in the same order, and nothing invented."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded import PLAN, SHAPE, recorded_image, write

from drivers.camera import AppliedSettings, CameraSettings, SoftwareTriggered, Trigger
from drivers.devices import RigDevices
from drivers.errors import DeviceNotFoundError, SequenceInvalidError
from drivers.projector import ProjectorLimits, ProjectorSettings
from drivers.replay.source import ReplaySource
from drivers.virtual.faults import PlantedFault
from drivers.virtual.rig import bench_of, virtual_rig
from models.capture import Image, Truth
from models.errors import CaptureError
from models.geometry.rig import SIDES, Rig, Side
from models.patterns import FringeParameters, PatternPlan, make_pattern, make_plan

SETTINGS = AppliedSettings(8333.0, 0.0, 8, 255, SHAPE[::-1])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("b", "a", "c"):
        write(tmp_path, name)
    return tmp_path


def opened(source: ReplaySource, settings: CameraSettings | None = None) -> RigDevices:
    devices = virtual_rig(source, realtime=False)
    devices.projector.open()
    for camera in devices.cameras.values():
        camera.open()
        camera.configure(settings or CameraSettings())
    return devices


def play(devices: RigDevices, plan: PatternPlan) -> dict[Side, dict[str, Image]]:
    """One sequence, every image under the name of its pattern."""
    devices.projector.load(plan, 10_000.0)
    for camera in devices.cameras.values():
        camera.arm(len(plan), Trigger.HARDWARE_EDGE)
    devices.projector.start()
    got = {side: {n: camera.wait_frame(0.0).image for n in plan.names} for side, camera in devices.cameras.items()}
    for camera in devices.cameras.values():
        camera.disarm()
    return got


def assert_recorded(got: dict[Side, dict[str, Image]], name: str, bits: int = 8) -> None:
    for side in SIDES:
        for pattern, image in got[side].items():
            expected = recorded_image(name, side, pattern, bits)
            assert image.dtype == expected.dtype
            assert (image == expected).all()


def test_captures_come_bit_for_bit_in_name_order_and_round_again(folder: Path) -> None:
    source = ReplaySource(folder)
    devices = opened(source)
    names = []
    for _ in range(4):
        names.append(source.place())
        assert_recorded(play(devices, PLAN), names[-1])
    assert names == ["a", "b", "c", "a"]
    assert source.scenes == ("a", "b", "c")


def test_a_named_capture_is_placed_and_the_round_goes_on_from_it(folder: Path) -> None:
    source = ReplaySource(folder)
    assert source.scene == "a"
    assert source.place("b") == "b"
    assert [source.place() for _ in range(2)] == ["c", "a"]
    assert source.place("a") == "a"
    assert source.place() == "b"


@pytest.mark.parametrize("name", ["d", "", "../a", "a/", "./a", "a/../b", "/etc", "a\n"])
def test_only_names_of_the_folder_are_placed(folder: Path, name: str) -> None:
    source = ReplaySource(folder)
    with pytest.raises(DeviceNotFoundError) as caught:
        source.place(name)
    assert len(str(caught.value).splitlines()) == 1
    assert source.scene == "a"


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_images_do_not_heed_the_settings_and_their_depth_is_told(tmp_path: Path, bits: int) -> None:
    write(tmp_path, "only", bits=bits)
    asked = CameraSettings(exposure_us=100.0, gain_db=12.0, bit_depth=12)
    devices = opened(ReplaySource(tmp_path), asked)
    devices.projector.configure(ProjectorSettings(brightness=0.1))
    assert_recorded(play(devices, PLAN), "only", bits)
    applied = devices.left.read_settings()
    assert (applied.bit_depth, applied.white_level, applied.size) == (bits, 2**bits - 1, SHAPE[::-1])
    assert (applied.exposure_us, applied.gain_db) == (100.0, 12.0)


def test_a_receiver_that_writes_into_a_frame_does_not_change_the_recording(folder: Path) -> None:
    devices = opened(ReplaySource(folder))
    for image in play(devices, PLAN)["left"].values():
        image[:] = 0
    assert_recorded(play(devices, PLAN), "a")


def test_devices_are_the_recorded_ones_replayed(folder: Path) -> None:
    devices = virtual_rig(ReplaySource(folder))
    left, projector = devices.left.open(), devices.projector.open()
    assert (left.driver, left.model, left.serial, left.firmware) == ("replay", "GS3 left", "left-77", "2.1")
    assert (projector.driver, projector.model, projector.serial) == ("replay", "GS3 projector", "projector-77")
    assert left.origin == projector.origin == "replayed"
    assert left.size == SHAPE[::-1]
    assert projector.raster is None
    assert projector.stored == PLAN


def test_what_is_known_of_the_capture(tmp_path: Path, rig: Rig) -> None:
    depth = np.full(SHAPE, 500, np.float32)
    write(tmp_path, "known", rig=rig, truth=Truth(depth, depth, depth > 0))
    source = ReplaySource(tmp_path)
    assert source.object_id == "vase"
    assert source.truth is not None
    assert (source.truth.depth == depth).all()
    assert source.calibration == rig
    assert source.projector_info.raster == rig.raster
    provenance = source.provenance
    assert provenance["replayed"] == "known"
    assert provenance["id"] == "id of known"
    assert provenance["created"] == "2024-05-06T00:00:00Z"
    assert provenance["settings"] == {"exposure_us": 8333.0}
    assert provenance["warnings"] == ["left: dusty"]
    assert provenance["devices"][0]["origin"] == "real"


def test_without_a_record_there_is_nothing_to_tell(tmp_path: Path) -> None:
    (write(tmp_path, "bare") / "capture.json").unlink()
    source = ReplaySource(tmp_path / "bare")
    assert source.provenance["created"] is None
    assert source.calibration is None
    info = source.camera_info("left")
    assert (info.model, info.serial) == ("", "")
    assert_recorded(play(opened(source), PLAN), "bare")


def test_an_exposure_that_was_not_recorded_gets_the_usual_one(tmp_path: Path) -> None:
    plan = make_plan("composite", FringeParameters(exposure_us=None))
    write(tmp_path, "a", plan)
    source = ReplaySource(tmp_path)
    stored = source.projector_info.stored
    assert stored is not None
    assert [p.exposure_us for p in stored.patterns] == [8333.0]
    assert_recorded(play(opened(source), stored), "a")


def test_a_recorded_exposure_that_is_too_short_for_a_projector_can_be_replayed(tmp_path: Path) -> None:
    """As in recordings of a projector that switches patterns by video."""
    plan = make_plan("composite", FringeParameters(exposure_us=4000.0))
    write(tmp_path, "a", plan)
    source = ReplaySource(tmp_path)
    assert source.projector_info.stored == plan
    assert_recorded(play(opened(source), plan), "a")


def test_usual_recordings_have_the_usual_limits(folder: Path) -> None:
    assert ReplaySource(folder).projector_info.limits == ProjectorLimits()


def test_other_exposures_of_a_recorded_pattern_are_taken_and_other_parameters_are_not(folder: Path) -> None:
    devices = opened(ReplaySource(folder))
    longer = PatternPlan(patterns=tuple(p.model_copy(update={"exposure_us": 9000.0}) for p in PLAN.patterns))
    assert_recorded(play(devices, longer), "a")
    other = make_plan("composite", FringeParameters(periods=(10.0, 15.0)))
    with pytest.raises(SequenceInvalidError, match="composite"):
        devices.projector.load(other, 10_000.0)
    with pytest.raises(SequenceInvalidError, match="high_03"):
        devices.projector.show(make_pattern("high_03"))


def test_a_pattern_that_the_next_capture_lacks_is_never_shown_instead(tmp_path: Path) -> None:
    write(tmp_path, "a")
    write(tmp_path, "b", PLAN.restricted_to(["composite"]))
    source = ReplaySource(tmp_path)
    devices = opened(source)
    devices.projector.load(PLAN, 10_000.0)
    devices.left.arm(3, Trigger.HARDWARE_EDGE)
    source.place("b")
    assert devices.projector.info.stored is not None
    assert devices.projector.info.stored.names == ("composite",)
    with pytest.raises(SequenceInvalidError, match="white"):
        devices.projector.start()
    with pytest.raises(CaptureError, match="white"):
        source.image("left", PLAN.patterns[0], SETTINGS, lit_us=1.0, brightness=1.0, shot=0)


def test_a_capture_placed_after_arming_is_the_one_that_is_shown(folder: Path) -> None:
    source = ReplaySource(folder)
    devices = opened(source)
    devices.projector.load(PLAN, 10_000.0)
    for camera in devices.cameras.values():
        camera.arm(len(PLAN), Trigger.HARDWARE_EDGE)
    source.place("c")
    devices.projector.start()
    assert (devices.left.wait_frame(0.0).image == recorded_image("c", "left", "white")).all()


@pytest.mark.parametrize(
    ("kinds", "dark", "held"),
    [
        (["white", "composite", "black"], "black", "white"),
        (["white", "composite"], "white", "white"),
        (["composite"], "composite", "composite"),
        ([f"high_{k:02d}" for k in range(9)], "high_00", "high_00"),
    ],
)
def test_the_live_view_shows_the_nearest_recording(tmp_path: Path, kinds: list[str], dark: str, held: str) -> None:
    write(tmp_path, "a", make_plan("full").restricted_to(kinds))
    source = ReplaySource(tmp_path)
    devices = opened(source)
    devices.right.arm(None, Trigger.FREE_RUN)
    assert (devices.right.wait_frame(1.0).image == recorded_image("a", "right", dark)).all()
    devices.right.disarm()
    unrecorded = make_pattern("gray_03")
    view = source.view("right", unrecorded, SETTINGS, brightness=1.0, shot=0)
    assert (view == recorded_image("a", "right", held)).all()
    last = source.projector_info.stored
    assert last is not None
    devices.projector.show(last.patterns[-1])
    devices.right.arm(1, Trigger.SOFTWARE)
    assert isinstance(devices.right, SoftwareTriggered)
    devices.right.software_trigger()
    assert (devices.right.wait_frame(1.0).image == recorded_image("a", "right", last.names[-1])).all()


def test_a_planted_fault_strikes_recordings_too(folder: Path) -> None:
    devices = opened(ReplaySource(folder))
    bench_of(devices).plant(PlantedFault("moved", side="left", shift_px=3))
    got = play(devices, PLAN)
    assert (got["left"]["white"] == np.roll(recorded_image("a", "left", "white"), 3, axis=1)).all()
    assert (got["right"]["white"] == recorded_image("a", "right", "white")).all()
    assert_recorded(play(devices, PLAN), "a")
