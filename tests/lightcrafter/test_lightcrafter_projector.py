"""The LightCrafter before an emulated controller that says which light it really gives."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from lightcrafter_benches import MANIFEST, PLAN, SMALL, controller, quick, usb_projector, usb_transport

from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceNotFoundError,
    DriverError,
    ProtocolError,
    SequenceInvalidError,
)
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.bench import emulated_controller
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.values import HardwareStatus, Release, Run, Validation
from drivers.projector import ProjectorSettings, ProjectorState
from models.patterns import PatternPlan, Raster, make_pattern

SLOW = PLAN.restricted_to(["white", "high_00", "high_01", "gray_00"])
Made = tuple[LightCrafter, EmulatedController]


@pytest.fixture
def make() -> Iterator[Callable[..., Made]]:
    """Makes a closed projector over USB; settings of the controller are told by their names."""
    projectors: list[LightCrafter] = []
    of_controller = {"realtime", "standby", "version", "two_image_quirk", "wake_s", "on_pulse"}

    def made(manifest: FlashManifest = MANIFEST, **settings: object) -> Made:
        emulated = {key: settings.pop(key) for key in list(settings) if key in of_controller}
        device = controller(**emulated)
        projectors.append(usb_projector(device, manifest, **settings))
        return projectors[-1], device

    yield made
    for projector in projectors:
        projector.close()


def play(projector: LightCrafter, device: EmulatedController, plan: PatternPlan = PLAN) -> list[Exposure]:
    """Load, start and step through everything."""
    projector.load(plan, 8600.0)
    projector.start()
    shown = []
    while (exposure := device.step()) is not None:
        shown.append(exposure)
    assert projector.state is ProjectorState.LOADED
    return shown


def assert_shows(shown: list[Exposure], plan: PatternPlan) -> None:
    assert len(shown) == len(plan)
    for exposure, pattern in zip(shown, plan.patterns, strict=True):
        assert np.array_equal(exposure.levels, pattern.render(SMALL)), pattern.name
        assert not exposure.stale


def test_the_mirrors_show_every_pattern_of_the_plan_in_its_order(make: Callable[..., Made]) -> None:
    projector, device = make(realtime=False)
    projector.open()
    for _ in range(2):
        assert_shows(play(projector, device), PLAN)
        assert_shows(play(projector, device, SLOW), SLOW)


@pytest.mark.parametrize("quirk", [True, False])
def test_two_images_come_in_their_order_only_with_the_right_setting(make: Callable[..., Made], quirk: bool) -> None:
    plan = PLAN.restricted_to(["composite", "high_00", "high_01", "high_02"])
    assert len({s.image for s in MANIFEST.patterns if s.pattern in plan.patterns}) == 2
    projector, device = make(realtime=False, two_image_quirk=quirk, swap_two_images=quirk)
    projector.open()
    assert_shows(play(projector, device, plan), plan)
    projector, device = make(realtime=False, two_image_quirk=quirk, swap_two_images=not quirk)
    projector.open()
    wrong = play(projector, device, plan)
    assert not np.array_equal(wrong[0].levels, plan.patterns[0].render(SMALL))


def test_the_controller_is_asked_how_long_an_image_loads(make: Callable[..., Made]) -> None:
    """Believing that it takes no time shows stale images; the measured time does not."""
    projector, device = make(realtime=False, image_load_us=0.0)
    projector.open()
    assert any(exposure.stale for exposure in play(projector, device))
    projector, device = make(realtime=False, image_load_us=None)
    projector.open()
    assert_shows(play(projector, device), PLAN)


def test_a_vertical_fringe_of_the_real_raster_loads_fast() -> None:
    """Four lines that repeat are 11 KB: the whole plan stays near its 8.6 ms."""
    names = ["high_00", "high_01", "high_02", "low_00", "low_01", "low_02"]
    manifest = FlashManifest.packed(PLAN.restricted_to(names))
    device = emulated_controller(manifest, Raster(912, 1140, "diamond"), realtime=False)
    projector = LightCrafter(usb_transport(device)[0], manifest, quick(image_load_us=None))
    projector.open()
    assert projector.load(manifest.plan, 8600.0).pulses_us[1] == 8600.0
    projector.close()


def test_open_tells_what_it_is_and_leaves_it_dark(make: Callable[..., Made]) -> None:
    projector, device = make()
    info = projector.open()
    assert (info.driver, info.firmware, info.serial) == ("lightcrafter", "4.4.0", "USB 1-2")
    assert info.stored == MANIFEST.plan
    assert info.limits.dark_us > 230
    assert not device.light().any()


def test_a_projector_in_standby_is_woken(make: Callable[..., Made]) -> None:
    projector, _ = make(standby=True, wake_s=0.15, timeout_s=0.3)
    assert projector.open().firmware == "4.4.0"
    assert projector.state is ProjectorState.OPEN


def test_old_firmware_is_refused(make: Callable[..., Made]) -> None:
    projector, _ = make(version=Release(2, 9, 9))
    with pytest.raises(DeviceConfigurationError, match=r"firmware cannot be 2\.9\.9; 3\.0\.0 is the oldest"):
        projector.open()
    assert projector.state is ProjectorState.CLOSED


def test_a_broken_dmd_is_told_in_words(make: Callable[..., Made]) -> None:
    projector, device = make()
    device.faults.hardware = 0x04
    with pytest.raises(ProtocolError, match="the DMD reset controller failed; switch it off and on"):
        projector.open()
    device.faults.hardware = 0
    projector.open()


def test_a_flash_with_fewer_images_than_its_manifest_is_refused(make: Callable[..., Made]) -> None:
    projector, _ = make(manifest=FlashManifest.packed(PLAN, first_image=5))
    with pytest.raises(DeviceConfigurationError, match="the flash holds"):
        projector.open()


def test_a_silent_controller_is_not_found(make: Callable[..., Made]) -> None:
    projector, device = make(timeout_s=0.2)
    device.faults.silent.add(c.VERSION.name)
    with pytest.raises(DeviceNotFoundError, match=r"^projector: did not answer 'version'"):
        projector.open()


@pytest.mark.parametrize(("inverted", "expected"), [(True, (180, 195, 193)), (False, (75, 60, 62))])
def test_brightness_is_a_share_of_the_led_limits(
    make: Callable[..., Made], inverted: bool, expected: tuple[int, int, int]
) -> None:
    """Half of 151, 120, 125: 76, 60, 62, taken from 255 where the board inverts."""
    projector, device = make(led_inverted=inverted)
    projector.open()
    projector.configure(ProjectorSettings(brightness=0.5 - 1e-3))
    assert tuple(c.LED_CURRENT.decode(device.handle(c.LED_CURRENT.usb, None))) == expected


def test_a_current_that_reads_back_otherwise_is_told(make: Callable[..., Made]) -> None:
    projector, device = make()
    projector.open()
    device.faults.wrong_currents = True
    with pytest.raises(DeviceConfigurationError, match=r"LED current .* it reads back as \(1, 2, 3\)"):
        projector.configure(ProjectorSettings(brightness=0.5))
    assert projector.state is ProjectorState.OPEN


@pytest.mark.parametrize(
    ("bits", "words"),
    [(Validation.EXPOSURE_INVALID, "exposure or the period"), (Validation.PATTERN_INVALID, "pattern number")],
)
def test_what_validation_refuses_is_told_in_words(make: Callable[..., Made], bits: Validation, words: str) -> None:
    projector, device = make()
    projector.open()
    device.faults.validation = int(bits)
    with pytest.raises(SequenceInvalidError, match=words):
        projector.load(SLOW, 8600.0)
    assert projector.state is ProjectorState.OPEN
    device.faults.validation = 0
    projector.load(SLOW, 8600.0)


def test_what_validation_warns_of_is_logged(make: Callable[..., Made], caplog: pytest.LogCaptureFixture) -> None:
    projector, device = make()
    projector.open()
    device.faults.validation = int(Validation.BLACK_MISSING)
    with caplog.at_level(logging.WARNING):
        projector.load(SLOW, 8600.0)
    assert "no black stands before" in caplog.text


def test_a_validation_that_does_not_end_is_given_up(make: Callable[..., Made]) -> None:
    projector, device = make(validate_s=0.1)
    projector.open()
    device.faults.stuck_validation = True
    with pytest.raises(ProtocolError, match=r"validation within 0\.1 s"):
        projector.load(SLOW, 8600.0)
    assert projector.state is ProjectorState.OPEN


def test_a_mode_that_does_not_change_is_told(make: Callable[..., Made]) -> None:
    projector, device = make(settle_s=0.05)
    device.faults.stuck_mode = True
    with pytest.raises(ProtocolError, match="does not enter its pattern mode"):
        projector.open()


@pytest.mark.parametrize("old_error", [0, HardwareStatus.SEQUENCE_ERROR])
def test_a_start_that_is_ignored_once_is_repeated(make: Callable[..., Made], old_error: int) -> None:
    """An error that the status has kept from before is not this sequence's."""
    projector, device = make(settle_s=0.1)
    device.faults.hardware = old_error
    projector.open()
    loaded = projector.load(SLOW, 60_000.0)
    device.faults.deaf_starts = 1
    projector.start()
    wait_for_end(projector)
    assert device.pulses_sent == len(loaded.plan)


