"""``job.json``: all that is known about a job; its folder is the truth, and nothing else remembers it."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

JobKind = Literal["training", "evaluation"]
JobState = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
RECORD_NAME = "job.json"
RESUMABLE: frozenset[JobState] = frozenset({"interrupted", "failed"})
UNFINISHED: frozenset[JobState] = frozenset({"queued", "running"})


class JobRecord(BaseModel):
    """A job. kind: None where the record is damaged, which ``error`` then tells.

    share, remaining_s: of the stage under way. request: as it was validated. result: of a job that is done.
    """

    model_config = ConfigDict(extra="forbid", populate_by_name=True, frozen=True, allow_inf_nan=False)

    schema_: Literal["job/1"] = Field(default="job/1", alias="schema")
    id: str
    kind: JobKind | None
    state: JobState
    created: datetime
    started: datetime | None = None
    ended: datetime | None = None
    stage: str = ""
    share: float = Field(0.0, ge=0, le=1)
    remaining_s: float | None = Field(None, ge=0)
    request: dict[str, Any] = {}
    result: dict[str, Any] | None = None
    error: str | None = None

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"
