"""What is kept beside a firmware file: its checksum, which the file itself lacks, and what its images hold."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.lightcrafter.manifest import FIRMWARE_FORMAT, FlashManifest
from drivers.lightcrafter.splash import FirmwareError
from models.atomic import write_text_atomically

_LARGEST_FILE = 4_000_000
DIGEST = r"^[0-9a-f]{64}$"


class FirmwareRecord(BaseModel):
    """sha256, bytes: of the firmware. manifest: None where images were given without one."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["duofringe-firmware/1"] = FIRMWARE_FORMAT
    sha256: str = Field(pattern=DIGEST)
    bytes: int = Field(ge=0)
    images: int = Field(ge=1)
    manifest: FlashManifest | None = None

    def write(self, firmware: Path) -> Path:
        """Beside the firmware, complete or not at all; returns where."""
        path = record_path(firmware)
        write_text_atomically(path, self.model_dump_json(indent=1) + "\n")
        return path


def record_path(firmware: Path) -> Path:
    """``flash.bin.json`` beside ``flash.bin``."""
    return firmware.with_name(firmware.name + ".json")


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def read_record(firmware: Path, data: bytes) -> FirmwareRecord | None:
    """The record beside a firmware of these bytes, None where there is none.

    Raises FirmwareError where the record is damaged, or tells of other bytes than these.
    """
    path = record_path(firmware)
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise FirmwareError(f"{path} is too large to be the record of a firmware; remove it")
        record = FirmwareRecord.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FirmwareError(f"{path} cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        raise FirmwareError(f"{path} is not the record of a firmware; build the firmware again") from error
    if (record.bytes, record.sha256) != (len(data), digest(data)):
        raise FirmwareError(f"{firmware} is not the file that {path} was written for (SHA-256); build it again")
    return record