def test_a_start_that_is_ignored_twice_is_an_error(make: Callable[..., Made]) -> None:
    projector, device = make(settle_s=0.05)
    projector.open()
    projector.load(SLOW, 60_000.0)
    device.faults.deaf_starts = 2
    with pytest.raises(ProtocolError, match="shows nothing"):
        projector.start()
    assert projector.state is ProjectorState.LOADED
    projector.start()
    wait_for_end(projector)
    assert device.pulses_sent == len(SLOW)


def test_a_sequence_that_ends_before_anyone_looks_is_not_started_twice(make: Callable[..., Made]) -> None:
    """Each answer takes longer than the whole sequence."""
    projector, device = make()
    projector.open()
    white = PLAN.restricted_to(["white"])
    projector.load(white, 8600.0)
    device.faults.delay_s = 0.03
    projector.start()
    device.faults.delay_s = 0.0
    wait_for_end(projector)
    assert device.pulses_sent == 1


def test_a_sequencer_that_reports_an_error_is_quoted(make: Callable[..., Made]) -> None:
    projector, device = make()
    projector.open()
    projector.load(SLOW, 60_000.0)
    device.handle(c.RUN.usb, bytes([Run.STOP]))
    with pytest.raises(ProtocolError, match="the sequencer met an error"):
        projector.start()
    assert projector.state is ProjectorState.LOADED
    projector.start()
    assert projector.state is ProjectorState.PROJECTING


