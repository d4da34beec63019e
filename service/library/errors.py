"""What can go wrong with the library on disk; each is one line for a person."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

from models.errors import DuofringeError


class LibraryError(DuofringeError):
    """The library cannot do what was asked."""


class InvalidIdError(LibraryError):
    """A text that is no id; nothing on disk was looked for."""


class CursorError(LibraryError):
    """A cursor or page size that this library did not hand out."""


class NotFoundError(LibraryError):
    """Nothing of that kind has that id, or no longer. kind: 'capture' or 'reconstruction'."""

    def __init__(self, kind: str, id: str, detail: str = "") -> None:
        super().__init__(f"{kind} '{id}' {detail or 'does not exist'}")
        self.kind = kind
        self.id = id


class BusyError(LibraryError):
    """Another process, or another request, holds what was asked for."""


class DamagedError(LibraryError):
    """Something in the library is incomplete or unreadable. reason: what, in one line."""

    def __init__(self, kind: str, id: str, reason: str) -> None:
        super().__init__(f"{kind} '{id}' is damaged: {reason}")
        self.kind = kind
        self.id = id
        self.reason = reason


class LimitError(LibraryError):
    """More than the library was set to hold."""


class DiskFullError(LimitError):
    """The disk is full, or would have less free space than must stay."""


class ArchiveError(LibraryError):
    """An uploaded archive is not a capture, or not a harmless one."""
