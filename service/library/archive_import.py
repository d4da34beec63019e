"""A zip from outside becomes a capture folder, or leaves nothing: no name, size or number in it is believed."""

from __future__ import annotations

import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from models.atomic import atomic_folder
from models.capture import RECORD_NAME
from models.errors import DuofringeError
from service.library.disk import Space
from service.library.errors import ArchiveError, LibraryError
from service.library.verification import settle_record, verify_capture

_MIB = 2**20
_RECORD_BYTES = 2 * _MIB
_CHUNK = 64 * 1024
_KNOWN = re.compile(
    r"(?P<top>[^/]+/)?(?P<file>capture\.json|(left|right)/[a-z0-9_]{1,64}\.png|truth/([a-z0-9_]{1,64}\.npy|foreground\.png))"
)
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Only these inflate in small portions; the standard library lets bzip2 and LZMA fill the memory at once."""
_ENCRYPTED = 0x1
_DRIVE = re.compile(r"[A-Za-z]:")
_END_SIGNATURE, _END_BYTES, _LONGEST_COMMENT = b"PK\5\6", 22, 65_535
_ZIP64_SIGNATURE, _ZIP64_BYTES = b"PK\6\7", 20
_DIRECTORY_BYTES_PER_ENTRY = 512


@dataclass(frozen=True)
class ArchiveLimits:
    """What an uploaded capture may be.

    entries: files and folders in the zip. file_bytes, total_bytes: inflated, of one file and of all. ratio: inflated to
    packed, of the whole zip, beyond ``ratio_from_bytes``. pixel_bytes: of all images of the capture, decoded.
    """

    entries: int = 4096
    file_bytes: int = 192 * _MIB
    total_bytes: int = 2048 * _MIB
    ratio: float = 100.0
    ratio_from_bytes: int = 64 * _MIB
    pixel_bytes: int = 4096 * _MIB


def extract_capture(source: Path | BinaryIO, folder: Path, limits: ArchiveLimits, space: Space) -> None:
    """Make the capture folder ``folder``, whose name is its new id, from a zip of one capture folder.

    Files that belong to no capture are left out. Memory stays within one image and one portion of a file. Raises
    ArchiveError, and DiskFullError before anything is written when it would not fit.
    """
    with _open(source, limits) as (archive, packed):
        kept = _select(archive, limits)
        space.require(sum(entry.file_size for entry in kept.values()))
        with atomic_folder(folder) as partial:
            _write(archive, kept, partial, limits, packed)
            try:
                outline = verify_capture(partial, limits.pixel_bytes)
                settle_record(partial, folder.name, outline)
            except LibraryError:
                raise
            except DuofringeError as error:
                text = str(error).replace(f"{partial}/", "").replace(str(partial), "archive")
                raise ArchiveError(f"the archive holds no whole capture: {text}") from error


@contextmanager
def _open(source: Path | BinaryIO, limits: ArchiveLimits) -> Iterator[tuple[zipfile.ZipFile, int]]:
    """The zip and its size in bytes, after a look at how large its directory is: zipfile reads all of that at once."""
    if isinstance(source, Path):
        with source.open("rb") as file, _open(file, limits) as opened:
            yield opened
        return
    size = source.seek(0, 2)
    _check_directory(source, size, limits)
    with _faults_of_archive():
        archive = zipfile.ZipFile(source)
    with archive:
        yield archive, size


def _check_directory(file: BinaryIO, size: int, limits: ArchiveLimits) -> None:
    tail_bytes = min(size, _END_BYTES + _LONGEST_COMMENT + _ZIP64_BYTES)
    file.seek(size - tail_bytes)
    tail = file.read(tail_bytes)
    file.seek(0)
    at = len(tail) - _END_BYTES
    if at < 0 or not (tail[at:].startswith(_END_SIGNATURE) and tail.endswith(b"\0\0")):  # as zipfile looks for it
        at = tail.rfind(_END_SIGNATURE)
    if at < 0 or at + _END_BYTES > len(tail):
        raise ArchiveError("the upload is not a zip archive")
    if tail[max(0, at - _ZIP64_BYTES) : at].startswith(_ZIP64_SIGNATURE):
        raise ArchiveError("the archive is in the zip64 format; a capture needs no such size")
    entries, directory_bytes = struct.unpack_from("<HI", tail, at + 10)
    if entries > limits.entries or directory_bytes > limits.entries * _DIRECTORY_BYTES_PER_ENTRY:
        raise ArchiveError(f"the archive has more than {limits.entries} entries")


@contextmanager
def _faults_of_archive() -> Iterator[None]:
    """Whatever zipfile and zlib raise over a malformed archive, as one kind."""
    try:
        yield
    except (zipfile.BadZipFile, zlib.error, struct.error, RuntimeError, EOFError, ValueError, OSError) as error:
        raise ArchiveError(f"the archive is damaged ({' '.join(str(error).split())[:120]})") from error


def _select(archive: zipfile.ZipFile, limits: ArchiveLimits) -> dict[str, zipfile.ZipInfo]:
    """Entries of the capture by their place in its folder, once every entry was found harmless."""
    entries = archive.infolist()
    if len(entries) > limits.entries:
        raise ArchiveError(f"the archive has more than {limits.entries} entries")
    seen: set[str] = set()
    tops: set[str] = set()
    kept: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        name = _checked_name(entry)
        if name in seen:
            raise ArchiveError(f"the archive has {name!r} twice")
        seen.add(name)
        match = _KNOWN.fullmatch(name)
        if match is None or entry.is_dir():
            continue
        tops.add(match["top"] or "")
        kept[match["file"]] = entry
    if not kept:
        raise ArchiveError(f"the archive holds no capture: neither {RECORD_NAME} nor images in left/")
    if len(tops) > 1:
        raise ArchiveError("the archive holds more than one capture; upload them one by one")
    return kept


def _checked_name(entry: zipfile.ZipInfo) -> str:
    """Name of an entry without a closing slash; raises ArchiveError for one that is no plain file or folder."""
    name = entry.orig_filename
    shown = repr(name if len(name) <= 80 else f"{name[:80]}...")
    parts = name.removesuffix("/").split("/")
    if not name.isprintable() or "\\" in name or _DRIVE.match(name) or any(p in ("", ".", "..") for p in parts):
        raise ArchiveError(f"the archive has an entry with the name {shown}, which could leave its folder")
    if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise ArchiveError(f"the archive has {shown}, which is a link or a device; only files are taken")
    if entry.flag_bits & _ENCRYPTED:
        raise ArchiveError(f"the archive has {shown}, which is encrypted; pack it without a password")
    if entry.compress_type not in _METHODS:
        raise ArchiveError(f"the archive has {shown} in a rare compression; pack it with 'store' or 'deflate'")
    return name.removesuffix("/")


def _write(
    archive: zipfile.ZipFile, kept: dict[str, zipfile.ZipInfo], folder: Path, limits: ArchiveLimits, packed: int
) -> None:
    total = 0
    for name, entry in kept.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        most = _RECORD_BYTES if name == RECORD_NAME else limits.file_bytes
        written = 0
        with path.open("wb") as file:
            for data in _inflate(archive, entry):
                written += len(data)
                total += len(data)
                if written > most:
                    raise ArchiveError(f"the archive has {name} of more than {most // _MIB} MiB")
                if total > limits.total_bytes:
                    raise ArchiveError(f"the archive holds more than {limits.total_bytes // _MIB} MiB")
                if total > limits.ratio_from_bytes and total > limits.ratio * packed:
                    raise ArchiveError(f"the archive grows more than {limits.ratio:g} times when it is unpacked")
                file.write(data)


def _inflate(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Iterator[bytes]:
    with _faults_of_archive():
        source = archive.open(entry)
    with source:
        while True:
            with _faults_of_archive():
                data = source.read(_CHUNK)
            if not data:
                return
            yield data
