"""The demonstration: a simulated capture from exposure to cloud, and a recorded one where its set is at hand."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers.simulator.dataset import render_sample
from models.capture import RECORD_NAME, Capture, read_capture, write_capture
from models.errors import DuofringeError
from models.export import write_points
from models.foreign import import_capture
from models.metrics import Figures, Reference, aggregate, compare_all, figures_as_json, table_text
from models.patterns import make_plan
from models.reconstruct import Reconstruction, ReconstructionOptions, reconstruct
from service.overview import compare_figure, recorded_figure, write_maps
from service.pictures import write_picture
from service.summary import summarise

DEFAULT_SEED = 23
REPOSITORY = Path(__file__).resolve().parent.parent
RECORDED_SET = "stereo_small_mit"
RECORDED_MANIFEST = REPOSITORY / "examples" / "manifests" / f"{RECORDED_SET}.toml"
_CAPTURE_ID = "duofringe-demo"
_RUNS: dict[str, ReconstructionOptions] = {
    "nstep": ReconstructionOptions(method="nstep", matching="trinocular"),
    "wft_stereo": ReconstructionOptions(method="wft", matching="stereo"),
    "wft": ReconstructionOptions(method="wft", matching="trinocular"),
    "refiner": ReconstructionOptions(method="refiner", matching="trinocular"),
}
Report = Callable[[str, float], None]


def recorded_sets() -> Path | None:
    """Folder of the recorded sets: DUOFRINGE_DATA, else shared/data beside the repository.

    None where it is absent, or where the program is installed without the examples.
    """
    folder = Path(os.environ.get("DUOFRINGE_DATA") or REPOSITORY.parent / "shared" / "data")
    return folder if (folder / RECORDED_SET).is_dir() and RECORDED_MANIFEST.is_file() else None


def _simulate_capture(seed: int) -> Capture:
    """Scene 0 of a series, under the full plan, with its truth."""
    capture = render_sample(seed, 0, make_plan("full"))
    return replace(capture, record=capture.record.model_copy(update={"id": _CAPTURE_ID}))


@dataclass(frozen=True)
class Demonstration:
    """What a demonstration shows: reconstructions by name (``nstep``, ``wft_stereo``, ``wft``, ``refiner``), and their
    errors."""

    results: Mapping[str, Reconstruction]
    figures: Mapping[str, Figures]
    recorded: Reconstruction | None = None

    def text(self) -> str:
        lines = [table_text(self.figures)]
        lines += [f"{name}: {summarise(result)}" for name, result in self.results.items()]
        if self.recorded is not None:
            lines.append(f"recorded set {RECORDED_SET}: {summarise(self.recorded)}")
        lines.append("(seconds of a first run include the one-off compilation of the kernels)")
        return "\n".join(lines)

    def as_json(self) -> dict[str, Any]:
        rows = {name: summarise(result).as_json() for name, result in self.results.items()}
        return {
            "results": {name: {**row, "errors": figures_as_json(self.figures[name])} for name, row in rows.items()},
            "recorded": None if self.recorded is None else summarise(self.recorded).as_json(),
        }


def demonstrate(folder: Path, seed: int, report: Report) -> Demonstration:
    """Simulate, reconstruct, compare with the truth and draw into ``folder``, which must exist.

    A recorded set is done as well where it is found. Files of an earlier run are replaced.
    """
    capture, results = _demonstrate_simulated(folder, seed, report)
    assert capture.truth is not None
    assert capture.rig is not None
    errors = compare_all(
        {name: result.points for name, result in results.items()},
        Reference.from_truth(capture.truth),
        capture.rig,
        capture.plan.of_kind("high")[0].periods[0],
        results["nstep"].depth_range,
    )
    sets = recorded_sets()
    recorded = None if sets is None else _demonstrate_recorded(sets, folder, report)
    report("done", 1.0)
    return Demonstration(results, {name: aggregate([own]) for name, own in errors.items()}, recorded)


def _demonstrate_simulated(folder: Path, seed: int, report: Report) -> tuple[Capture, dict[str, Reconstruction]]:
    report("simulating a capture", 0.0)
    capture = _simulate_capture(seed)
    _replace_capture(capture, folder / "capture")
    capture = read_capture(folder / "capture")  # what follows starts from the disk, as everywhere else
    results: dict[str, Reconstruction] = {}
    for index, (name, options) in enumerate(_RUNS.items()):
        report(f"reconstructing: {options.method}, {options.matching}", 0.2 + 0.15 * index)
        results[name] = reconstruct(capture, options)
        write_points(results[name].points, folder / f"{name}.ply")
    report("drawing", 0.8)
    for name in ("wft", "refiner"):
        write_points(results[name].points, folder / f"{name}.glb")
    for name in ("nstep", "wft", "refiner"):
        write_maps(results[name], folder, name)
    title = "Duofringe: depth from one exposure"
    subtitle = (
        "A simulated capture, reconstructed from its composite exposure with and without the learned refiner, and "
        "from the full sequence"
    )
    picture = compare_figure(title, subtitle, capture, results["refiner"], results["wft"], results["nstep"])
    write_picture(folder / "overview.png", picture)
    return capture, results


def _demonstrate_recorded(sets: Path, folder: Path, report: Report) -> Reconstruction:
    report("importing a recorded set", 0.85)
    _replace_capture(import_capture(sets / RECORDED_SET, RECORDED_MANIFEST), folder / "recorded_capture")
    report("reconstructing the recorded set", 0.9)
    capture = read_capture(folder / "recorded_capture")
    result = reconstruct(capture, ReconstructionOptions(method="nstep"))
    write_points(result.points, folder / "recorded.ply")
    title = "A recorded capture of another rig"
    subtitle = f"{RECORDED_SET}: imported through its manifest, two cameras, four-step phase shift and Gray code"
    write_picture(folder / "recorded.png", recorded_figure(title, subtitle, capture, result))
    return result


def _replace_capture(capture: Capture, folder: Path) -> None:
    """Write a capture in place of the one that an earlier demonstration left, and of nothing else."""
    if folder.exists():
        if _id_of(folder) != capture.record.id:
            raise DuofringeError(f"output '{folder}' exists and is not the demonstration's; name another --output")
        shutil.rmtree(folder)
    write_capture(capture, folder)


def _id_of(folder: Path) -> str | None:
    try:
        record = json.loads((folder / RECORD_NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record.get("id") if isinstance(record, dict) else None
