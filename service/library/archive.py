"""A capture as one zip, made while it is sent: PNGs are compressed already, so its size is known before."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_LOCAL_HEADER, _DESCRIPTOR, _CENTRAL_HEADER, _END = 30, 16, 46, 22
_CHUNK = 256 * 1024
_EPOCH = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class ArchiveStream:
    """name: of the file to offer. size: bytes of all chunks together. chunks: the zip itself, to be read once."""

    name: str
    size: int
    chunks: Iterator[bytes]


class _Spout(io.RawIOBase):
    """A file that cannot be rewound, and gives away what was written to it."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: object) -> int:
        part = bytes(memoryview(data))  # type: ignore[arg-type]  # zipfile writes bytes
        self._parts.append(part)
        return len(part)

    def take(self) -> bytes:
        taken = b"".join(self._parts)
        self._parts.clear()
        return taken


def stream_archive(folder: Path) -> ArchiveStream:
    """Zip of a folder whose files nobody changes, entries named ``<folder>/<file>``.

    Raises FileNotFoundError when the folder vanishes; when that happens later, the chunks end in it.
    """
    files = sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith("."))
    if not files:
        raise FileNotFoundError(folder)
    names = {path: f"{folder.name}/{path.relative_to(folder).as_posix()}" for path in files}
    overhead = sum(_LOCAL_HEADER + _DESCRIPTOR + _CENTRAL_HEADER + 2 * len(n.encode()) for n in names.values())
    size = overhead + _END + sum(path.stat().st_size for path in files)
    return ArchiveStream(f"{folder.name}.zip", size, _chunks(names))


def _chunks(names: dict[Path, str]) -> Iterator[bytes]:
    spout = _Spout()
    with zipfile.ZipFile(spout, "w", zipfile.ZIP_STORED, allowZip64=False) as archive:
        for path, name in names.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.external_attr = 0o644 << 16
            with path.open("rb") as source, archive.open(entry, "w") as target:
                while data := source.read(_CHUNK):
                    target.write(data)
                    yield spout.take()
    yield spout.take()
