"""Files and folders that are complete under their name or do not exist under it."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from models.errors import DuofringeError

_SYNC_THREADS = 8


def require_parent(path: Path) -> None:
    """Raise DuofringeError unless the folder that is to hold ``path`` exists; it is never created."""
    if not path.parent.is_dir():
        raise DuofringeError(f"output folder '{path.parent}' does not exist; create it first")


def _partial(path: Path) -> Path:
    """A hidden name beside ``path`` that nobody else uses, with the same suffix."""
    return path.with_name(f".{path.stem}.partial-{uuid.uuid4().hex[:8]}{path.suffix}")


def sync(path: Path) -> None:
    """Wait until a file's content, or the names in a folder, would survive a power failure."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path with the same suffix beside ``path``; on success it takes the place of ``path``."""
    require_parent(path)
    if path.is_dir():
        raise DuofringeError(f"output '{path}' is a folder; name a file")
    partial = _partial(path)
    try:
        yield partial
        sync(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """Yield a new folder beside ``path``; on success it is renamed to ``path``, which must not exist yet.

    durable: survive a power failure from then on. Without it a folder is whole for whatever a process meets, its own
    death included, but the disk may still be behind.
    """
    require_parent(path)
    if path.exists():
        raise DuofringeError(f"output '{path}' exists already; name a new folder or remove it")
    partial = _partial(path)
    partial.mkdir()
    try:
        yield partial
        if durable:
            with ThreadPoolExecutor(_SYNC_THREADS) as pool:  # the disk takes them together for little more than one
                for _ in pool.map(sync, list(partial.rglob("*"))):
                    pass
            sync(partial)
        partial.rename(path)
        if durable:
            sync(path.parent)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Write UTF-8 text so that a reader sees the old file or the new one, never a part."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
