"""Pages of a list that grows and shrinks while it is read: a cursor names the last id seen, not a place."""

from __future__ import annotations

import base64
import binascii
from dataclasses import dataclass
from typing import Generic, TypeVar

from service.library.errors import CursorError
from service.library.ids import is_id

Item = TypeVar("Item")
MAXIMUM_LIMIT = 200
_NEWEST, _OLDEST = "n", "o"


@dataclass(frozen=True)
class Page(Generic[Item]):
    """items: in the order asked for. next_cursor: for the page after this one; None when there is none."""

    items: tuple[Item, ...]
    next_cursor: str | None


def check_limit(limit: int) -> int:
    """Return a page size as it is; raises CursorError when it is out of range."""
    if not 1 <= limit <= MAXIMUM_LIMIT:
        raise CursorError(f"limit is {limit}; ask for 1 to {MAXIMUM_LIMIT} items")
    return limit


def encode_cursor(last: str, *, newest_first: bool) -> str:
    """Opaque text for 'what follows this id in this order'."""
    return base64.urlsafe_b64encode(f"{_NEWEST if newest_first else _OLDEST}{last}".encode()).decode().rstrip("=")


def decode_cursor(cursor: str, *, newest_first: bool) -> str:
    """The id in a cursor; raises CursorError when it is not one of ours or belongs to the other order."""
    try:
        text = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode("ascii")
    except (binascii.Error, ValueError) as error:
        raise CursorError("cursor is not one that this service gave; start again without it") from error
    order, last = text[:1], text[1:]
    if (
        order not in (_NEWEST, _OLDEST)
        or not is_id(last)
        or encode_cursor(last, newest_first=order == _NEWEST) != cursor
    ):
        raise CursorError("cursor is not one that this service gave; start again without it")
    if (order == _NEWEST) != newest_first:
        raise CursorError("cursor belongs to the other order of the list; start again without it")
    return last
