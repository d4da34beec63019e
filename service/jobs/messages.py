"""What a job's process tells the service, one JSON object a line."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Stage(_Message):
    """What is being done, and the share of it that is done."""

    says: Literal["stage"] = "stage"
    text: str
    share: Annotated[float, Field(ge=0, le=1)]


class Finished(_Message):
    """All is done, and its files are written."""

    says: Literal["finished"] = "finished"
    result: dict[str, Any]


class Failed(_Message):
    """It cannot be done, for a reason that a person can mend."""

    says: Literal["failed"] = "failed"
    reason: str


class Unexpected(_Message):
    """The program itself failed. trace: for the log."""

    says: Literal["unexpected"] = "unexpected"
    trace: str


Message = Annotated[Stage | Finished | Failed | Unexpected, Field(discriminator="says")]
MESSAGES: TypeAdapter[Message] = TypeAdapter(Message)
