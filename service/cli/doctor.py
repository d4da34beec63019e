"""``duofringe doctor``: what is attached, what is wrong with it, and how to mend it."""

from __future__ import annotations

from typing import Annotated

import typer

from service.cli import console
from service.cli.options import Json
from service.cli.rig_options import Config, Driver, Replay, settings_from

EXAMPLE = "Example: duofringe doctor --config rig.toml"
_MARKS = {"ok": "ok     ", "warning": "warning", "fault": "FAULT  "}


def register(app: typer.Typer) -> None:
    app.command("doctor", epilog=EXAMPLE)(command)


def command(
    config: Config = None,
    driver: Driver = None,
    replay: Replay = None,
    skip_exposure: Annotated[
        bool, typer.Option("--skip-exposure", help="No light: leave out the trigger pulses and the test exposure.")
    ] = False,
    json: Json = False,
) -> None:
    """Examine computer, library, devices, wiring and calibration, with one test exposure; exit status 1 for a fault."""
    settings = settings_from(config, driver, replay)
    from service.diagnosis import examine

    symptoms = examine(settings, exposure=not skip_exposure)
    faults = [symptom for symptom in symptoms if symptom.state == "fault"]
    lines = [
        f"{_MARKS[s.state]}  {s.subject}: {s.finding}" + (f"\n         mend: {s.remedy}" if s.remedy else "")
        for s in symptoms
    ]
    verdict = f"{len(faults)} faults" if len(faults) != 1 else "1 fault"
    text = "\n".join([*lines, verdict if faults else "no faults"])
    console.result({"ok": not faults, "symptoms": [s.as_json() for s in symptoms]}, text, as_json=json)
    if faults:
        raise SystemExit(1)
