"""Writing a firmware file into the projector's flash, so that an interruption at any moment can be mended.

The sector with the flash table goes first when the old firmware is erased and comes last when the new one is written,
and of that sector the signature comes last of all. In between there is no table, so the controller stays in its
bootloader after a loss of power, and the next run goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.errors import DriverError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.bootloader import (
    SECTOR_BYTES,
    Bootloader,
    BootloaderTimes,
    FlashError,
    enter,
    running_version,
    wait_for_program,
)
from drivers.lightcrafter.firmware import LARGEST_FILE, FirmwareFile, read_firmware
from drivers.lightcrafter.firmware_record import DIGEST, digest, read_record
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES, SIGNATURE
from drivers.lightcrafter.splash import FirmwareError
from drivers.lightcrafter.transport import read
from drivers.lightcrafter.usb import UsbTransport
from drivers.lightcrafter.values import Release
from models.atomic import write_text_atomically

Report = Callable[[str, float], None]
"""Takes what is done and the share of the bytes that are in place, 0..1."""
_SUM_MODULUS = 1 << 32
_ATTEMPTS = 2
_TABLE = BOOTLOADER_BYTES
_LARGEST_RECORD = 1_000_000


class UploadStoppedError(FlashError):
    """The caller wished an end. The projector waits in its bootloader until the upload is taken up again."""


class UploadProgress(BaseModel):
    """How far an upload has come. location: of the projector. erased, written: addresses of sectors."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["duofringe-upload/1"] = "duofringe-upload/1"
    sha256: str = Field(pattern=DIGEST)
    location: str
    erased: tuple[int, ...] = ()
    written: tuple[int, ...] = ()


@dataclass(frozen=True)
class UploadOutcome:
    """release: of the firmware that runs now. resumed: an earlier upload was taken up again."""

    location: str
    release: Release
    images: int
    written: int
    kept: int
    resumed: bool


def progress_path(firmware: Path) -> Path:
    """``flash.bin.upload.json`` beside ``flash.bin``."""
    return firmware.with_name(firmware.name + ".upload.json")


def read_upload(path: Path) -> bytes:
    """The bytes of a firmware that may be written to a flash: every image decodes, the record beside it agrees.

    Raises FirmwareError.
    """
    data = read_firmware(path)
    firmware = FirmwareFile.parse_of(path, data)
    read_record(path, data)
    if len(data) > LARGEST_FILE:
        raise FirmwareError(f"{path} has {len(data)} bytes; {LARGEST_FILE} are safe; store fewer images")
    for index in range(len(firmware.blobs)):
        firmware.image(index)
    return data


def upload(
    path: Path,
    transport: UsbTransport,
    *,
    only_images: bool = False,
    report: Report = lambda stage, share: None,
    stopped: Callable[[], bool] = lambda: False,
    times: BootloaderTimes | None = None,
) -> UploadOutcome:
    """Write a firmware file into the flash of the projector, verify it and start it.

    only_images: leave the sectors of the program whose checksum is that of the file. stopped: asked between messages.
    The progress is kept in ``progress_path`` and gone after success. The transport is closed at the end.

    Raises FirmwareError for an unusable file, FlashError for what goes wrong in the flash, UploadStoppedError, and
    DriverError; after any of them the same call takes the upload up again.
    """
    data = read_upload(path)
    times = times or BootloaderTimes()
    try:
        transport.open()
        location = transport.location
        resumed = running_version(transport) is None
        if not resumed:
            report("entering the bootloader", 0.0)
            enter(transport, times)
        _same_place(transport, location)
        bootloader = Bootloader(transport, times)
        run = _Run(bootloader, path, data, location, report, stopped)
        part = bootloader.identify()
        bootloader.select(part)
        if not resumed:
            _rehearse(bootloader)
        run.keep(only_images)
        written = run.write()
        report("starting the new firmware", 1.0)
        bootloader.leave()
        versions = wait_for_program(transport, times)
        _same_place(transport, location)
        there = read(transport, c.FLASH_IMAGES)
    finally:
        transport.close()
    images = len(FirmwareFile.parse(data).blobs)
    if there != images:
        raise FlashError(f"the projector finds {there} images in its flash where {path} has {images}; write it again")
    progress_path(path).unlink(missing_ok=True)
    return UploadOutcome(location, versions.application, images, written, run.sectors - written, resumed)


def rehearse(
    transport: UsbTransport, *, report: Report = lambda stage, share: None, times: BootloaderTimes | None = None
) -> Release:
    """Enter the bootloader, have it identify the flash and sum bytes that are known, and start the firmware again.

    Nothing is erased or written. Returns the release that runs. Raises FlashError and DriverError.
    """
    times = times or BootloaderTimes()
    try:
        transport.open()
        location = transport.location
        if running_version(transport) is None:
            raise FlashError("the projector waits in its bootloader already; flash it, or switch it off and on")
        report("entering the bootloader", 0.0)
        enter(transport, times)
        _same_place(transport, location)
        bootloader = Bootloader(transport, times)
        try:
            bootloader.select(bootloader.identify())
            report("summing the flash table's signature", 0.5)
            _rehearse(bootloader)
        finally:
            with suppress(DriverError):
                bootloader.leave()
        report("starting the firmware", 1.0)
        return wait_for_program(transport, times).application
    finally:
        transport.close()


def _rehearse(bootloader: Bootloader) -> None:
    """Sum bytes that are known, while nothing is erased yet: a projector that ran has the signature of its table."""
    if bootloader.checksum(_TABLE, len(SIGNATURE)) != sum(SIGNATURE):
        raise FlashError(
            "the bootloader does not find the flash table of the firmware that ran, so it may not understand what it "
            "is told; nothing was erased; switch the projector off and on, and write the firmware with TI's GUI"
        )


