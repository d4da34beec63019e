"""Exposure of one view: too bright, too dark, too weak."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from models.patterns import PatternPlan
from service.acquisition.audit.axes import FloatArray
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.finding import Fault, Finding

WIDE_OPEN = 0.6
"""Share of the frames at the white level from which a pixel is over-exposed whatever the patterns."""


@dataclass(frozen=True)
class Exposure:
    """saturated: share of lit pixels at the white level in any image. first: exposure in which most of them are."""

    saturated: float
    first: int
    findings: tuple[Finding, ...]
    statistics: dict[str, Any]


def measure_exposure(
    levels: FloatArray,
    saturated: npt.NDArray[np.bool_],
    lit: npt.NDArray[np.bool_],
    plan: PatternPlan,
    device: str,
    white_level: int,
    limits: AuditLimits,
) -> Exposure:
    """Exposure over lit pixels; levels and saturated (exposures, rows, width), lit (rows, width).

    Pixels that are at the white level all the time count as lit: they would be.
    """
    counted = lit | (saturated.mean(axis=0) > WIDE_OPEN)
    total = max(int(np.count_nonzero(counted)), 1)
    by_frame = np.count_nonzero(saturated & counted, axis=(1, 2)) / total
    share = float(np.count_nonzero(saturated.any(axis=0) & counted)) / total
    first = int(np.flatnonzero(by_frame >= min(limits.saturated_fatal, float(by_frame.max())))[0])
    statistics: dict[str, Any] = {
        "saturated_percent": round(100 * share, 3),
        "lit_percent": round(100 * float(counted.mean()), 2),
    }
    findings = []
    for place, pattern in enumerate(plan.patterns):
        if pattern.is_uniform:
            inside = levels[place][counted]
            median = float(np.median(inside)) if inside.size else 0.0
            statistics[f"mean_{pattern.kind}"] = round(white_level * float(inside.mean()), 2) if inside.size else 0.0
            statistics[f"median_{pattern.kind}"] = round(white_level * median, 2)
    if share > limits.saturated_warning:
        fatal = share > limits.saturated_fatal
        advice = "shorten the exposure or lower the gain" if fatal else "check the exposure"
        findings.append(
            Finding(
                Fault.SATURATED,
                device,
                f"{device}: {100 * share:.1f} % of the lit pixels are at the white level, "
                f"first in exposure {first} ({plan.names[first]}); {advice}",
                first,
                plan.names[first],
                fatal,
            )
        )
    white, black = statistics.get("median_white", 0.0), statistics.get("median_black", 0.0)
    if white > 0 and black > limits.ambient_warning * white:
        place = next(k for k, p in enumerate(plan.patterns) if p.kind == "black")
        message = (
            f"{device}: exposure {place} (black) reads {100 * black / white:.0f} % of white where the scene is lit; "
            "shut out ambient light"
        )
        findings.append(Finding(Fault.SETTINGS, device, message, place, plan.names[place], fatal=False))
    return Exposure(share, first, tuple(findings), statistics)
