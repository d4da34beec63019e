"""What the examination says of one thing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Symptom:
    """One thing looked at. remedy: what to do about it, empty when it is well."""

    subject: str
    state: Literal["ok", "warning", "fault"]
    finding: str
    remedy: str = ""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)