def _same_place(transport: UsbTransport, location: str) -> None:
    if transport.location != location:
        raise FlashError(f"the projector was at {location} and is at {transport.location} now; put it back")


class _Run:
    """One pass over the sectors of a file."""

    def __init__(
        self,
        bootloader: Bootloader,
        path: Path,
        data: bytes,
        location: str,
        report: Report,
        stopped: Callable[[], bool],
    ) -> None:
        self._bootloader = bootloader
        self._path = progress_path(path)
        self._data = data
        self._report = report
        self._stopped = stopped
        self._program_end = len(FirmwareFile.parse(data).program)
        self._sectors = range(BOOTLOADER_BYTES, len(data), SECTOR_BYTES)
        self._progress = _read_progress(self._path, digest(data), location)

    @property
    def sectors(self) -> int:
        """How many the file takes."""
        return len(self._sectors)

    def keep(self, only_images: bool) -> None:
        """Find the sectors that need not be written, by their checksums."""
        candidates = set(self._progress.written)
        if only_images:
            candidates |= {at for at in self._sectors if at + SECTOR_BYTES <= self._program_end}
        kept = []
        for at in sorted(candidates & set(self._sectors)):
            self._step("comparing", at)
            if self._agrees(at):
                kept.append(at)
        self._note(erased=(), written=kept)

    def write(self) -> int:
        """Bring every other sector into place, the one with the flash table last; returns how many."""
        wanting = [at for at in self._sectors if at not in self._progress.written]
        if not wanting:
            return 0
        self._step("erasing", _TABLE)
        self._erase(_TABLE)
        body = [at for at in wanting if at != _TABLE]
        for at in body:
            self._step("erasing", at)
            self._erase(at)
            self._fill(at, self._content(at))
            self._note(erased=[e for e in self._progress.erased if e != at], written=[*self._progress.written, at])
        self._fill(_TABLE + len(SIGNATURE), self._content(_TABLE)[len(SIGNATURE) :])
        self._verify(_TABLE + len(SIGNATURE))
        self._bootloader.write(_TABLE, self._content(_TABLE)[: len(SIGNATURE)])
        try:
            self._verify(_TABLE)
        except FlashError:
            self._erase(_TABLE)  # no controller shall start from a flash that is wrong
            raise
        self._note(erased=(), written=[*self._progress.written, _TABLE])
        return len(body) + 1

    def _fill(self, at: int, content: bytes) -> None:
        """Write into a sector that is erased, and check it; erase and write it once more where that fails."""
        sector = at // SECTOR_BYTES * SECTOR_BYTES
        for attempt in range(_ATTEMPTS):
            if attempt:
                self._erase(sector)
            self._bootloader.write(at, content, lambda sent: self._step("writing", sector, sent))
            if self._bootloader.checksum(at, len(content)) == sum(content) % _SUM_MODULUS:
                return
        raise FlashError(
            f"the flash's checksum at 0x{at:X} is wrong after {_ATTEMPTS} tries; attach the projector to this "
            "computer directly, not through a virtual machine or a hub, and run the same command again"
        )

    def _erase(self, at: int) -> None:
        self._note(erased=self._progress.erased, written=[w for w in self._progress.written if w != at])
        self._bootloader.erase(at)
        self._note(erased=[*self._progress.erased, at], written=self._progress.written)

    def _verify(self, start: int) -> None:
        """Everything from there to the end."""
        self._report("verifying", self._share(len(self._content(_TABLE))))
        content = self._data[start:]
        if self._bootloader.checksum(start, len(content)) != sum(content) % _SUM_MODULUS:
            self._note(erased=(), written=())
            raise FlashError("the checksum of the whole flash is wrong; run the same command again to write all of it")

    def _agrees(self, at: int) -> bool:
        content = self._content(at)
        return self._bootloader.checksum(at, len(content)) == sum(content) % _SUM_MODULUS

    def _content(self, at: int) -> bytes:
        return self._data[at : at + SECTOR_BYTES]

    def _step(self, stage: str, at: int, sent: int = 0) -> None:
        if self._stopped():
            raise UploadStoppedError(
                "the upload was stopped; the projector waits in its bootloader; run the same command to go on"
            )
        self._report(f"{stage} 0x{at:X}", self._share(sent))

    def _share(self, sent: int = 0) -> float:
        done = sum(len(self._content(at)) for at in self._progress.written) + sent
        return min(1.0, done / (len(self._data) - BOOTLOADER_BYTES))

    def _note(self, *, erased: list[int] | tuple[int, ...], written: list[int] | tuple[int, ...]) -> None:
        changes = {"erased": tuple(sorted(set(erased))), "written": tuple(sorted(set(written)))}
        self._progress = self._progress.model_copy(update=changes)
        write_text_atomically(self._path, self._progress.model_dump_json(indent=1) + "\n")


def _read_progress(path: Path, sha256: str, location: str) -> UploadProgress:
    """What an earlier upload of this file to this place has left; an empty progress for anything else."""
    fresh = UploadProgress(sha256=sha256, location=location)
    try:
        if path.stat().st_size > _LARGEST_RECORD:
            return fresh
        found = UploadProgress.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return fresh
    except OSError as error:
        raise FlashError(f"{path} cannot be read: {error.strerror or error}; mend it or remove it") from error
    except ValidationError:
        return fresh  # every sector is written again
    return found if (found.sha256, found.location) == (sha256, location) else fresh
