"""Seconds to render a full simulated sample, 66 images with their truth, and to write it."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

from benchmarks.report import limit_threads, parser, show
from drivers.simulator.dataset import render_sample
from drivers.simulator.rig import SimulatedRig
from models.capture import write_capture
from models.patterns import make_plan

TARGET_S = 4.0
SEED = 2


def main() -> None:
    arguments = parser("simulate", __doc__ or "")
    arguments.add_argument("--samples", type=int, default=5, help="samples after one to warm up (default 5)")
    options = arguments.parse_args()
    limit_threads()
    plan = make_plan("full")
    rig = SimulatedRig(threads=2)
    rig.prepare(plan)
    times: dict[str, list[float]] = {"render": [], "write": [], "both": []}
    images = 0
    with tempfile.TemporaryDirectory() as folder:
        for index in range(options.samples + 1):
            start = time.perf_counter()
            capture = render_sample(SEED, index, plan, rig=rig)
            rendered = time.perf_counter()
            write_capture(capture, Path(folder) / f"sample-{index}")
            written = time.perf_counter()
            images = sum(len(view) for view in capture.images.values())
            if index > 0:  # the first compiles kernels
                for name, seconds in (
                    ("render", rendered - start),
                    ("write", written - rendered),
                    ("both", written - start),
                ):
                    times[name].append(seconds)
    medians = {name: statistics.median(values) for name, values in times.items()}
    rows = [["stage", "median", "slowest", "target"]]
    for name, values in times.items():
        target = f"<= {TARGET_S:g} s" if name == "both" else ""
        rows.append([name, f"{medians[name]:.2f} s", f"{max(values):.2f} s", target])
    data = {"benchmark": "simulate", "images": images, "median_s": medians, "target_s": TARGET_S}
    show(f"A full sample, {images} images with truth, over {options.samples} scenes", rows, data, as_json=options.json)


if __name__ == "__main__":
    main()
