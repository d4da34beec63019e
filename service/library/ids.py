"""Ids: UUIDs of version 7 (RFC 9562), which sort by the time of their making."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

import re
import threading
import uuid
from datetime import UTC, datetime

import uuid_utils

from service.library.errors import InvalidIdError

_SYNTAX = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}")
_SHOWN = 60


class IdSource:
    """Makes ids, each greater than the one before even where the clock is set back."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last = 0

    def new_id(self) -> str:
        """A new id, lower case with hyphens."""
        with self._lock:
            self._last = max(uuid_utils.uuid7().int, self._last + 1)
            return str(uuid.UUID(int=self._last))


def is_id(text: str) -> bool:
    """Whether a text has the one spelling of an id that the library uses."""
    return _SYNTAX.fullmatch(text) is not None


def check_id(text: str) -> str:
    """Return an id as it is; raises InvalidIdError. The only door from the text of a request to a path."""
    if not is_id(text):
        shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
        raise InvalidIdError(f"{shown!r} is not an id; ids look like 0199c0de-7a11-7000-8000-000000000000")
    return text


def time_of(id: str) -> datetime:
    """When an id was made (UTC, to the millisecond); the start of 1970 for ids of another version."""
    value = uuid.UUID(id)
    return datetime.fromtimestamp((value.int >> 80) / 1000 if value.version == 7 else 0, UTC)
