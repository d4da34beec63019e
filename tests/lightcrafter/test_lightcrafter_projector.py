"""The LightCrafter before an emulated controller that says which light it really gives."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from lightcrafter_benches import MANIFEST, PLAN, SLOW, SMALL, Made, quick, usb_transport, wait_until

from drivers.errors import (
    SequenceInvalidError,
)
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.bench import emulated_controller
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.player import Exposure
from drivers.lightcrafter.manifest import FlashManifest
from drivers.lightcrafter.projector import LightCrafter
from drivers.projector import ProjectorSettings, ProjectorState
from models.patterns import PatternPlan, Raster, make_pattern


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


@pytest.mark.parametrize(("inverted", "expected"), [(True, (180, 195, 193)), (False, (75, 60, 62))])
def test_brightness_is_a_share_of_the_led_limits(
    make: Callable[..., Made], inverted: bool, expected: tuple[int, int, int]
) -> None:
    """Half of 151, 120, 125: 76, 60, 62, taken from 255 where the board inverts."""
    projector, device = make(led_inverted=inverted)
    projector.open()
    projector.configure(ProjectorSettings(brightness=0.5 - 1e-3))
    assert tuple(c.LED_CURRENT.decode(device.handle(c.LED_CURRENT.usb, None))) == expected


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


@pytest.mark.parametrize("hold", ["video", "sequence"])
def test_close_leaves_it_dark(make: Callable[..., Made], hold: str) -> None:
    projector, device = make(hold=hold)
    projector.open()
    projector.show(PLAN.patterns[0])
    assert wait_until(lambda: bool(device.light().any()))
    projector.close()
    assert not device.light().any()
    assert not device.running
