"""``duofringe projector``: firmware files, and their way into the projector's flash."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli import console
from service.cli.firmware import register as register_firmware
from service.cli.options import Json
from service.cli.projector_video import register as register_video
from service.cli.rig_options import Config, settings_from

if TYPE_CHECKING:
    from drivers.lightcrafter.settings import LightCrafterConfiguration
    from drivers.lightcrafter.usb import UsbTransport

FLASH_EXAMPLE = "Example: duofringe projector flash flash.bin --config rig.toml"
REHEARSE_EXAMPLE = "Example: duofringe projector rehearse-flash --config rig.toml"
INTERRUPTED = 130
_WORD = "overwrite"
_VIRTUAL = "this computer is a virtual machine, through whose USB uploads fail; use another computer"


def register(app: typer.Typer) -> None:
    group = typer.Typer(
        help="Firmware and flash of the LightCrafter 4500.", no_args_is_help=True, rich_markup_mode=None
    )
    register_firmware(group)
    register_video(group)
    group.command("flash", epilog=FLASH_EXAMPLE)(flash_command)
    group.command("rehearse-flash", epilog=REHEARSE_EXAMPLE)(rehearse_command)
    app.add_typer(group, name="projector")


def flash_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Firmware with the images.")],
    config: Config = None,
    only_images: Annotated[
        bool, typer.Option("--only-images", help="Leave what agrees of the program; write the images.")
    ] = False,
    confirmed: Annotated[
        bool, typer.Option("--confirm-overwrite", help="Overwrite the projector's flash without asking.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a firmware file into the projector's flash over USB; an upload that was interrupted is taken up again.

    Needs allow_flash = true under [rig.projector] of the configuration.
    """
    settings = settings_from(config, None, None).rig.projector
    from drivers.lightcrafter.upload import UploadStoppedError, read_upload, upload

    transport = _transport(settings)
    size = len(read_upload(file))
    console.note(f"{file}: {size} bytes for the flash of the projector; its power must not go meanwhile")
    if is_virtual_machine():
        console.note(f"warning: {_VIRTUAL}")
    if not confirmed:
        _ask()
    with console.progress("flash") as report, _interrupts() as stopped:
        try:
            outcome = upload(file, transport, only_images=only_images, report=report, stopped=stopped)
        except UploadStoppedError as error:
            console.note(f"duofringe: {error}")
            raise SystemExit(INTERRUPTED) from error
    text = (
        f"projector at {outcome.location}: firmware {outcome.release}, {outcome.images} images; "
        f"{outcome.written} sectors written, {outcome.kept} kept"
    )
    data = {
        "location": outcome.location,
        "firmware": str(outcome.release),
        "images": outcome.images,
        "sectors_written": outcome.written,
        "sectors_kept": outcome.kept,
        "resumed": outcome.resumed,
    }
    console.result(data, text, as_json=json)


def rehearse_command(config: Config = None, json: Json = False) -> None:
    """Enter the projector's bootloader, let it sum bytes that are known, and leave it again; nothing is written.

    Needs allow_flash = true under [rig.projector] of the configuration.
    """
    settings = settings_from(config, None, None).rig.projector
    from drivers.lightcrafter.upload import rehearse

    transport = _transport(settings)
    with console.progress("rehearsal") as report:
        release = rehearse(transport, report=report)
    text = f"the bootloader answers as it should; firmware {release} runs again"
    console.result({"firmware": str(release)}, text, as_json=json)


def _transport(settings: LightCrafterConfiguration) -> UsbTransport:
    from drivers.lightcrafter.connect import make_transport
    from drivers.lightcrafter.usb import UsbTransport
    from models.errors import DuofringeError

    if not settings.allow_flash:
        raise DuofringeError(
            "writing the projector's flash is not allowed; set allow_flash = true under [rig.projector] of the "
            "configuration and name it with --config"
        )
    transport = make_transport(settings)
    if not isinstance(transport, UsbTransport):
        raise DuofringeError(f"the flash is written over USB and rig.projector.connection is '{settings.connection}'")
    return transport


def _ask() -> None:
    """Raises DuofringeError where nobody can answer, or answers otherwise."""
    from models.errors import DuofringeError

    if not sys.stdin.isatty():
        raise DuofringeError(
            "overwriting the projector's flash needs a yes; run it in a terminal or --confirm-overwrite"
        )
    if typer.prompt(f"Type '{_WORD}' to overwrite the projector's flash", err=True) != _WORD:
        raise DuofringeError("the projector's flash was left as it is")


@contextmanager
def _interrupts() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed: an upload ends between two messages, not within one."""
    pressed = []
    before = signal.signal(signal.SIGINT, lambda *_: pressed.append(True))
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, before)


def is_virtual_machine(cpuinfo: Path = Path("/proc/cpuinfo")) -> bool:
    """Whether the processor says that a hypervisor stands between; False where the system does not tell."""
    try:
        text = cpuinfo.read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return any(line.startswith("flags") and "hypervisor" in line.split() for line in text.splitlines())
