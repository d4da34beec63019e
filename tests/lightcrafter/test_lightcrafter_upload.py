"""A firmware file on its way into the flash: whatever happens, the projector can be brought to the end of it."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from firmware_files import stripes
from flash_benches import NEW, OLD, OTHER, SPLASH_AT, FlashBench

from drivers.errors import DeviceLostError, DriverError
from drivers.lightcrafter import commands as c
from drivers.lightcrafter.bootloader import SECTOR_BYTES, BootloaderTimes, FlashError
from drivers.lightcrafter.firmware import FirmwareFile
from drivers.lightcrafter.firmware_record import FirmwareRecord, digest, record_path
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES
from drivers.lightcrafter.splash import FirmwareError
from drivers.lightcrafter.transport import read
from drivers.lightcrafter.upload import UploadProgress, UploadStoppedError, progress_path
from drivers.lightcrafter.usb import UsbTransport
from models.errors import DuofringeError

Bench = Callable[..., FlashBench]
SECTORS = list(range(BOOTLOADER_BYTES, len(NEW), SECTOR_BYTES))
TABLE = SECTORS[0]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Bench]:
    benches: list[FlashBench] = []

    def made(**settings: object) -> FlashBench:
        benches.append(FlashBench(tmp_path / f"flash{len(benches)}.bin", **settings))  # type: ignore[arg-type]
        return benches[-1]

    yield made
    for bench in benches:
        bench.assert_bootloader_untouched()


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> int:
    """How many the bootloader gets to write NEW from the beginning, the last of which ends it."""
    bench = FlashBench(tmp_path_factory.mktemp("whole") / "flash.bin")
    bench.upload()
    return bench.bootloader.commands


def test_the_new_images_are_in_the_flash_and_the_projector_runs(make: Bench) -> None:
    bench = make(absent_s=0.05, erase_s=0.005, sum_s=0.005)
    stages: list[tuple[str, float]] = []
    outcome = bench.upload(report=lambda stage, share: stages.append((stage, share)))
    assert bench.holds_the_file
    assert (outcome.images, outcome.written, outcome.kept, outcome.resumed) == (8, len(SECTORS), 0, False)
    assert outcome.location == "USB 1-2"
    assert not bench.device.in_bootloader
    assert len(bench.device.flash) == 8
    assert (bench.device.flash.image(3) == stripes(1 + 3)).all()
    assert not progress_path(bench.file).exists()
    shares = [share for _, share in stages]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_flash_table_goes_first_and_comes_last(make: Bench) -> None:
    """In between the controller has nothing to start from, so that it waits in its bootloader."""
    bench = make()
    bench.upload()
    assert bench.touched("erase") == SECTORS
    assert bench.touched("write") == [*SECTORS[1:], TABLE]
    last = bench.bootloader.log[-1]
    assert (last.start, last.size) == (TABLE, 4), "the signature is not the last that is written"


def test_only_images_leaves_the_program_alone(make: Bench) -> None:
    """But for the table's sector, without which an interruption would leave a program without images."""
    bench = make()
    outcome = bench.upload(only_images=True)
    assert bench.holds_the_file
    assert outcome.written == len([at for at in SECTORS if at + SECTOR_BYTES > SPLASH_AT]) + 1
    assert bench.touched("write") == [at for at in SECTORS[1:] if at + SECTOR_BYTES > SPLASH_AT] + [TABLE]
    other = make(content=OTHER)
    other.upload(only_images=True)
    assert other.holds_the_file


@pytest.mark.parametrize("seed", range(12))
def test_a_power_cut_at_any_moment_is_mended_by_the_next_run(make: Bench, commands: int, seed: int) -> None:
    """Several cuts one after the other, at random commands."""
    rng = random.Random(seed)
    bench = make(content=OTHER if seed % 2 else NEW)
    bench.bootloader.faults.deaf = seed % 3 == 0
    for _ in range(rng.choice([1, 1, 3])):
        bench.bootloader.faults.power_lost_after = rng.randrange(commands)
        try:
            bench.upload()
        except DriverError:
            bench.device.plug()
            assert bench.device.plugged, "the controller starts from half a program"
            if bench.device.in_bootloader:
                assert bench.bootloader.memory[TABLE : TABLE + 4] != OLD[TABLE : TABLE + 4]
    bench.bootloader.faults.power_lost_after = None
    outcome = bench.upload()
    assert bench.holds_the_file
    assert not bench.device.in_bootloader
    assert len(bench.device.flash) == outcome.images
    assert outcome.written + outcome.kept == len(SECTORS)


@pytest.mark.parametrize("at", [*range(12), 13, 150])
def test_a_power_cut_at_each_of_the_first_commands(make: Bench, at: int) -> None:
    bench = make()
    bench.bootloader.faults.power_lost_after = at
    with pytest.raises(DriverError):
        bench.upload()
    bench.device.plug()
    bench.upload()
    assert bench.holds_the_file


