"""Firmware files: images in flash coding, and the file around them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from firmware_files import SPLASH_AT, base_file
from hypothesis import given
from hypothesis import strategies as st
from lightcrafter_benches import MANIFEST, PLAN, quick, usb_transport

from drivers.lightcrafter.emulator.controller import EmulatedController
from drivers.lightcrafter.emulator.flash import EmulatedFlash
from drivers.lightcrafter.firmware import FirmwareFile, build_firmware
from drivers.lightcrafter.flash_table import BASE_ADDRESS
from drivers.lightcrafter.projector import LightCrafter
from drivers.lightcrafter.splash import HEADER_BYTES, Coding, FirmwareError, decode_image, encode_image
from models.errors import DuofringeError


def coding_of(blob: bytes) -> int:
    return blob[25]


IMAGES = st.builds(
    lambda seed, rows, columns, levels, repeat: np.repeat(
        np.random.default_rng(seed).integers(0, levels, (rows, columns, 3), dtype=np.uint8), repeat, axis=1
    ),
    st.integers(0, 2**32 - 1),
    st.integers(1, 9),
    st.integers(1, 13),
    st.sampled_from([1, 2, 256]),
    st.sampled_from([1, 2, 5, 300]),
)


@given(IMAGES)
def test_every_image_survives_its_coding(image: np.ndarray) -> None:
    blob = encode_image(image)
    assert np.array_equal(decode_image(blob), image)
    (size,) = struct.unpack_from("<I", blob, 8)
    assert len(blob) == HEADER_BYTES + size
    assert size <= image.size
    if coding_of(blob) == Coding.RUNS:
        assert size % 16 == 0


def test_the_coding_is_the_one_that_loads_fastest() -> None:
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, (32, 64, 3), dtype=np.uint8)
    assert coding_of(encode_image(noise)) == Coding.RAW
    assert coding_of(encode_image(noise[np.arange(32) % 4])) == Coding.FOUR_LINES
    assert coding_of(encode_image(np.broadcast_to(noise[:, :1], noise.shape))) == Coding.RUNS


def test_runs_are_coded_as_the_sheet_says() -> None:
    """Repeat, literal, odd pixel, end of line up to 4 bytes, end of image up to 16."""
    a, b, d = (1, 2, 3), (4, 5, 6), (7, 8, 9)
    image = np.array([[a] * 12, [a] * 9 + [b, d, a], [b] * 11 + [a], [a] * 12, [d] * 12], np.uint8)
    blob = encode_image(image)
    assert coding_of(blob) == Coding.RUNS
    expected = b"".join(
        [
            b"\x0c\x03\x02\x01\x00\x00\x00\x00",
            b"\x09\x03\x02\x01\x00\x03\x06\x05\x04\x09\x08\x07\x03\x02\x01\x00\x00\x00\x00\x00",
            b"\x0b\x06\x05\x04\x01\x03\x02\x01\x00\x00\x00\x00",
            b"\x0c\x03\x02\x01\x00\x00\x00\x00",
            b"\x0c\x09\x08\x07\x00\x00\x00\x00",
            b"\x00\x01",
        ]
    )
    assert blob[HEADER_BYTES:] == expected.ljust(-(-len(expected) // 16) * 16, b"\0")


@given(st.binary(max_size=120), st.sampled_from([0, 1, 2, 4]))
def test_any_bytes_are_an_image_or_a_firmware_error(data: bytes, coding: int) -> None:
    header = struct.pack("<IHHIIIIBBBB4s", 0x636C7053, 5, 4, len(data), 0, 0, 0, 1, coding, 1, 0, b"")
    for blob in (data, header + data):
        try:
            shape = decode_image(blob).shape
        except FirmwareError as error:
            shape = (4, 5, 3) if len(str(error).splitlines()) == 1 else ()
        assert shape == (4, 5, 3)


def test_a_vertical_fringe_takes_four_lines() -> None:
    assert len(encode_image(MANIFEST.render(0))) == HEADER_BYTES + 10_944


def test_a_built_file_keeps_the_program_and_shows_the_manifests_patterns(tmp_path: Path) -> None:
    base, output = tmp_path / "base.bin", tmp_path / "built.bin"
    base.write_bytes(base_file(images=3))
    made = build_firmware(base, MANIFEST, output)
    built = output.read_bytes()
    assert FirmwareFile.parse(built) == made == FirmwareFile.from_file(output)
    assert built[:SPLASH_AT] == base.read_bytes()[:SPLASH_AT]
    assert len(made.blobs) == MANIFEST.images

    flash = EmulatedFlash([made.image(k) for k in range(len(made.blobs))])
    device = EmulatedController(flash, realtime=False)
    projector = LightCrafter(usb_transport(device)[0], MANIFEST, quick())
    projector.open()
    plan = PLAN.restricted_to(["white", "high_04", "low_13", "gray_06", "black"])
    projector.load(plan, 8600.0)
    projector.start()
    for pattern in plan.patterns:
        exposure = device.step()
        assert exposure is not None
        assert np.array_equal(exposure.levels, pattern.render(MANIFEST.raster)), pattern.name
    projector.close()


def test_what_does_not_fit_the_first_chip_is_refused() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (1140, 912, 3), dtype=np.uint8)
    with pytest.raises(FirmwareError, match="16777216 are safe"):
        FirmwareFile.parse(base_file()).with_images([noise] * 6)
    with pytest.raises(FirmwareError, match="1 to 256 images, not 0"):
        FirmwareFile.parse(base_file()).with_images([])


def test_a_file_that_is_no_firmware_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    good = base_file(images=2)
    unsigned = bytearray(good)
    unsigned[0x20000] ^= 1
    astray = bytearray(good)
    struct.pack_into("<I", astray, SPLASH_AT + 12, BASE_ADDRESS)
    elsewhere = bytearray(good)
    struct.pack_into("<I", elsewhere, 0x20000 + 176, BASE_ADDRESS + 0x1000)
    base, output = tmp_path / "base.bin", tmp_path / "built.bin"
    for damaged in (b"", good[:0x20010], good[: SPLASH_AT + 4], good[:-1], unsigned, astray, elsewhere):
        base.write_bytes(bytes(damaged))
        with pytest.raises(FirmwareError) as caught:
            build_firmware(base, MANIFEST, output)
        assert len(str(caught.value).splitlines()) == 1
    assert not output.exists()
    with pytest.raises(FirmwareError, match="cannot be read"):
        build_firmware(tmp_path / "none.bin", MANIFEST, output)
    base.write_bytes(good)
    with pytest.raises(DuofringeError, match="does not exist"):
        build_firmware(base, MANIFEST, tmp_path / "nowhere" / "built.bin")
