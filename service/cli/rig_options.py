"""Options that say which rig and library a command uses; each goes before the configuration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from service.settings import ServiceSettings

DriverChoice = Literal["simulated", "replay", "hardware", "bench", "auto"]
Config = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        envvar="DUOFRINGE_CONFIG",
        help="Configuration (TOML); see docs/configuration.md.",
        dir_okay=False,
    ),
]
Driver = Annotated[
    DriverChoice | None,
    typer.Option(help="Which rig, in place of the configuration's: 'auto' is the hardware that is attached."),
]
Replay = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Recorded captures to replay; implies --driver replay.")
]


def settings_from(
    config: Path | None, driver: DriverChoice | None, replay: Path | None, **server: Any
) -> ServiceSettings:
    """The configuration with what the command line says over it. Raises ConfigurationError."""
    from service.settings import load_settings

    rig: dict[str, Any] = {}
    if replay is not None:
        rig = {"driver": "replay", "replay": replay}
    if driver is not None:
        rig["driver"] = driver
    given = {name: value for name, value in server.items() if value is not None}
    return load_settings(config, {"rig": rig, "server": given})