@pytest.mark.parametrize("back", range(8))
def test_a_power_cut_at_each_of_the_last_commands(make: Bench, commands: int, back: int) -> None:
    """Around the signature, from which on the controller would start by itself."""
    bench = make()
    bench.bootloader.faults.power_lost_after = commands - 1 - back
    with pytest.raises(DriverError):
        bench.upload()
    bench.device.plug()
    assert bench.device.plugged, "the controller starts from half a program"
    bench.upload()
    assert bench.holds_the_file


def test_what_was_finished_is_not_written_again(make: Bench) -> None:
    bench = make()
    bench.bootloader.faults.power_lost_after = 290
    with pytest.raises(DeviceLostError):
        bench.upload()
    bench.device.plug()
    progress = UploadProgress.model_validate_json(progress_path(bench.file).read_bytes())
    assert progress.location == "USB 1-2"
    assert len(progress.written) == 1
    assert TABLE in progress.erased
    bench.bootloader.log.clear()
    outcome = bench.upload()
    assert outcome.resumed
    assert outcome.kept == 1
    assert progress.written[0] not in bench.touched("write")
    assert bench.holds_the_file


def test_what_was_finished_and_is_damaged_is_written_again(make: Bench) -> None:
    bench = make()
    bench.bootloader.faults.power_lost_after = 290
    with pytest.raises(DeviceLostError):
        bench.upload()
    bench.bootloader.memory[SECTORS[1] + 5] ^= 0x10
    bench.device.plug()
    assert bench.upload().kept == 0
    assert bench.holds_the_file


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"format": "duofringe-upload/2"}'])
def test_a_progress_that_means_nothing_starts_afresh(make: Bench, content: bytes) -> None:
    bench = make()
    progress_path(bench.file).write_bytes(content)
    outcome = bench.upload()
    assert outcome.written == len(SECTORS)


def test_the_progress_of_another_file_or_another_place_is_not_taken_up(make: Bench) -> None:
    bench = make()
    for changed in ({"sha256": digest(OLD)}, {"location": "USB 3-1"}):
        whole = {"sha256": digest(NEW), "location": "USB 1-2", "written": SECTORS, **changed}
        progress_path(bench.file).write_text(UploadProgress(**whole).model_dump_json())
        assert bench.upload().written == len(SECTORS)