def test_a_held_pattern_in_pattern_mode_has_the_light_of_a_sequence(make: Callable[..., Made]) -> None:
    """At the price of one pulse."""
    projector, device = make()
    projector.open()
    for name in ("white", "high_03", "gray_02", "black"):
        pattern = next(p for p in PLAN.patterns if p.name == name)
        before = device.pulses_sent
        projector.show(pattern)
        assert projector.state is ProjectorState.HOLDING
        assert wait_until(lambda before=before: device.pulses_sent > before)
        time.sleep(0.03)
        assert device.pulses_sent == before + 1
        expected = pattern.render(SMALL)[..., None] * np.array([151, 120, 125]) / 255
        assert np.allclose(device.light(), expected)
    projector.show(None)
    assert not device.light().any()
    assert projector.state is ProjectorState.OPEN


def test_a_held_pattern_in_video_mode_is_the_light_of_one_led(make: Callable[..., Made]) -> None:
    projector, device = make(hold="video")
    projector.open()
    for stored in MANIFEST.patterns:
        if stored.depth == 8:
            projector.show(stored.pattern)
            lit = (1, 0, 2)[stored.number]
            expected = np.zeros((*stored.pattern.render(SMALL).shape, 3))
            expected[..., lit] = stored.pattern.render(SMALL).astype(float) * (151, 120, 125)[lit] / 255
            assert np.allclose(device.light(), expected), stored.pattern.name
    projector.show(PLAN.patterns[0])
    assert np.allclose(device.light(), np.array([151, 120, 125]))
    projector.show(PLAN.patterns[-1])
    assert projector.state is ProjectorState.HOLDING
    assert not device.light().any()
    with pytest.raises(SequenceInvalidError, match="'gray_00' is one bit of an image"):
        projector.show(make_pattern("gray_00"))
    projector.show(None)
    assert not device.light().any()
    assert device.pulses_sent == 0
    assert projector.configure(ProjectorSettings(brightness=1.0)).brightness == 1.0


