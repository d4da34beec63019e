"""``duofringe simulate``: a dataset from the simulated rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from service.cli import console
from service.cli.options import Json, Plan, RasterChoice, Workers

EXAMPLE = "Example: duofringe simulate --samples 20 --seed 7 --plan full --output simulated"


def register(app: typer.Typer) -> None:
    app.command("simulate", epilog=EXAMPLE)(command)


def command(
    samples: Annotated[int, typer.Option(min=1, help="How many captures.")],
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same bytes.")],
    output: Annotated[Path, typer.Option(metavar="DATASET", help="New dataset folder.")],
    plan: Plan = "full",
    mesh: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Mesh to place in the scenes (STL PLY OBJ OFF GLB); may be repeated."),
    ] = None,
    bits: Annotated[Literal["8", "12"], typer.Option(help="Bit depth of the cameras.")] = "8",
    raster: Annotated[RasterChoice, typer.Option(help="Mirrors of the projector.")] = "diamond",
    varied: Annotated[
        bool, typer.Option("--varied", help="Another rig, light and surfaces in each sample, to train a refiner on.")
    ] = False,
    workers: Workers = 1,
    json: Json = False,
) -> None:
    """Simulate a dataset of captures with ground truth, split by objects into train, val and test."""
    from drivers.simulator.dataset import simulate_dataset
    from drivers.simulator.geometry import reference_rig
    from drivers.simulator.rig import SimulatedRig
    from drivers.simulator.sensor import Sensor
    from models.atomic import require_parent
    from models.patterns import FringeParameters, make_plan

    require_parent(output)
    simulated = SimulatedRig(rig=reference_rig(raster), sensor=Sensor(bit_depth=8 if bits == "8" else 12))
    chosen = make_plan(plan, FringeParameters(raster=simulated.raster))
    with console.progress("simulate") as report:
        dataset = simulate_dataset(
            output,
            samples,
            seed,
            chosen,
            rig=simulated,
            meshes=mesh or [],
            varied=varied,
            workers=workers,
            progress=lambda done, total: report(f"{done} of {total} samples", done / total),
        )
    splits = {name: len(ids) for name, ids in (dataset.splits or {}).items()}
    told = ", ".join(f"{count} {name}" for name, count in splits.items())
    text = f"{output}: {len(dataset)} samples of plan {plan} ({told})"
    data = {"output": str(output), "samples": len(dataset), "plan": plan, "splits": splits}
    console.result(data, text, as_json=json)
