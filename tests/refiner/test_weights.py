"""Weights on disk: what is saved comes back, and nothing else is believed."""

from __future__ import annotations

import hashlib
import json
import pickle
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.torch import save

from models.errors import DuofringeError
from models.refiner import Refiner, RefinerConfiguration, RefinerError, RefinerInput, load_weights, save_weights
from models.refiner.weights import LARGEST_RECORD, LARGEST_TENSORS, RECORD_NAME, TENSORS_NAME

SMALL = RefinerConfiguration(image_widths=(4, 8), guidance_widths=(4, 4), head_widths=(4,), attention_heads=2)
PERIODS = (9.0, 14.0)
TRAINING = {"steps": 300, "split": "train", "losses": {"scale": 1.0}}


def saved(folder: Path) -> Refiner:
    refiner = Refiner(SMALL, seed=1)
    for head in (refiner.high_head, refiner.modulus_head):
        torch.nn.init.constant_(head.last.weight, 0.01)
    save_weights(folder, refiner, PERIODS, "sim", TRAINING)
    return refiner


def edit_record(folder: Path, **changes: Any) -> None:
    path = folder / RECORD_NAME
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def replace_tensors(folder: Path, content: bytes) -> None:
    """Foreign content with a matching checksum."""
    (folder / TENSORS_NAME).write_bytes(content)
    edit_record(folder, sha256=hashlib.sha256(content).hexdigest())


def refused(folder: Path, text: str, periods: tuple[float, ...] | None = PERIODS) -> None:
    with pytest.raises(RefinerError, match=text) as caught:
        load_weights(folder, periods)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    refiner = saved(tmp_path / "w")
    loaded, record = load_weights(tmp_path / "w", PERIODS)
    assert (record.periods, record.variant, record.training) == (PERIODS, "sim", TRAINING)
    assert record.configuration == SMALL
    assert not loaded.training
    view = RefinerInput(torch.rand(1, 1, 13, 18), 0.1 * torch.randn(1, 2, 13, 18, dtype=torch.complex64))
    with torch.inference_mode():
        wanted = refiner.eval()(view).carriers
        assert (loaded(view).carriers - wanted).abs().max() < 1e-2
        assert torch.equal(loaded(view).carriers, refiner.half().float()(view).carriers)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["w"]


def test_the_default_fits_its_file(tmp_path: Path) -> None:
    save_weights(tmp_path / "w", Refiner(), PERIODS, "label-free")
    assert (tmp_path / "w" / TENSORS_NAME).stat().st_size <= 8_000_000
    load_weights(tmp_path / "w")


def test_other_periods_are_refused(tmp_path: Path) -> None:
    saved(tmp_path / "w")
    refused(tmp_path / "w", "fringes of 9 and 14 columns, not 14 and 9", (14.0, 9.0))
    refused(tmp_path / "w", "not 9;", (9.0,))


def test_other_versions_and_foreign_records_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "w"
    saved(folder)
    good = json.loads((folder / RECORD_NAME).read_text())
    configuration = good["configuration"]
    for changes, text in (
        ({"schema": "refiner-weights/2"}, "schema"),
        ({"configuration": configuration | {"schema": "refiner/9"}}, "configuration.schema"),
        ({"configuration": configuration | {"image_widths": [4, 10**9]}}, "image_widths"),
        ({"variant": "best"}, "variant"),
        ({"sha256": "0" * 63}, "sha256"),
        ({"code": "import os"}, "code"),
    ):
        (folder / RECORD_NAME).write_text(json.dumps(good | changes))
        refused(folder, text)
    for content in ("", "[" * 100_000, "[]", "{", '"x"', "{}"):
        (folder / RECORD_NAME).write_text(content)
        refused(folder, RECORD_NAME)
    (folder / RECORD_NAME).write_bytes(b"\xff\xfe\x00")
    refused(folder, "not readable as JSON")


def test_missing_files_and_oversize_ones_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "w"
    refused(folder, "missing")
    saved(folder)
    with (folder / TENSORS_NAME).open("r+b") as file:
        file.truncate(LARGEST_TENSORS + 1)
    refused(folder, "more than")
    (folder / TENSORS_NAME).unlink()
    refused(folder, "missing")
    with (folder / RECORD_NAME).open("r+b") as file:
        file.truncate(LARGEST_RECORD + 1)
    refused(folder, "more than")


def test_content_that_is_no_safetensors_is_refused_and_never_run(tmp_path: Path) -> None:
    folder = tmp_path / "w"
    saved(folder)

    class Payload:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "owned",))

    for content in (b"", b"\x00" * 7, b"\xff" * 64, pickle.dumps(Payload())):
        replace_tensors(folder, content)
        refused(folder, "not readable as safetensors")
    assert not (tmp_path / "owned").exists()


def test_tensors_of_another_network_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "w"
    state = {name: value.half().contiguous() for name, value in saved(folder).state_dict().items()}
    first = sorted(state)[0]
    for changed, text in (
        ({k: v for k, v in state.items() if k != first}, f"'{first}' is missing"),
        (state | {"zz": torch.zeros(1)}, "'zz' is unknown"),
        (state | {first: torch.zeros(3)}, "the network has"),
        (state | {first: state[first].double()}, "float64"),
        (state | {first: torch.full_like(state[first], torch.nan)}, "not finite"),
    ):
        replace_tensors(folder, save(changed))
        refused(folder, text)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10**6), flip=st.integers(1, 255))
def test_a_changed_byte_is_noticed(tmp_path: Path, place: int, flip: int) -> None:
    folder = tmp_path / "w"
    if not folder.exists():
        saved(folder)
    path = folder / TENSORS_NAME
    good = path.read_bytes()
    damaged = bytearray(good)
    damaged[place % len(good)] ^= flip
    path.write_bytes(damaged)
    refused(folder, "sha256 differs")
    path.write_bytes(good)


def test_nothing_is_written_that_could_not_be_read(tmp_path: Path) -> None:
    refiner = Refiner(SMALL)
    with pytest.raises(RefinerError, match="training"):
        save_weights(tmp_path / "w", refiner, PERIODS, "sim", {"when": object()})
    with pytest.raises(RefinerError, match="training"):
        save_weights(tmp_path / "w", refiner, PERIODS, "sim", {"loss": float("nan")})
    with pytest.raises(RefinerError, match="periods"):
        save_weights(tmp_path / "w", refiner, (0.0, 14.0), "sim")
    with torch.no_grad():
        refiner.high_head.last.bias.fill_(torch.inf)
    with pytest.raises(RefinerError, match="not finite"):
        save_weights(tmp_path / "w", refiner, PERIODS, "sim")
    assert list(tmp_path.iterdir()) == []


def test_weights_are_not_overwritten(tmp_path: Path) -> None:
    saved(tmp_path / "w")
    with pytest.raises(DuofringeError, match="exists already"):
        saved(tmp_path / "w")
    load_weights(tmp_path / "w")
