"""The LightCrafter before an emulated controller that does something wrong."""

from __future__ import annotations

import logging
from collections.abc import Callable

import pytest
from lightcrafter_benches import PLAN, SLOW, Made, wait_for_end

from drivers.errors import (
    DeviceConfigurationError,
    DeviceLostError,
    DeviceNotFoundError,
    DriverError,
    ProtocolError,
    SequenceInvalidError,
)
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.values import HardwareStatus, Release, Run, Validation
from drivers.projector import ProjectorSettings, ProjectorState


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
