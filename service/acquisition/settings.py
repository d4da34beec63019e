"""How captures are taken and judged; part of the configuration file."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from models.errors import DuofringeError
from models.patterns import make_pattern
from service.acquisition.audit import AuditLimits
from service.acquisition.checks import LATE_S


class AcquisitionSettings(BaseModel):
    """retakes: tries after the first. late_s: see ``check_sequence``. audit: thresholds on the images.

    trigger: "projector" where its trigger output is wired to both cameras; "software" holds each pattern and calls the
    cameras, which is slow and needs no wire. watch_s: how often idle devices are asked whether they are still there,
    and lost ones looked for; 0 for never. preview_pattern: what the projector holds during the live view; None, or
    empty text in a file, for dark.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    retakes: int = Field(2, ge=0, le=10)
    late_s: float = Field(LATE_S, gt=0, le=10)
    lock_wait_s: float = Field(0.05, ge=0, le=10)
    trigger: Literal["projector", "software"] = "projector"
    watch_s: float = Field(2.0, ge=0, le=3600)
    preview_pattern: str | None = Field("white", max_length=64)
    audit: AuditLimits = Field(default_factory=AuditLimits)

    @field_validator("preview_pattern")
    @classmethod
    def _is_a_pattern(cls, name: str | None) -> str | None:
        if not name:
            return None
        try:
            make_pattern(name)
        except DuofringeError as error:
            raise ValueError(str(error)) from error
        return name
