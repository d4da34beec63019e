"""The windowed Fourier filter on its decimated grid, against one full-size FFT pair per frequency.

Both filter two bands of both views of a composite exposure, with the same frequencies, windows, thresholds and threads.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from benchmarks.report import THREADS, limit_threads, parser, show
from drivers.simulator.dataset import render_sample
from models.geometry.rig import SIDES
from models.patterns import make_plan
from models.phase.wft import WftSettings
from models.phase.windowed_fourier import Band, Spectrum, Threshold, WindowedFourierFilter

BANDS = {"high": Band((0.55, 1.0), (-0.25, 0.25)), "low": Band((0.35, 0.62), (-0.25, 0.25))}
"""rad/px: about the carriers of the reference rig, 0.757 and 0.487 rad/px at the middle of its range."""
TARGETS = {10.0: 25.0, 6.0: 8.0}
"""Least ratio of times by sigma, px."""
THRESHOLD = Threshold(noise=3.0)
LARGEST_DIFFERENCE = 0.02
SEED = 2


class StraightforwardFilter:
    """The filter as the paper writes it: each frequency's window over the whole spectrum, there and back."""

    def __init__(self, padded: tuple[int, int], fast: WindowedFourierFilter, sigma: float) -> None:
        self.windows: list[tuple[torch.Tensor, torch.Tensor]] = []
        for y in fast._rows.bins:
            for x in fast._columns.bins:
                self.windows.append((_gaussian(padded[0], y, sigma)[:, None], _gaussian(padded[1], x, sigma)))
        down, across = self.windows[0]
        # Standard deviation of a coefficient for unit white noise in the image.
        self.coefficient_noise = math.sqrt(float((down**2).mean() * (across**2).mean()))

    def __call__(self, spectrum: Spectrum, threshold: Threshold) -> torch.Tensor:
        limit = (threshold.noise * self.coefficient_noise) * spectrum.noise[:, None, None]
        total = torch.zeros_like(spectrum.values)
        for down, across in self.windows:
            window = down * across
            coefficient = torch.fft.ifft2(spectrum.values * window)
            kept = torch.where(coefficient.abs() >= limit, coefficient, 0)
            total += torch.fft.fft2(kept) * window
        return spectrum.crop_back(torch.fft.ifft2(total))


def _gaussian(length: int, centre: int, sigma: float) -> torch.Tensor:
    """Spectrum of a Gaussian window of standard deviation sigma (px) about a bin, (length,)."""
    distance = (torch.arange(length) - centre + length // 2) % length - length // 2
    return torch.exp(-0.5 * (distance * (2 * math.pi * sigma / length)) ** 2)


def main() -> None:
    arguments = parser("wft_speed", __doc__ or "")
    arguments.add_argument("--runs", type=int, default=7, help="alternating runs of both; medians count (default 7)")
    arguments.add_argument("--threads", type=int, default=THREADS, help=f"of both (default {THREADS})")
    options = arguments.parse_args()
    limit_threads(options.threads)
    images = _images()
    rows = [["sigma", "frequencies", "decimated", "full size", "ratio", "target", "phase rms", "limit"]]
    results = []
    for sigma, target in TARGETS.items():
        result = compare(images, sigma, options.runs)
        results.append({**result, "target_ratio": target})
        rows.append(
            [
                f"{sigma:g} px",
                str(result["frequencies"]),
                f"{1000 * result['decimated_s']:.0f} ms",
                f"{1000 * result['full_size_s']:.0f} ms",
                f"{result['ratio']:.1f}",
                f">= {target:g}",
                f"{result['phase_rms_rad']:.4f} rad",
                f"<= {LARGEST_DIFFERENCE:g}",
            ]
        )
    how = f"{options.threads} threads, median of {options.runs} alternating runs"
    title = f"Windowed Fourier filter, two bands, both views 640x480, {how}"
    show(title, rows, {"benchmark": "wft_speed", "results": results}, as_json=options.json)


def compare(images: torch.Tensor, sigma: float, runs: int) -> dict[str, Any]:
    """Times and phases of both ways for images (V, H, W), share of full scale."""
    margin = int(2 * sigma)
    padded = tuple(Spectrum(images, margin).values.shape[-2:])
    size = (padded[0], padded[1])
    fast = [WindowedFourierFilter(size, band, sigma) for band in BANDS.values()]
    plain = [StraightforwardFilter(size, each, sigma) for each in fast]

    def run(filters: list[Any]) -> list[torch.Tensor]:
        spectrum = Spectrum(images, margin)
        return [each(spectrum, THRESHOLD) for each in filters]

    found, expected = run(fast), run(plain)  # also warms both up
    times: dict[str, list[float]] = {"fast": [], "plain": []}
    for _ in range(runs):
        times["fast"].append(_seconds(lambda: run(fast)))
        times["plain"].append(_seconds(lambda: run(plain)))
    ratios = [p / f for p, f in zip(times["plain"], times["fast"], strict=True)]
    return {
        "sigma_px": sigma,
        "frequencies": sum(each.frequencies for each in fast),
        "decimated_s": statistics.median(times["fast"]),
        "full_size_s": statistics.median(times["plain"]),
        "ratio": statistics.median(ratios),
        "ratios": [round(r, 2) for r in ratios],
        "phase_rms_rad": max(_phase_rms(f, e) for f, e in zip(found, expected, strict=True)),
    }


def _phase_rms(found: torch.Tensor, expected: torch.Tensor) -> float:
    """rms phase difference, rad, where the method ``wft`` would use the phase: above its least modulation."""
    seen = (expected.abs() > WftSettings().minimum_modulation) & (found.abs() > 0)
    return float((torch.angle(found * expected.conj())[seen] ** 2).mean().sqrt())


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _images() -> torch.Tensor:
    capture = render_sample(SEED, 0, make_plan("composite"))
    return torch.from_numpy(np.concatenate([capture.stack(side, "composite") for side in SIDES]))


if __name__ == "__main__":
    main()
