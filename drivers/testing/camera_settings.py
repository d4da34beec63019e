"""Settings of a camera: limits, reading back, refusing."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.camera import Camera, CameraLimits, CameraSettings, CameraState, EdgeTriggered, Trigger, supported_triggers
from drivers.errors import DeviceConfigurationError
from drivers.testing.bench import CameraBench, as_asked, short_settings
from drivers.testing.expect import assert_state, refused

_SNAPPING = 0.01
"""How far a setting may move to the camera's next step: share of an exposure."""
_GAIN_STEP_DB = 0.1


class CameraConfiguration:
    """What ``configure`` takes, refuses and reads back."""

    def test_settings_read_back_as_applied(self, camera: Camera) -> None:
        info = camera.open()
        asked = short_settings(info.limits)
        applied = camera.configure(asked)
        assert camera.read_settings() == applied
        assert applied.exposure_us == pytest.approx(asked.exposure_us, rel=_SNAPPING)
        assert applied.gain_db == pytest.approx(asked.gain_db, abs=_GAIN_STEP_DB)
        assert applied.bit_depth == asked.bit_depth or info.origin == "replayed"
        assert applied.size == info.size
        assert 0 < applied.white_level < (256 if applied.bit_depth == 8 else 65536)

    def test_applied_settings_stay_when_asked_again(self, camera: Camera, bench: CameraBench) -> None:
        """Snapping to the camera's steps happens once."""
        applied = bench.configured()
        assert camera.configure(as_asked(applied)) == applied

    def test_settings_are_held_while_armed(self, camera: Camera, bench: CameraBench) -> None:
        applied = bench.armed(bench.quiet_trigger())
        assert camera.read_settings() == applied
        camera.disarm()
        assert camera.read_settings() == applied

    @pytest.mark.parametrize("end", [0, 1], ids=["smallest", "largest"])
    def test_limits_are_taken(self, camera: Camera, end: int) -> None:
        limits = camera.open().limits
        asked = CameraSettings(
            exposure_us=limits.exposure_us[end], gain_db=limits.gain_db[end], bit_depth=limits.bit_depths[end - 1]
        )
        applied = camera.configure(asked)
        assert_state(camera, CameraState.CONFIGURED)
        assert applied.exposure_us == pytest.approx(asked.exposure_us, rel=_SNAPPING)
        assert applied.gain_db == pytest.approx(asked.gain_db, abs=_GAIN_STEP_DB)

    @pytest.mark.parametrize("configured", [False, True], ids=["open", "configured"])
    def test_beyond_a_limit_the_old_settings_stay(self, camera: Camera, bench: CameraBench, configured: bool) -> None:
        limits = camera.open().limits
        applied = camera.configure(short_settings(limits)) if configured else None
        for feature, asked in beyond(limits):
            with refused(camera, DeviceConfigurationError) as caught:
                camera.configure(asked)
            assert isinstance(caught.value, DeviceConfigurationError)
            assert caught.value.feature == feature
            assert caught.value.wanted == getattr(asked, feature)
        if applied is not None:
            assert camera.read_settings() == applied

    def test_every_bit_depth_offered_is_taken(self, camera: Camera) -> None:
        """A recording keeps its own, and says so."""
        info = camera.open()
        for depth in info.limits.bit_depths:
            applied = camera.configure(short_settings(info.limits).model_copy(update={"bit_depth": depth}))
            assert applied.bit_depth == depth or info.origin == "replayed"
            assert camera.read_settings() == applied

    def test_a_trigger_that_the_camera_has_not_is_refused(self, camera: Camera, bench: CameraBench) -> None:
        missing = set(Trigger) - supported_triggers(camera)
        if not missing:
            pytest.skip("this camera has every trigger")
        bench.configured()
        for trigger in sorted(missing):
            with refused(camera, DeviceConfigurationError):
                camera.arm(1, trigger)

    def test_pulses_need_at_least_the_exposure(self, camera: Camera) -> None:
        if not isinstance(camera, EdgeTriggered):
            pytest.skip("no pulse can start this camera")
        limits = camera.open().limits
        short = short_settings(limits)
        longer = short.model_copy(update={"exposure_us": min(10 * short.exposure_us, limits.exposure_us[1])})
        periods = [camera.min_period_us(settings) for settings in (short, longer)]
        assert periods == sorted(periods)
        assert periods[0] >= short.exposure_us
        assert periods[1] >= longer.exposure_us


def beyond(limits: CameraLimits) -> Iterator[tuple[str, CameraSettings]]:
    """(name of a setting, settings whose other values are allowed) just outside each limit."""
    fine = short_settings(limits)
    low, high = limits.exposure_us
    for exposure_us in (low * (1 - _SNAPPING), high * (1 + _SNAPPING)):
        yield "exposure_us", fine.model_copy(update={"exposure_us": exposure_us})
    quiet, loud = limits.gain_db
    for gain_db in (quiet - _GAIN_STEP_DB, loud + _GAIN_STEP_DB):
        yield "gain_db", fine.model_copy(update={"gain_db": gain_db})
    for depth in {8, 12} - set(limits.bit_depths):
        yield "bit_depth", fine.model_copy(update={"bit_depth": depth})
