"""Choose the settings of the transform methods on simulated scenes, and compare the methods there with ``wft``.

Every combination of a small grid is judged by the share of lit pixels whose phase is within 0.35 rad of the truth, mean
of both carriers. The best are written to the package, from which the methods read them; ``--keep`` measures those
that are stored and writes nothing. The seed of the published tables is refused: it would no longer be fresh.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import DEPTH_RANGE, PUBLISHED_SEED
from benchmarks.report import limit_threads, parser, show
from drivers.simulator.dataset import render_sample
from models.atomic import write_text_atomically
from models.capture import Capture, read_capture
from models.dataset import open_dataset
from models.errors import DatasetError
from models.geometry.rig import Side
from models.patterns import make_plan
from models.phase.fringe import FringePhase
from models.phase.shearlet import Shearlet, ShearletSettings
from models.phase.single_exposure import SingleExposure
from models.phase.transform_settings import PATH, chosen_settings
from models.phase.wavelet1d import Wavelet1d, Wavelet1dSettings
from models.phase.wavelet2d import Wavelet2d, Wavelet2dSettings
from models.phase.wft import WindowedFourierTransform

LIMIT_RAD = 0.35
SIDE: Side = "left"
"""The view whose phases have a truth."""
TRANSFORMS: dict[str, tuple[type[Wavelet1d | Wavelet2d | Shearlet], type[Any]]] = {
    "wavelet1d": (Wavelet1d, Wavelet1dSettings),
    "wavelet2d": (Wavelet2d, Wavelet2dSettings),
    "shearlet": (Shearlet, ShearletSettings),
}
GRIDS: dict[str, dict[str, tuple[float, ...]]] = {
    "wavelet1d": {
        "window": (0.6, 0.8, 1.0, 1.2),
        "scales": (8,),
        "rounds": (1, 2, 3),
        "background": (0.35, 0.5),
    },
    "wavelet2d": {
        "window": (0.5, 0.7, 0.9),
        "aspect": (0.5, 0.8),
        "scales": (6,),
        "orientations": (3,),
        "rounds": (1, 2),
        "background": (0.35, 0.5),
    },
    "shearlet": {
        "voices": (1.2, 1.6, 2.0, 2.5),
        "shear": (0.3, 0.5, 0.8),
        "noise": (2.0,),
        "relative": (0.1, 0.3),
        "rounds": (1, 2, 4),
        "background": (0.35, 0.5),
    },
}


def main() -> None:
    arguments = parser("select_transforms", __doc__ or "")
    scenes = arguments.add_mutually_exclusive_group()
    scenes.add_argument("--dataset", type=Path, metavar="FOLDER", help="take the scenes from its split val")
    scenes.add_argument("--seed", type=int, default=5, help="of fresh scenes (default 5)")
    arguments.add_argument("--samples", type=int, default=4, help="number of scenes at most (default 4)")
    arguments.add_argument("--keep", action="store_true", help="measure the stored settings, choose nothing")
    options = arguments.parse_args()
    limit_threads()
    try:
        captures = validation_scenes(options)
    except DatasetError as error:
        arguments.error(str(error))
    source = {"dataset": options.dataset.name} if options.dataset else {"seed": options.seed}
    source["samples"] = len(captures)
    settings = {name: chosen_settings(name) if options.keep else best_settings(name, captures) for name in TRANSFORMS}
    results = {"wft": measure(WindowedFourierTransform(captures[0].rig, DEPTH_RANGE), captures)}
    for name, chosen in settings.items():
        results[name] = measure(extractor(name, chosen, captures[0]), captures)
    if not options.keep:
        stored = {name: {"settings": chosen, "figures": results[name]} for name, chosen in settings.items()}
        write_text_atomically(PATH, json.dumps({"scenes": source, "methods": stored}, indent=2) + "\n")
    rows = [["method", "high", "low", "kept", "time per pair"]]
    rows += [
        [
            name,
            f"{r['high_percent']:.1f} %",
            f"{r['low_percent']:.1f} %",
            f"{r['kept_percent']:.1f} %",
            f"{r['pair_s']:.2f} s",
        ]
        for name, r in results.items()
    ]
    title = f"Lit pixels within {LIMIT_RAD:g} rad, {source}"
    show(
        title,
        rows,
        {"benchmark": "select_transforms", "scenes": source, "settings": settings, "results": results},
        as_json=options.json,
    )


def validation_scenes(options: argparse.Namespace) -> list[Capture]:
    """Composite captures with truth; raises DatasetError for none, and for those of the published table."""
    if options.samples < 1:
        raise DatasetError("--samples must be at least 1")
    if options.dataset is None:
        if options.seed == PUBLISHED_SEED:
            raise DatasetError(f"seed {PUBLISHED_SEED} is kept for the published tables; take another")
        return [render_sample(options.seed, index, make_plan("composite")) for index in range(options.samples)]
    dataset = open_dataset(options.dataset)
    paths = dataset.capture_paths("val")[: options.samples]
    captures = [read_capture(path, kinds={"composite"}) for path in paths]
    for capture in captures:
        if capture.truth is None or capture.rig is None:
            raise DatasetError(f"{capture.source}: has no truth or no calibration; take simulated captures")
        if capture.record.settings.get("seed") == PUBLISHED_SEED:
            raise DatasetError(f"{capture.source}: seed {PUBLISHED_SEED} is kept for the published tables")
    return captures


def extractor(name: str, settings: Mapping[str, Any], capture: Capture) -> SingleExposure:
    """The method with these settings, for the rig of the capture."""
    method, settings_class = TRANSFORMS[name]
    return method(capture.rig, DEPTH_RANGE, settings_class(**settings))


def best_settings(name: str, captures: Sequence[Capture]) -> dict[str, Any]:
    """The combination of the method's grid with the largest mean share; the first of equals."""
    alone = [_one_view(capture) for capture in captures]

    def figure(settings: Mapping[str, Any]) -> float:
        method = extractor(name, settings, alone[0])
        return statistics.mean(float(shares(c, method.extract(c)[SIDE])[:2].mean()) for c in alone)

    return max(combinations(GRIDS[name]), key=figure)


