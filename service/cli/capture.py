"""``duofringe capture``: one capture from the configured rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli import console
from service.cli.options import Json, Plan
from service.cli.rig_options import Config, Driver, Replay, settings_from

EXAMPLE = "Example: duofringe capture --plan full --driver simulated --output scan"


def register(app: typer.Typer) -> None:
    app.command("capture", epilog=EXAMPLE)(command)


def command(
    plan: Plan,
    output: Annotated[Path, typer.Option(metavar="DIR", help="New capture folder.")],
    config: Config = None,
    driver: Driver = None,
    replay: Replay = None,
    exposure_us: Annotated[float | None, typer.Option(min=1, help="Exposure in microseconds.")] = None,
    object_id: Annotated[str | None, typer.Option(help="Identity of the object.")] = None,
    scene: Annotated[str | None, typer.Option(help="Recorded capture, or simulated scene, to stand before.")] = None,
    json: Json = False,
) -> None:
    """Take one capture, prove its frames, and write it; nothing is written unless all of it is good."""
    settings = settings_from(config, driver, replay)
    from dataclasses import replace

    from drivers.registry import make_devices
    from models.atomic import require_parent
    from models.capture import write_capture
    from models.errors import DuofringeError
    from service.acquisition.orchestrator import Orchestrator
    from service.acquisition.request import CaptureRequest

    require_parent(output)
    if output.exists():
        raise DuofringeError(f"output '{output}' exists already; name a new folder or remove it")
    orchestrator = Orchestrator(make_devices(settings.rig), settings.acquisition)
    try:
        console.note("capture: connecting")
        orchestrator.connect()
        outcome = orchestrator.capture(
            CaptureRequest(plan=plan, exposure_us=exposure_us, object_id=object_id, scene=scene)
        )
    finally:
        orchestrator.close()
    record = outcome.capture.record.model_copy(update={"id": output.name})
    write_capture(replace(outcome.capture, record=record), output)
    for warning in record.warnings:
        console.note(f"warning: {warning}")
    data = {
        "output": str(output),
        "plan": plan,
        "exposures": len(outcome.capture.plan),
        "attempts": outcome.attempts,
        "acquisition_s": outcome.acquisition_s,
        "warnings": list(record.warnings),
        "devices": [device.model_dump() for device in record.devices],
    }
    tries = f", {outcome.attempts} attempts" if outcome.attempts > 1 else ""
    text = f"{output}: {len(outcome.capture.plan)} exposures in {outcome.acquisition_s:.2f} s{tries}"
    console.result(data, text, as_json=json)
