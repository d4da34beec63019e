"""What the audit found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from models.geometry.rig import Side
from service.acquisition.finding import Finding


@dataclass(frozen=True)
class AuditReport:
    """Result of an audit.

    statistics: JSON values; per side exposure, modulation, proof and motion figures, and what stays unproven with the
    reason. proven: per side, the patterns of which the images prove that they stand at their place.
    """

    findings: tuple[Finding, ...]
    statistics: dict[str, Any] = field(default_factory=dict)
    proven: dict[Side, list[str]] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """No finding forbids keeping the sequence."""
        return not any(finding.fatal for finding in self.findings)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Messages of what was found but does not forbid keeping the sequence."""
        return tuple(finding.message for finding in self.findings if not finding.fatal)
