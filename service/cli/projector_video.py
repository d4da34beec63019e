"""``duofringe projector video`` and ``signal``: patterns that a graphics card sends, and what arrives of them."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from service.cli import console
from service.cli.options import Json
from service.cli.rig_options import Config, settings_from

if TYPE_CHECKING:
    from drivers.lightcrafter.values import VideoSignal

VIDEO_EXAMPLE = "Example: duofringe projector video --depth 8 --config rig.toml"
SIGNAL_EXAMPLE = "Example: duofringe projector signal --config rig.toml"
_LOOK_S = 1.0
_CHUNK = 4096
_LATER = "a frame that is drawn in frame k of the output is seen in frame k + 2"


def register(group: typer.Typer) -> None:
    group.command("video", epilog=VIDEO_EXAMPLE)(video_command)
    group.command("signal", epilog=SIGNAL_EXAMPLE)(signal_command)


def video_command(
    depth: Annotated[Literal["8", "1"], typer.Option(help="Bits of each pattern of a frame.")],
    config: Config = None,
    patterns: Annotated[
        int | None, typer.Option(min=1, max=24, help="Patterns of each frame; as many as fit in its place.")
    ] = None,
    channel_swap: Annotated[int, typer.Option(min=0, max=5, help="Register 1A 37; see docs/projector.md.")] = 4,
) -> None:
    """Show the patterns of the frames that a graphics card sends at 912x1140 and 60 Hz.

    Runs until its standard input ends or it is interrupted; the projector is dark afterwards.
    """
    settings = settings_from(config, None, None).rig.projector
    from drivers.lightcrafter.connect import make_transport
    from drivers.lightcrafter.values import LedSelect
    from drivers.lightcrafter.video import check_video, end_video, opened, show_video

    leds = LedSelect[settings.leds.upper()]
    ended = _end_of_input()
    bits: Literal[8, 1] = 8 if depth == "8" else 1
    with opened(make_transport(settings), settings) as projector:
        with suppress(KeyboardInterrupt):
            signal = show_video(projector, bits, leds, patterns=patterns, channel_swap=channel_swap)
            console.note(f"projector: {_described(signal)}; {_LATER}; Ctrl-C or Ctrl-D ends it")
            while not ended.wait(_LOOK_S):
                check_video(projector)
        end_video(projector)
    console.note("projector: dark")


def signal_command(config: Config = None, json: Json = False) -> None:
    """Tell what the projector measures at its video input; it stays dark.

    The unit of the pixel clock and of the rates is the controller's own.
    """
    settings = settings_from(config, None, None).rig.projector
    from drivers.lightcrafter.connect import make_transport
    from drivers.lightcrafter.video import measure_signal, opened

    with opened(make_transport(settings), settings) as projector:
        signal = measure_signal(projector)
    console.result({"locked": signal.locked, **signal._asdict()}, _described(signal), as_json=json)


def _described(signal: VideoSignal) -> str:
    if not signal.locked:
        return "not locked to any video signal"
    return (
        f"locked to {signal.columns}x{signal.rows} of {signal.total_pixels}x{signal.total_lines} in all, pixel clock "
        f"{signal.pixel_clock}, line rate {signal.line_rate}, frame rate {signal.frame_rate}"
    )


def _end_of_input() -> threading.Event:
    """Set once standard input ends. Read past Python's buffer, whose lock a thread must not hold at the exit."""
    ended = threading.Event()
    descriptor = sys.stdin.fileno()

    def read() -> None:
        while os.read(descriptor, _CHUNK):
            pass
        ended.set()

    threading.Thread(target=read, name="end of input", daemon=True).start()
    return ended