def test_a_program_that_dies_within_a_message_can_go_on_without_a_power_cut(
    make: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bootloader waits for the rest of the message, and takes the next questions for it."""
    bench = make()
    whole = bench.bus.intr_write
    left = 2000

    def dying(*arguments: object) -> int:
        nonlocal left
        left -= 1
        if not left:
            raise KeyboardInterrupt
        return whole(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(bench.bus, "intr_write", dying)
    with pytest.raises(KeyboardInterrupt):
        bench.upload()
    left = -1
    assert bench.device.in_bootloader
    outcome = bench.upload()
    assert outcome.resumed
    assert bench.holds_the_file


def test_a_stop_is_between_messages_and_can_be_taken_up(make: Bench) -> None:
    bench = make()
    asked = iter(range(10_000))
    with pytest.raises(UploadStoppedError, match="run the same command to go on"):
        bench.upload(stopped=lambda: next(asked) > 300)
    assert bench.device.in_bootloader
    outcome = bench.upload()
    assert outcome.resumed
    assert outcome.kept == 1
    assert bench.holds_the_file


def test_a_wrong_checksum_is_tried_once_more_and_then_told(make: Bench) -> None:
    bench = make()
    bench.wait_in_bootloader()
    bench.bootloader.faults.wrong_sums = 1
    bench.upload()
    assert bench.holds_the_file
    bench = make()
    bench.wait_in_bootloader()
    bench.bootloader.faults.wrong_sums = 2
    with pytest.raises(FlashError, match=r"checksum at 0x40000 is wrong after 2 tries.*virtual machine"):
        bench.upload()
    assert bench.device.in_bootloader
    bench.upload()
    assert bench.holds_the_file


@pytest.mark.parametrize("wrong_from", [len(SECTORS) + 2, len(SECTORS) + 3])
def test_a_wrong_checksum_of_the_whole_leaves_nothing_to_start_from(
    make: Bench, wrong_from: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the signature is written, and after it."""
    bench = make()
    compute = bench.bootloader._compute
    sums = 0

    def wrong_once() -> None:
        nonlocal sums
        sums += 1
        if sums == wrong_from:
            bench.bootloader.faults.wrong_sums = 1
        compute()

    monkeypatch.setattr(bench.bootloader, "_compute", wrong_once)
    with pytest.raises(FlashError, match="checksum of the whole flash is wrong"):
        bench.upload()
    bench.device.unplug()
    bench.device.plug()
    assert bench.device.in_bootloader
    assert bench.upload().kept == 0
    assert bench.holds_the_file


def test_a_bootloader_that_is_busy_for_ever_is_given_up(make: Bench) -> None:
    bench = make(erase_s=30.0)
    with pytest.raises(FlashError, match=r"longer than 0\.05 s to erase a sector; switch it off and on"):
        bench.upload(BootloaderTimes(busy_s=0.05, return_s=1.0, pause_s=0.001))
    bench.device.unplug()
    bench.bootloader._erase_s = 0.0
    bench.device.plug()
    bench.upload()
    assert bench.holds_the_file


def test_a_bootloader_that_sums_otherwise_is_left_before_anything_is_erased(make: Bench) -> None:
    """The signature of the running firmware's table is known."""
    bench = make()
    bench.bootloader.faults.wrong_sums = 1
    with pytest.raises(FlashError, match="may not understand what it is told; nothing was erased"):
        bench.upload()
    assert bench.bootloader.log == []
    bench.device.unplug()
    bench.device.plug()
    assert not bench.device.in_bootloader


def test_an_unknown_flash_chip_is_refused_before_anything_is_erased(make: Bench) -> None:
    bench = make()
    bench.bootloader.faults.manufacturer = 0x00C2
    with pytest.raises(FlashError, match=r"manufacturer 0x00C2, device 0x227E\) is not known here; nothing was erased"):
        bench.upload()
    assert bench.bootloader.log == []
    bench.device.unplug()
    bench.device.plug()
    assert not bench.device.in_bootloader


def test_a_slow_return_to_the_bus_is_waited_for_and_an_endless_one_is_told(make: Bench) -> None:
    bench = make(absent_s=0.6)
    bench.upload()
    assert bench.holds_the_file
    bench = make(absent_s=60.0)
    with pytest.raises(DeviceLostError, match=r"did not come back as a bootloader within 0\.3 s"):
        bench.upload(BootloaderTimes(return_s=0.3, pause_s=0.001))
    assert bench.bootloader.log == []


def test_a_controller_that_does_not_follow_is_asked_again(make: Bench) -> None:
    bench = make()
    bench.bootloader.faults.ignored_entries = 2
    bench.upload()
    assert bench.holds_the_file


def test_a_flash_that_shows_another_number_of_images_is_told(make: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = make()
    whole = bench.device.handle

    def one_less(code: int, payload: bytes | None, argument: bytes = b"") -> bytes:
        return b"\x07" if code == c.FLASH_IMAGES.usb else whole(code, payload, argument)

    monkeypatch.setattr(bench.device, "handle", one_less)
    with pytest.raises(FlashError, match=r"finds 7 images in its flash where .* has 8"):
        bench.upload()


def unsigned(data: bytes) -> bytes:
    return data[:BOOTLOADER_BYTES] + b"\0" + data[BOOTLOADER_BYTES + 1 :]


def spoiled_image(data: bytes) -> bytes:
    at = FirmwareFile.parse(data).stored[2].offset
    return data[: at + 25] + b"\x01" + data[at + 26 :]


@pytest.mark.parametrize(
    "damage", [unsigned, spoiled_image, lambda data: data[:-1], lambda data: b"", lambda data: data[:BOOTLOADER_BYTES]]
)
def test_a_damaged_file_is_not_sent(make: Bench, damage: Callable[[bytes], bytes]) -> None:
    bench = make(content=damage(NEW))
    with pytest.raises(FirmwareError):
        bench.upload()
    assert not bench.device.in_bootloader
    assert bench.bus.last_sequence == 0, "the projector was spoken to"


def test_a_file_that_is_not_the_one_of_its_record_is_not_sent(make: Bench) -> None:
    """A changed byte of a pixel shows nowhere else."""
    bench = make()
    FirmwareRecord(sha256=digest(NEW), bytes=len(NEW), images=8).write(bench.file)
    bench.file.write_bytes(NEW[:-5] + bytes([NEW[-5] ^ 1]) + NEW[-4:])
    with pytest.raises(FirmwareError, match=r"is not the file that .* was written for"):
        bench.upload()
    record_path(bench.file).write_text("{}")
    with pytest.raises(FirmwareError, match="is not the record of a firmware"):
        bench.upload()
    assert bench.bus.last_sequence == 0


def test_no_projector_is_told_as_such(make: Bench) -> None:
    bench = make()
    bench.device.unplug()
    with pytest.raises(DuofringeError, match="is not attached"):
        bench.upload()


def test_after_an_upload_the_port_is_free(make: Bench) -> None:
    bench = make()
    bench.upload()
    assert not bench.bus.claimed
    transport: UsbTransport = bench.transport()
    transport.open()
    assert read(transport, c.FLASH_IMAGES) == 8
    transport.close()
