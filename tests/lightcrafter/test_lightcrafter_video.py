"""Patterns out of the video input: what a graphics card draws, and what then stands on the mirrors."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from lightcrafter_benches import SMALL, controller, quick, serial_port, usb_transport, wait_until
from video_benches import Listening, assert_dark, connected, drawn, holds, on_usb
from worked_examples import EXAMPLES

from drivers.errors import DeviceConfigurationError, DeviceLostError, ProtocolError, SequenceInvalidError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.sequence import Program, video_program
from drivers.lightcrafter.values import (
    Input,
    LedSelect,
    LutEntry,
    MainStatus,
    Mode,
    PatternSource,
    PixelFormat,
    Run,
    Source,
    Timing,
    Trigger,
    TriggerMode,
    Validation,
    Width,
)
from drivers.lightcrafter.video import check_video, end_video, measure_signal, opened, show_video
from models.patterns import LIGHTCRAFTER_4500, make_plan
from service.video_frames import VideoFrame, pack_frames

DEPTHS: tuple[Literal[8, 1], ...] = (8, 1)
EXAMPLE_11 = next(example for example in EXAMPLES if example.number == "11")
_HEADER = 6


class TestProgram:
    def test_its_bytes_are_those_of_the_worked_example(self) -> None:
        """Which has three entries of 8 bits; two of them go into a frame."""
        sent = c.PATTERN_ENTRIES.encode(video_program(8).entries)
        assert sent == EXAMPLE_11.request_bytes[_HEADER : _HEADER + 6]

    def test_as_many_patterns_as_fit(self) -> None:
        assert video_program(8).timing == Timing(8333, 8333)
        one_bit = video_program(1, LedSelect.GREEN)
        assert one_bit.timing == Timing(694, 694)
        assert [entry.number for entry in one_bit.entries] == list(range(24))
        assert {entry.leds for entry in one_bit.entries} == {LedSelect.GREEN}
        assert c.LUT_CONTROL.encode(one_bit.control) == bytes([23, 1, 23, 0])

    @pytest.mark.parametrize(("depth", "count"), [(8, 3), (1, 25), (8, 0), (1, 0)])
    def test_more_do_not_fit(self, depth: Literal[8, 1], count: int) -> None:
        with pytest.raises(
            SequenceInvalidError, match=f"{count} patterns of {depth} bits do not go into a video frame"
        ):
            video_program(depth, patterns=count)

    def test_the_timing_is_that_of_the_exported_frames(self) -> None:
        frames = [
            frame for plan in ("full", "composite", "calibration") for frame in pack_frames(make_plan(plan)).frames
        ]
        assert {len(frame.patterns) for frame in frames} >= {1, 2}
        for frame in frames:
            program = video_program(frame.depth, patterns=len(frame.patterns))
            assert program.timing == Timing(frame.exposure_us, frame.period_us)

    @pytest.mark.parametrize("period_us", [5555, 8333])
    def test_three_of_8_bits_are_refused_by_the_controller(self, period_us: int) -> None:
        """Either the exposure is too short for 8 bits, or the frame for three of them."""
        timing = Timing(period_us, period_us)
        program = Program(EXAMPLE_11.value, (), timing, repeat=True, source=PatternSource.VIDEO)
        with on_usb(connected()) as console, pytest.raises(SequenceInvalidError, match="period is out of range"):
            console.upload(program)

    @pytest.mark.parametrize(
        "entries",
        [
            (LutEntry(0, 8, Trigger.INTERNAL, swap=False), LutEntry(1, 8, Trigger.CONTINUE)),
            (LutEntry(0, 8, Trigger.EXTERNAL_POSITIVE, swap=True), LutEntry(1, 8, Trigger.EXTERNAL_POSITIVE)),
            (LutEntry(0, 8, Trigger.EXTERNAL_POSITIVE, swap=True), LutEntry(1, 8, Trigger.CONTINUE, swap=True)),
            (LutEntry(0, 8, Trigger.EXTERNAL_POSITIVE, swap=True), LutEntry(3, 8, Trigger.CONTINUE)),
        ],
    )
    def test_entries_that_do_not_follow_a_frame_are_refused(self, entries: tuple[LutEntry, ...]) -> None:
        program = Program(entries, (), Timing(8333, 8333), repeat=True, source=PatternSource.VIDEO)
        with on_usb(connected()) as console, pytest.raises(SequenceInvalidError, match="pattern number"):
            console.upload(program)

    def test_the_trigger_mode_belongs_to_the_source(self) -> None:
        with on_usb(connected()) as console:
            assert console.upload(video_program(8)) is Validation.TRIGGER_CONTINUOUS
            console.write(c.TRIGGER_MODE, TriggerMode.INTERNAL)
            console.write(c.VALIDATE, Validation(0))
            assert wait_until(lambda: Validation.BUSY not in console.read(c.VALIDATE))
            assert Validation.PATTERN_INVALID in console.read(c.VALIDATE)


class TestProcedure:
    def test_what_is_written_in_which_order(self) -> None:
        device = connected()
        device.handle(c.PIXEL_FORMAT.usb, bytes([PixelFormat.YCRCB444]))
        device.handle(c.CHANNEL_SWAP.usb, b"\0")
        wire = Listening(usb_transport(device)[0])
        with opened(wire, quick()) as console:
            console.show_still(None)
            wire.written.clear()
            show_video(console, 8)
        order = [command.name for command, _ in wire.written]
        assert order[:8] == [
            "start, pause and stop",
            "LED polarity",
            "LED enable",
            "LED current",
            "input source",
            "display mode",
            "input source",
            "pixel format",
        ]
        assert wire.payloads(c.INPUT_SOURCE) == [b"\x00", b"\x08"], "source 0 before video mode, then 24 bits"
        assert wire.payloads(c.PIXEL_FORMAT) == [b"\x00"]
        assert wire.payloads(c.CHANNEL_SWAP) == [b"\x04"]
        assert wire.payloads(c.DISPLAY_MODE) == [b"\x00", b"\x01"]
        assert wire.payloads(c.PATTERN_SOURCE) == [b"\x00"]
        assert wire.payloads(c.TRIGGER_MODE) == [b"\x00"]
        assert wire.payloads(c.LUT_CONTROL) == [b"\x01\x01\x01\x00"]
        assert wire.payloads(c.PATTERN_ENTRIES) == [EXAMPLE_11.request_bytes[_HEADER : _HEADER + 6]]
        assert wire.payloads(c.IMAGE_INDEXES) == []
        assert wire.payloads(c.MAILBOX_SELECT) == [b"\x02", b"\x00"]
        assert wire.payloads(c.RUN)[1] == bytes([Run.START])

    def test_the_leds_keep_to_their_limits_and_are_dark_until_then(self) -> None:
        device = connected()
        device.video.draw(np.full((1140, 912, 3), 255, np.uint8))
        with opened(usb_transport(device)[0], quick(led_limits=(100, 50, 20))) as console:
            assert measure_signal(console).locked
            assert not device.light().any(), "video mode shows its input"
            show_video(console, 8, brightness=0.5)
            assert device.led_shares() == pytest.approx((50 / 255, 25 / 255, 10 / 255))

    def test_flash_patterns_are_shown_as_before_afterwards(self) -> None:
        device = connected()
        entry = LutEntry(0, 8, swap=True)
        with on_usb(device) as console:
            show_video(console, 1)
            end_video(console)
            assert_dark(device)
            console.upload(Program((entry,), (0,), Timing(8333, 8333), repeat=True))
            console.start(np.inf)
            assert wait_until(lambda: device.showing is not None)
            assert holds(device, c.TRIGGER_MODE) is TriggerMode.INTERNAL
            assert device.showing is not None
            assert device.showing.image == 0

    @pytest.mark.parametrize("failing", ["validate", "pattern source", "LED current", "video signal"])
    def test_what_fails_on_the_way_leaves_it_dark(self, failing: str) -> None:
        device = connected()
        device.handle(c.LED_CURRENT.usb, bytes(3))
        with on_usb(device) as console:
            device.faults.refused.add(failing)
            with pytest.raises(ProtocolError, match=failing):
                show_video(console, 8)
            assert_dark(device)

    def test_it_is_left_closed_and_dark(self) -> None:
        device = connected()
        transport, bus = usb_transport(device)
        with opened(transport, quick()) as console:
            show_video(console, 8)
            assert bus.claimed
        assert_dark(device)
        assert not bus.claimed

    def test_a_projector_that_is_unplugged_is_lost(self) -> None:
        device = connected()
        with on_usb(device) as console:
            show_video(console, 8)
            device.unplug()
            with pytest.raises(DeviceLostError):
                check_video(console)

    def test_the_pattern_source_is_ready_over_a_bridge(self, tmp_path: Path) -> None:
        """24 entries in pieces of twenty."""
        device = connected()
        with serial_port(device, "usb-iss", tmp_path) as (transport, _):
            wire = Listening(transport)
            with opened(wire, quick()) as console:
                assert (show_video(console, 1).columns, device.running) == (912, True)
                assert MainStatus.RUNNING in console.read(c.MAIN_STATUS)
            pieces = wire.payloads(c.PATTERN_ENTRIES)
            assert len(pieces) > 1
            assert b"".join(pieces) == c.PATTERN_ENTRIES.encode(video_program(1).entries)
            assert_dark(device)


class TestSignal:
    def test_it_is_read_as_the_board_sends_it(self) -> None:
        """Totals of the mode at 83.6 MHz."""
        with on_usb(connected()) as console:
            found = measure_signal(console)
            assert found.locked
            assert (found.columns, found.rows, found.total_pixels, found.total_lines) == (912, 1140, 1192, 1170)
            assert console.read(c.INPUT_SOURCE) == Input(Source.PARALLEL, Width.BITS_24)
            console.set_mode(Mode.PATTERN)
            assert not console.read(c.VIDEO_SIGNAL).locked, "as is normal in pattern mode"

    def test_a_wrong_resolution_is_told(self) -> None:
        device = controller()
        device.video.connect(1280, 800)
        with on_usb(device) as console:
            with pytest.raises(
                DeviceConfigurationError, match=r"measures 1280x800; set the output .* exactly 912x1140"
            ):
                show_video(console, 8, lock_s=0.01)
            assert_dark(device)

    @pytest.mark.parametrize("steady", [None, False])
    def test_no_signal_is_told(self, steady: bool | None) -> None:
        device = controller()
        if steady is not None:
            device.video.connect(steady=steady)
        with on_usb(device) as console:
            assert not measure_signal(console, lock_s=0.01).locked
            with pytest.raises(DeviceConfigurationError, match=r"locked to none; set the output .* exactly 912x1140"):
                show_video(console, 8, lock_s=0.01)
            assert_dark(device)

    def test_a_signal_that_comes_late_is_awaited(self) -> None:
        device = controller()
        late = threading.Timer(0.1, device.video.connect)
        with on_usb(device) as console:
            late.start()
            assert show_video(console, 8, lock_s=2.0).locked
        late.join()

    def test_one_that_goes_before_the_start_is_not_waited_for(self) -> None:
        device = connected()
        with on_usb(device) as console:
            measure_signal(console)
            console.set_mode(Mode.PATTERN)
            console.upload(video_program(8))
            device.video.disconnect()
            with pytest.raises(ProtocolError, match="did not start the sequence"):
                console.start(np.inf)

    def test_one_that_is_lost_is_told(self) -> None:
        device = connected()
        with on_usb(device) as console:
            show_video(console, 1)
            check_video(console)
            device.video.disconnect()
            assert wait_until(lambda: not device.running)
            with pytest.raises(ProtocolError, match=r"no longer \(the sequencer aborted\); look whether .* 912x1140"):
                check_video(console)
            assert_dark(device)

    def test_a_frame_has_the_size_of_the_signal(self) -> None:
        device = controller()
        with pytest.raises(ValueError, match="is not of the signal"):
            device.video.draw(drawn())
        device.video.connect(1280, 800)
        with pytest.raises(ValueError, match="is not of the signal"):
            device.video.draw(drawn())


class TestFrames:
    @pytest.mark.parametrize("name", ["full", "calibration"])
    def test_every_exported_pattern_is_shown_bit_by_bit(self, name: Literal["full", "calibration"]) -> None:
        """Frame by frame, as a graphics card would play them; the controller is told anew between the depths."""
        plan = make_plan(name)
        manifest = pack_frames(plan)
        device = connected(realtime=False)
        seen: set[str] = set()
        with on_usb(device) as console:
            for depth in DEPTHS:
                frames = [frame for frame in manifest.frames if frame.depth == depth]
                show_video(console, depth)
                for shown, frame in zip(self._played(device, frames, manifest.render, depth), frames, strict=True):
                    seen |= self._assert_shows(shown, frame)
        assert seen == set(plan.names)

    @staticmethod
    def _played(
        device: EmulatedController, frames: list[VideoFrame], render: Callable[[VideoFrame], Any], depth: int
    ) -> Iterator[list[np.ndarray]]:
        """What stands on the mirrors at each sync from the second after the first frame was drawn."""
        at_once = {8: 2, 1: 24}[depth]
        for k in range(len(frames) + 1):
            if k < len(frames):
                device.video.draw(render(frames[k]))
            shown = []
            for _ in range(at_once):
                exposure = device.step()
                assert exposure is not None
                if k > 0:
                    shown.append(exposure.levels)
            if k > 0:
                yield shown

    @staticmethod
    def _assert_shows(shown: list[np.ndarray], frame: VideoFrame) -> set[str]:
        names = set()
        for number, levels in enumerate(shown):
            place = frame.patterns[number] if number < len(frame.patterns) else None
            if place is None or place.pattern is None:
                assert not levels.any()
            else:
                assert place.number == number
                assert np.array_equal(levels, place.pattern.render(LIGHTCRAFTER_4500)), place.pattern.name
                names.add(place.pattern.name)
        return names

    def test_a_frame_is_seen_two_syncs_after_it_was_drawn(self) -> None:
        device = connected(realtime=False)
        frame = drawn()
        with on_usb(device) as console:
            show_video(console, 8)
            device.video.draw(frame)
            levels = [step.levels for _ in range(4) if (step := device.step()) is not None]
        assert not levels[0].any()
        assert not levels[1].any()
        assert np.array_equal(levels[2], frame[..., 0])
        assert np.array_equal(levels[3], frame[..., 1])

    def test_in_real_time_the_entries_of_each_frame_come_in_turn(self) -> None:
        """No pulse: exposures follow each other without dark."""
        device = connected()
        numbers: set[int] = set()
        with on_usb(device) as console:
            show_video(console, 8, LedSelect.BLUE)
            device.video.draw(drawn())

            def both_seen() -> bool:
                if (showing := device.showing) is not None and showing.levels.any():
                    numbers.add(showing.entry.number)
                return numbers == {0, 1}

            assert wait_until(both_seen)
            light = device.light()
            assert light[..., 2].any()
            assert not light[..., :2].any()
        assert device.pulses_sent == 0

    def test_video_mode_shows_the_frame_itself(self) -> None:
        device = connected()
        frame = drawn()
        device.video.draw(frame)
        with on_usb(device) as console:
            measure_signal(console)
            console.set_leds(1.0)
            light = device.light()
            assert light.shape == (SMALL.rows, SMALL.columns, 3)
            assert light[0, 0] == pytest.approx(frame[0, 0, [1, 0, 2]] * np.array(device.led_shares()))