def combinations(grid: Mapping[str, Sequence[float]]) -> Iterator[dict[str, Any]]:
    """Every combination of a grid's values."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def shares(capture: Capture, phase: FringePhase) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Of the lit pixels: the share with the high phase right, with the low phase right, and kept by the mask.

    Lit pixels that the mask drops count as wrong.
    """
    truth = capture.truth
    assert truth is not None
    lit = truth.foreground & np.isfinite(truth.projector_column)
    kept = phase.mask.numpy()[lit] == 0
    column = truth.projector_column[lit].astype(np.float64)
    found = [kept]
    for carrier, period in zip(phase.carriers.numpy(), phase.periods, strict=True):
        error = np.angle(carrier[lit] * np.exp(-2j * np.pi * column / period))
        found.insert(-1, kept & (np.abs(error) < LIMIT_RAD))
    return np.array([share.mean() for share in found])


def measure(method: SingleExposure, captures: Sequence[Capture]) -> dict[str, float]:
    """Means over the scenes, and the median seconds for both views."""
    method.extract(captures[0])  # fills caches
    times, found = [], []
    for capture in captures:
        start = time.perf_counter()
        phases = method.extract(capture)
        times.append(time.perf_counter() - start)
        found.append(shares(capture, phases[SIDE]))
    high, low, kept = 100 * np.mean(found, axis=0)
    return {
        "high_percent": round(float(high), 2),
        "low_percent": round(float(low), 2),
        "kept_percent": round(float(kept), 2),
        "pair_s": round(statistics.median(times), 3),
    }


def _one_view(capture: Capture) -> Capture:
    return Capture(capture.plan, {SIDE: capture.images[SIDE]}, capture.rig, capture.record, capture.truth)


if __name__ == "__main__":
    main()
