"""``duofringe bench``: a rig without hardware, for other programs to use as if it had some."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli import console

if TYPE_CHECKING:
    from drivers.bench import VirtualBench

EXAMPLE = "Example: duofringe bench rehearsal, then in another terminal: duofringe serve --config rehearsal/bench.toml"
_CONFIGURATION = """# Written by `duofringe bench`: what a configuration of the real rig looks like.
[rig]
driver = "hardware"
calibration = "calibration.json"

[rig.cameras.left]
address = "{left}"

[rig.cameras.right]
address = "{right}"

[rig.projector]
connection = "usb-iss"
port = "{port}"
manifest = "manifest.json"
validate_s = 60

[library]
folder = "library"
"""


def register(app: typer.Typer) -> None:
    app.command("bench", epilog=EXAMPLE)(command)


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the configuration for it is written.")],
    seed: Annotated[int, typer.Option(min=0, help="Of the series of simulated scenes.")] = 0,
    scene: Annotated[int, typer.Option(min=0, max=999_999, help="Which of them stands there.")] = 0,
    left: Annotated[str, typer.Option(help="Address of the left camera, 127.x.y.z.")] = "127.0.0.2",
    right: Annotated[str, typer.Option(help="Address of the right camera.")] = "127.0.0.3",
) -> None:
    """Rehearse an installation: simulated cameras on the network, an emulated projector on a serial port.

    Runs until its standard input ends or it is interrupted, and takes lines that make things go wrong; "help" tells
    which.
    """
    from drivers.bench import VirtualBench
    from models.errors import DuofringeError

    try:
        bench = VirtualBench(seed, scene, addresses={"left": left, "right": right})
    except OSError as error:
        raise DuofringeError(
            f"cameras at {left} and {right} cannot be simulated ({error.strerror}); another bench may run there, "
            "choose other addresses 127.x.y.z with --left and --right"
        ) from error
    with bench:
        config = _prepare(bench, folder)
        console.note(
            f"bench: cameras at {left} and {right}, projector at {folder / 'projector'}\n"
            f"       in another terminal: duofringe serve --config {config}\n"
            "       'help' tells what can go wrong here; Ctrl-D ends it"
        )
        try:
            _obey(bench)
        except KeyboardInterrupt:
            console.note("bench: taken down")


def _prepare(bench: VirtualBench, folder: Path) -> Path:
    """Everything that a program needs in order to use the bench; returns its configuration file."""
    from models.atomic import write_text_atomically

    folder.mkdir(parents=True, exist_ok=True)
    port = folder.resolve() / "projector"
    bench.open_serial_port(port)
    bench.manifest.write(folder / "manifest.json")
    assert bench.source.calibration is not None  # simulated rigs know theirs
    bench.source.calibration.to_file(folder / "calibration.json")
    config = folder / "bench.toml"
    write_text_atomically(config, _CONFIGURATION.format(port=port, **bench.addresses))
    return config


def _obey(bench: VirtualBench) -> None:
    from drivers.bench.commands import BenchCommands

    commands = BenchCommands(bench)
    for line in sys.stdin:
        try:
            answer = commands.obey(line)
        except ValueError as error:
            answer = f"not done: {error}"
        print(answer, flush=True)
