"""Into the bootloader and out again: what is found wrong there is found before anything is erased."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from flash_benches import OLD, QUICK, FlashBench

from drivers.lightcrafter.bootloader import FlashError
from drivers.lightcrafter.flash_table import BOOTLOADER_BYTES
from drivers.lightcrafter.upload import rehearse
from drivers.lightcrafter.values import Release


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[FlashBench]:
    bench = FlashBench(tmp_path / "flash.bin", absent_s=0.02)
    yield bench
    assert bytes(bench.bootloader.memory[: len(OLD)]) == OLD
    assert bench.bootloader.log == []
    bench.assert_bootloader_untouched()


def test_the_firmware_runs_again_and_nothing_was_written(bench: FlashBench) -> None:
    stages: list[str] = []
    assert rehearse(bench.transport(), report=lambda stage, _: stages.append(stage), times=QUICK) == Release(4, 4, 0)
    assert not bench.device.in_bootloader
    assert len(stages) == 3


def _other_chip(bench: FlashBench) -> None:
    bench.bootloader.faults.manufacturer = 0x0001


def _wrong_sum(bench: FlashBench) -> None:
    bench.bootloader.faults.wrong_sums = 1


@pytest.mark.parametrize("spoil", [_other_chip, _wrong_sum])
def test_a_bootloader_that_is_not_as_it_should_be_is_left_at_once(
    bench: FlashBench, spoil: Callable[[FlashBench], None]
) -> None:
    spoil(bench)
    with pytest.raises(FlashError):
        rehearse(bench.transport(), times=QUICK)
    assert not bench.device.in_bootloader


def test_a_projector_that_waits_in_its_bootloader_is_told(bench: FlashBench) -> None:
    bench.wait_in_bootloader()
    with pytest.raises(FlashError, match="waits in its bootloader already"):
        rehearse(bench.transport(), times=QUICK)


def test_the_signature_is_where_the_rehearsal_looks() -> None:
    assert OLD[BOOTLOADER_BYTES : BOOTLOADER_BYTES + 4] == b"\x67\x45\x23\x01"
