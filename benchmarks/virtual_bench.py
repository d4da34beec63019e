"""The same scenes on the virtual bench and on the simulated rig: do images lose anything on their way?

On the bench each of the 33 exposures of the plan "full" goes by pyusb, the emulated controller's LUT and flash, its
trigger output, the simulated cameras, GigE Vision and libaravis; on the simulated rig it is handed over in memory. Both
go through the orchestrator and the audit, and are reconstructed from N-step and Gray code.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from benchmarks.report import parser, show
from drivers.registry import DriverName, RigConfiguration, make_devices
from models.capture import write_capture
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.request import CaptureRequest
from service.sample_evaluation import EvaluationOptions, MethodChoice, evaluate_sample

SEED = 20261122
SCENES = 6
DEPTH_RANGE = (400.0, 670.0)
_OPTIONS = EvaluationOptions((MethodChoice("nstep"),), ("trinocular",), DEPTH_RANGE, "simulator")
_RIGS: tuple[DriverName, ...] = ("simulated", "bench")


def accuracy(driver: DriverName, scenes: int, seed: int = SEED) -> dict[str, list[float]]:
    """Per scene: valid pixels, and those within 1 mm, in per cent of the foreground; attempts until it was proven."""
    configuration = {"driver": driver, "realtime": False, "simulated": {"seed": seed}}
    orchestrator = Orchestrator(make_devices(RigConfiguration.model_validate(configuration)))
    found: dict[str, list[float]] = {"valid": [], "acc1": [], "attempts": []}
    try:
        orchestrator.connect()
        for scene in range(scenes):
            outcome = orchestrator.capture(CaptureRequest(plan="full", scene=str(scene)))
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "capture"
                write_capture(outcome.capture, path)
                errors = evaluate_sample(path, _OPTIONS).errors["nstep trinocular"]
            found["valid"].append(100 * errors.valid / errors.pixels)
            found["acc1"].append(100 * errors.within_1mm / errors.pixels)
            found["attempts"].append(outcome.attempts)
    finally:
        orchestrator.close()
    return found


def main() -> None:
    arguments = parser("virtual_bench", "N-step points on the virtual bench and on the simulated rig.")
    arguments.add_argument("--seed", type=int, default=SEED)
    arguments.add_argument("--scenes", type=int, default=SCENES)
    asked = arguments.parse_args()
    figures: dict[str, Any] = {driver: accuracy(driver, asked.scenes, asked.seed) for driver in _RIGS}
    rows = [("scene", *(f"{what} {driver}" for what in ("Valid %", "Acc1 %") for driver in _RIGS), "attempts")]
    for scene in range(asked.scenes):
        cells = [f"{figures[driver][key][scene]:.2f}" for key in ("valid", "acc1") for driver in _RIGS]
        rows.append((str(scene), *cells, f"{figures['bench']['attempts'][scene]:g}"))
    means = [f"{sum(figures[d][key]) / asked.scenes:.2f}" for key in ("valid", "acc1") for d in _RIGS]
    rows.append(("mean", *means, f"{sum(figures['bench']['attempts']):g}"))
    show(f"{asked.scenes} scenes of seed {asked.seed}, full plan", rows, figures, as_json=asked.json)


if __name__ == "__main__":
    main()
