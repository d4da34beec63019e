"""What a capture came to: the proven images, or why there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from models.capture import Capture
from models.errors import DuofringeError
from service.acquisition.finding import Finding


@dataclass(frozen=True, eq=False)
class CaptureOutcome:
    """A capture whose every frame was proven.

    timings_s: seconds per step of the attempt that was kept. acquisition_s: from the request until the last exposure
    was over, from where on the scene may move. attempts: how many it took. findings: of those that were not kept.
    """

    capture: Capture
    timings_s: dict[str, float]
    acquisition_s: float
    attempts: int = 1
    findings: tuple[Finding, ...] = field(default_factory=tuple)


class SequenceRefusedError(DuofringeError):
    """No attempt gave images that may be kept. findings: of all attempts; attempts: how many there were."""

    def __init__(self, findings: Sequence[Finding], attempts: int) -> None:
        tries = "1 attempt" if attempts == 1 else f"{attempts} attempts"
        more = f" (and {len(findings) - 1} more findings)" if len(findings) > 1 else ""
        super().__init__(f"the capture was refused after {tries}: {findings[-1].message}{more}")
        self.findings = tuple(findings)
        self.attempts = attempts
