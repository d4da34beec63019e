"""How captures are taken and judged; part of the configuration file."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from service.acquisition.audit import AuditLimits
from service.acquisition.checks import LATE_S


class AcquisitionSettings(BaseModel):
    """retakes: tries after the first. late_s: see ``check_sequence``. audit: thresholds on the images."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    retakes: int = Field(2, ge=0, le=10)
    late_s: float = Field(LATE_S, gt=0, le=10)
    lock_wait_s: float = Field(0.05, ge=0, le=10)
    preview_pattern: str | None = Field("white", max_length=64)
    audit: AuditLimits = Field(default_factory=AuditLimits)
