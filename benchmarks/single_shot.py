"""Seconds per stage and peak memory of a single-shot reconstruction of a pair of views."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.report import THREADS, limit_threads, parser, show
from drivers.simulator.dataset import render_sample
from models.capture import read_capture, write_capture
from models.patterns import make_plan
from models.reconstruct import Method, ReconstructionOptions, kinds_needed, reconstruct

TARGETS: dict[Method, tuple[float, float]] = {"wft": (0.6, 1.5), "refiner": (2.0, 2.0)}
"""Seconds and GiB by method."""
SEED = 2


def main() -> None:
    arguments = parser("single_shot", __doc__ or "")
    arguments.add_argument("--runs", type=int, default=7, help="timed runs after one to warm up (default 7)")
    arguments.add_argument("--method", choices=tuple(TARGETS), default="refiner", help="default refiner")
    arguments.add_argument("--memory-of", metavar="CAPTURE", help="reconstruct once and print the peak memory in KiB")
    options = arguments.parse_args()
    limit_threads()
    if options.memory_of:
        print(_peak_kib(Path(options.memory_of), options.method))
        return
    target_s, target_gib = TARGETS[options.method]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "capture"
        write_capture(render_sample(SEED, 0, make_plan("composite")), path)
        stages = _seconds(path, options.method, options.runs)
        peak_gib = _memory_of_a_fresh_process(path, options.method) / 2**20
    total = sum(stages[name] for name in ("phase", "matching", "points"))
    rows = [["stage", "median", "target"]]
    rows += [[name, f"{seconds:.3f} s", ""] for name, seconds in stages.items()]
    rows.append(["phase + matching + points", f"{total:.3f} s", f"<= {target_s:g} s"])
    rows.append(["peak memory, fresh process", f"{peak_gib:.2f} GiB", f"<= {target_gib:g} GiB"])
    data = {
        "benchmark": "single_shot",
        "stages_s": stages,
        "total_s": total,
        "method": options.method,
        "target_s": target_s,
        "peak_gib": peak_gib,
        "target_gib": target_gib,
    }
    median = f"{THREADS} threads, median of {options.runs}"
    title = f"Single-shot reconstruction, 640x480 pair, {options.method} trinocular, {median}"
    show(title, rows, data, as_json=options.json)


def _seconds(path: Path, method: Method, runs: int) -> dict[str, float]:
    """Median seconds per stage, reading first."""
    times: dict[str, list[float]] = {}
    for run in range(runs + 1):
        start = time.perf_counter()
        capture = read_capture(path, kinds=kinds_needed(method), with_truth=False)
        read = time.perf_counter() - start
        result = reconstruct(capture, _options(method))
        if run > 0:  # the first compiles kernels and fills caches
            for name, seconds in {"read": read, **result.timings_s}.items():
                times.setdefault(name, []).append(seconds)
    return {name: statistics.median(values) for name, values in times.items()}


def _memory_of_a_fresh_process(path: Path, method: Method) -> int:
    """KiB. Twice, for the first process may have to compile kernels that the cache lacks, which takes memory."""
    command = [sys.executable, "-m", "benchmarks.single_shot", "--method", method, "--memory-of", str(path)]
    return min(int(subprocess.run(command, check=True, capture_output=True, text=True).stdout) for _ in range(2))


def _options(method: Method) -> ReconstructionOptions:
    return ReconstructionOptions(method=method, matching="trinocular")


def _peak_kib(path: Path, method: Method) -> int:
    reconstruct(read_capture(path, kinds=kinds_needed(method), with_truth=False), _options(method))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform != "darwin" else peak // 1024


if __name__ == "__main__":
    main()
