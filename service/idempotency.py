"""``Idempotency-Key``: a request sent twice moves the rig once."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Annotated, Any

from fastapi import Header
from pydantic import BaseModel

from models.errors import DuofringeError
from service.library import Library
from service.library.idempotency import InProgress, Mismatch, Replay

IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=200,
        description="Any text of yours, new for every request. A request repeated with the same key gets the first "
        "answer again, also after a restart of the service; the rig does not move twice.",
    ),
]


class KeyMismatchError(DuofringeError):
    """The key belongs to another request."""


class KeyInProgressError(DuofringeError):
    """The first request with this key has not been answered yet."""

    def __init__(self, key: str) -> None:
        super().__init__(f"the first request with Idempotency-Key '{key}' is under way; ask again")
        self.retry_after_s = 1


Answer = tuple[dict[str, Any], bool]


def answer_once(
    library: Library, key: str | None, operation: str, request: BaseModel, work: Callable[[str], BaseModel]
) -> Answer:
    """The answer as JSON values, and whether it is a repeated one.

    work: gets the id that its result is to have. Only success is kept; after a failure the key may be used again.
    Raises KeyMismatchError, KeyInProgressError.
    """
    planned = library.new_id()
    if key is None:
        return work(planned).model_dump(mode="json"), False
    content = json.dumps([operation, request.model_dump(mode="json")], sort_keys=True)
    begun = library.idempotency.begin(key, hashlib.sha256(content.encode()).hexdigest(), planned)
    if isinstance(begun, Mismatch):
        raise KeyMismatchError(f"Idempotency-Key '{key}' was sent with another request; use a new key")
    if isinstance(begun, InProgress):
        raise KeyInProgressError(key)
    if isinstance(begun, Replay):
        return begun.body, True
    try:
        body = work(begun.planned_id).model_dump(mode="json")
    except BaseException:
        library.idempotency.abandon(key)
        raise
    library.idempotency.finish(key, 201, body)
    return body, False
