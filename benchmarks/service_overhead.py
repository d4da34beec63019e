"""What the service adds to capture and reconstruction: seconds from request to answer that are neither."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import parser, show
from benchmarks.service_process import ServiceProcess

CALLS = 20
_WARM_CALLS = 3


def main(arguments: list[str] | None = None) -> None:
    made = parser("service_overhead", __doc__.splitlines()[0])
    made.add_argument("--calls", type=int, default=CALLS)
    given = made.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="duofringe-overhead-") as name:
        simulated, replayed = Path(name) / "simulated", Path(name) / "replayed"
        simulated.mkdir()
        replayed.mkdir()
        figures = {"simulated": measure(simulated, ["--driver", "simulated"], given.calls)}
        recorded = max((simulated / "library" / "captures").iterdir())
        figures["replayed"] = measure(replayed, ["--replay", str(recorded)], given.calls)
    rows = [["rig", "call", "capture", "reconstruction", "the rest", "share", "of it outside the handler"]]
    rows += [
        [
            rig,
            *(f"{1e3 * f[name]:.1f} ms" for name in ("call_s", "capture_s", "reconstruction_s", "rest_s")),
            f"{100 * f['share']:.1f} %",
            f"{1e3 * f['outside_s']:.1f} ms",
        ]
        for rig, f in figures.items()
    ]
    show(f"Median of {given.calls} warm calls of POST /v1/capture-and-reconstruct", rows, figures, as_json=given.json)


def measure(folder: Path, arguments: Sequence[str], calls: int) -> dict[str, Any]:
    """Medians of a service of its own, s.

    rest: call less capture and reconstruction. outside: call less the handler's total, that is HTTP and the client.
    share: rest to call, median of the calls' own.
    """
    with ServiceProcess(folder, arguments) as service, service.client() as client:
        found = []
        for number in range(calls + _WARM_CALLS):
            started = time.perf_counter()
            answer = client.post("/v1/capture-and-reconstruct", json={})
            call_s = time.perf_counter() - started
            answer.raise_for_status()
            timings = answer.json()["timings_s"]
            rest_s = call_s - timings["capture"] - timings["reconstruction"]
            if number >= _WARM_CALLS:
                found.append(
                    {
                        "call_s": call_s,
                        "capture_s": timings["capture"],
                        "reconstruction_s": timings["reconstruction"],
                        "rest_s": rest_s,
                        "outside_s": call_s - timings["total"],
                        "share": rest_s / call_s,
                    }
                )
    return {name: statistics.median(call[name] for call in found) for name in found[0]}


if __name__ == "__main__":
    main()