def test_brightness_of_a_held_still_lights_no_other_led(make: Callable[..., Made]) -> None:
    projector, device = make(hold="video")
    projector.open()
    projector.show(next(p for p in PLAN.patterns if p.name == "high_03"))
    lit = device.light().max(axis=(0, 1)) > 0
    assert projector.configure(ProjectorSettings(brightness=0.5)).brightness == pytest.approx(0.5, abs=0.01)
    assert np.array_equal(device.light().max(axis=(0, 1)) > 0, lit)
    projector.load(SLOW, 8600.0)
    assert all(current != 255 for current in device.handle(c.LED_CURRENT.usb, None))


def test_a_refused_plan_leaves_the_held_pattern_alone(make: Callable[..., Made]) -> None:
    projector, device = make()
    projector.open()
    projector.show(PLAN.patterns[0])
    assert wait_until(lambda: bool(device.light().any()))
    with pytest.raises(SequenceInvalidError):
        projector.load(PatternPlan(patterns=()), 8600.0)
    assert projector.state is ProjectorState.HOLDING
    assert device.light().any()


@pytest.mark.parametrize("refused", [True, False])
def test_a_controller_that_does_not_tell_load_times_is_given_the_longest(
    make: Callable[..., Made], refused: bool
) -> None:
    projector, device = make(image_load_us=None, settle_s=0.05)
    projector.open()
    if refused:
        device.faults.refused.add(c.IMAGE_LOAD_TIME.name)
    else:
        device.faults.no_load_times = True
    assert projector.load(SLOW, 8600.0).pulses_us[1] == 200_000.0


@pytest.mark.parametrize("hold", ["video", "sequence"])
def test_close_leaves_it_dark(make: Callable[..., Made], hold: str) -> None:
    projector, device = make(hold=hold)
    projector.open()
    projector.show(PLAN.patterns[0])
    assert wait_until(lambda: bool(device.light().any()))
    projector.close()
    assert not device.light().any()
    assert not device.running


def test_a_projector_that_dies_while_it_projects_says_so(make: Callable[..., Made]) -> None:
    projector, device = make()
    projector.open()
    projector.load(SLOW, 100_000.0)
    projector.start()
    device.unplug()
    assert projector.state is ProjectorState.FAULT
    with pytest.raises(DeviceLostError):
        projector.load(SLOW, 8600.0)
    projector.stop()
    projector.close()
    device.plug()
    projector.open()


@pytest.mark.parametrize("leave", ["stop", "close"])
def test_a_lost_answer_does_not_leave_the_light_on(make: Callable[..., Made], leave: str) -> None:
    projector, device = make(timeout_s=0.3)
    projector.open()
    projector.load(SLOW, 2_000_000.0)
    projector.start()
    device.faults.silent.add(c.MAIN_STATUS.name)
    assert projector.state is ProjectorState.FAULT
    device.faults.silent.clear()
    assert device.running
    getattr(projector, leave)()
    assert not device.running
    assert not device.light().any()


def test_a_failure_while_opening_lets_go_of_the_device(make: Callable[..., Made]) -> None:
    projector, device = make()
    device.faults.refused.add(c.LED_ENABLE.name)
    with pytest.raises(DriverError, match="refused 'LED enable'"):
        projector.open()
    device.faults.refused.clear()
    projector.open()


def wait_until(condition: Callable[[], bool], patience_s: float = 2.0) -> bool:
    deadline = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.002)
    return True


def wait_for_end(projector: LightCrafter) -> None:
    assert wait_until(lambda: projector.state is ProjectorState.LOADED)
