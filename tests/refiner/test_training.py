"""Training on a small simulated rig: what it reads, that it repeats itself, that it can be stopped, what it refuses."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from small_rig import small_rig

from drivers.simulator.dataset import simulate_dataset
from models.capture import read_capture
from models.dataset import Dataset, open_dataset
from models.patterns import FringeParameters, make_plan
from models.refiner import LossConfiguration, Refiner, RefinerConfiguration, RefinerError, load_weights
from models.refiner.training import TrainingConfiguration, train
from models.refiner.training.checkpoint import read_checkpoint
from models.refiner.training.crops import draw_crops
from models.refiner.training.views import prepare_views, truth_columns
from service.cli.app import main

SMALL = RefinerConfiguration(image_widths=(8, 8, 16), guidance_widths=(4, 8, 8), head_widths=(8, 8), attention_heads=2)
QUICK = TrainingConfiguration(
    network=SMALL,
    steps=4,
    warm_up=1,
    pixels=8192,
    crops=((64, 64),),
    checkpoint_every=2,
    validate_every=2,
    validation_views=2,
)
SUPERVISED = QUICK.model_copy(update={"labels": "truth", "label_free": 0.0})


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("training") / "captures"
    simulate_dataset(folder, 5, 3, make_plan("composite"), rig=small_rig())
    return folder


def weights_of(folder: Path) -> bytes:
    return (folder / "refiner.safetensors").read_bytes()


def status(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return int(ended.value.code or 0)


def trained(dataset: Path, output: Path, configuration: TrainingConfiguration = QUICK, **options: object) -> bytes:
    train([open_dataset(dataset)], configuration, output, **options)  # type: ignore[arg-type]
    return weights_of(output)


def test_without_labels_the_truth_is_not_read(dataset: Path, tmp_path: Path) -> None:
    blind = tmp_path / "blind"
    shutil.copytree(dataset, blind)
    for truth in blind.glob("samples/*/truth"):
        shutil.rmtree(truth)
    assert trained(dataset, tmp_path / "a") == trained(blind, tmp_path / "b")


def test_seed_and_losses_decide(dataset: Path, tmp_path: Path) -> None:
    once = QUICK.model_copy(update={"steps": 1, "validation_views": 0})
    other_losses = once.model_copy(update={"losses": LossConfiguration(edges=0.0)})
    ways = (once, once.model_copy(update={"seed": 1}), other_losses)
    assert len({trained(dataset, tmp_path / str(number), way) for number, way in enumerate(ways)}) == 3


@pytest.mark.parametrize("configuration", [QUICK, SUPERVISED])
def test_a_stopped_training_ends_with_the_same_weights(
    dataset: Path, tmp_path: Path, configuration: TrainingConfiguration
) -> None:
    whole = trained(dataset, tmp_path / "whole", configuration)

    class StoppedError(Exception):
        pass

    def stop(progress: object) -> None:
        if getattr(progress, "stage", "") == "training" and getattr(progress, "step", 0) == 3:
            raise StoppedError

    with pytest.raises(StoppedError):
        train([open_dataset(dataset)], configuration, tmp_path / "cut", report=stop)
    assert not (tmp_path / "cut").exists()
    work = tmp_path / "cut.training"
    assert read_checkpoint(work).record.step == 2
    assert trained(dataset, tmp_path / "cut", configuration, resume=work) == whole
    steps = [line.partition(",")[0] for line in (work / "log.csv").read_text().splitlines()]
    assert steps == ["step", "0", "1", "2", "3"]


def test_it_survives_being_killed(dataset: Path, tmp_path: Path) -> None:
    settings = QUICK.model_copy(update={"steps": 30, "checkpoint_every": 1, "validation_views": 0})
    file = tmp_path / "settings.json"
    file.write_text(settings.model_dump_json(by_alias=True))
    whole = trained(dataset, tmp_path / "whole", settings.model_copy(update={"learning_rate": 3e-4}))
    command = [sys.executable, "-m", "service.cli", "train", str(dataset), "--config", str(file)]
    command += ["--learning-rate", "3e-4", "--output", str(tmp_path / "killed")]
    states = tmp_path / "killed.training" / "checkpoints"
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while len(list(states.glob("step-*"))) < 2 and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "killed").exists()
    assert 0 < read_checkpoint(states).record.step < 30
    subprocess.run([*command, "--resume", str(states)], check=True, capture_output=True)
    assert weights_of(tmp_path / "killed") == whole


def test_two_processes_learn_together(dataset: Path, tmp_path: Path) -> None:
    file = tmp_path / "settings.json"
    file.write_text(SUPERVISED.model_dump_json(by_alias=True))
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command += ["-m", "service.cli", "train", str(dataset), "--labels", "truth", "--config", str(file)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "--output", str(tmp_path / "both")], capture_output=True, text=True, env=environment, timeout=120
    )
    assert done.returncode == 0, done.stderr
    _, record = load_weights(tmp_path / "both")
    assert record.training["processes"] == 2
    assert weights_of(tmp_path / "both") != trained(dataset, tmp_path / "alone", SUPERVISED)


def test_supervision_brings_the_phase_closer(dataset: Path, tmp_path: Path) -> None:
    settings = SUPERVISED.model_copy(
        update={"steps": 60, "warm_up": 5, "learning_rate": 3e-3, "checkpoint_every": 1000, "precision": "float32"}
    )
    training = train([open_dataset(dataset)], settings, tmp_path / "weights")
    assert training is not None
    figures = training.validation
    assert figures["median_high"] < 0.9 * figures["median_high_input"]
    assert training.record.foretells_certainty
    assert training.record.variant == "sim"


def test_adapting_begins_from_the_given_weights(dataset: Path, tmp_path: Path) -> None:
    trained(dataset, tmp_path / "first", SUPERVISED)
    slow = QUICK.model_copy(update={"learning_rate": 1e-7, "network": RefinerConfiguration()})
    training = train([open_dataset(dataset)], slow, tmp_path / "second", adapt=tmp_path / "first")
    assert training is not None
    assert training.record.variant == "sim+adapt"
    first, _ = load_weights(tmp_path / "first")
    second, record = load_weights(tmp_path / "second")
    assert record.configuration == SMALL
    for (name, before), after in zip(first.state_dict().items(), second.state_dict().values(), strict=True):
        assert torch.allclose(before, after, atol=1e-5), name


def test_adapting_leads_to_other_periods(tmp_path: Path, dataset: Path) -> None:
    trained(dataset, tmp_path / "nine", QUICK)
    other = tmp_path / "other"
    plan = make_plan("composite", FringeParameters(periods=(8, 13), raster=small_rig().raster))
    simulate_dataset(other, 3, 4, plan, rig=small_rig())
    train([open_dataset(other)], QUICK, tmp_path / "eight", adapt=tmp_path / "nine")
    assert load_weights(tmp_path / "eight")[1].periods == (8.0, 13.0)
    with pytest.raises(RefinerError, match="different periods"):
        train([open_dataset(dataset), open_dataset(other)], QUICK, tmp_path / "mixed")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda folder: shutil.rmtree(folder / "truth"), "has no truth"),
        (lambda folder: (folder / "truth" / "right_projector_column.npy").unlink(), "lacks right_projector_column"),
    ],
)
def test_supervision_refuses_captures_without_truth(
    dataset: Path, tmp_path: Path, change: Callable[[Path], None], told: str
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    change(open_dataset(copy).capture_paths("train")[0])
    with pytest.raises(RefinerError, match=told):
        train([open_dataset(copy)], SUPERVISED, tmp_path / "weights")
    assert not (tmp_path / "weights").exists()


def test_another_command_does_not_go_on_with_a_state(dataset: Path, tmp_path: Path) -> None:
    trained(dataset, tmp_path / "first")
    work = tmp_path / "first.training"
    with pytest.raises(RefinerError, match="other settings"):
        trained(dataset, tmp_path / "second", QUICK.model_copy(update={"seed": 5}), resume=work)
    with pytest.raises(RefinerError, match="exists already"):
        trained(dataset, tmp_path / "first")


def test_hours_of_work_are_not_begun_anew_by_mistake(dataset: Path, tmp_path: Path) -> None:
    trained(dataset, tmp_path / "first")
    shutil.rmtree(tmp_path / "first")
    with pytest.raises(RefinerError, match=r"go on with --resume .*first\.training, or remove it"):
        trained(dataset, tmp_path / "first")
    assert read_checkpoint(tmp_path / "first.training").record.step == 2


def test_a_damaged_state_is_refused(dataset: Path, tmp_path: Path) -> None:
    trained(dataset, tmp_path / "first")
    state = next((tmp_path / "first.training" / "checkpoints").glob("step-*"))
    content = bytearray((state / "state.safetensors").read_bytes())
    content[-1] ^= 1
    (state / "state.safetensors").write_bytes(content)
    with pytest.raises(RefinerError, match="damaged"):
        read_checkpoint(state)
    with pytest.raises(RefinerError, match="holds no state"):
        read_checkpoint(tmp_path)


def test_crops_do_not_depend_on_the_order_of_asking(dataset: Path, tmp_path: Path) -> None:
    views = prepare_views(open_dataset(dataset).capture_paths("train"), tmp_path / "views", columns=truth_columns)
    one, _, again = (draw_crops(views, SUPERVISED, step) for step in (7, 8, 7))
    assert torch.equal(one.image, again.image)
    assert one.target is not None
    assert again.target is not None
    assert torch.equal(one.target, again.target)


def test_labels_agree_with_the_phases_whichever_way_a_crop_is_turned(dataset: Path, tmp_path: Path) -> None:
    views = prepare_views(open_dataset(dataset).capture_paths("train"), tmp_path / "views", columns=truth_columns)
    for step in range(12):
        crops = draw_crops(views, SUPERVISED, step)
        assert crops.target is not None
        sure = (crops.target.abs() > 0.5) & (crops.carriers.abs() > 0.02)
        error = torch.angle(crops.carriers * crops.target.conj())[sure]
        assert float(error.abs().median()) < 0.3


def test_truth_of_the_right_view_is_what_its_camera_sees(dataset: Path) -> None:
    capture = read_capture(open_dataset(dataset).capture_paths("all")[0])
    assert capture.truth is not None
    assert capture.rig is not None
    assert capture.rig.projector is not None
    points = capture.rig.left.back_project(capture.rig.left.pixel_grid(), capture.truth.depth)
    seen = capture.truth.foreground
    x, y = np.moveaxis(capture.rig.right.project(points[seen]), -1, 0)
    column = capture.truth.extra["right_projector_column"][np.rint(y).astype(int), np.rint(x).astype(int)]
    error = np.abs(column - capture.truth.projector_column[seen])
    assert np.nanmedian(error) < 0.5  # half a pixel of rounding


def test_the_command_line(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "settings.json"
    file.write_text(json.dumps({"network": SMALL.model_dump(by_alias=True), "crops": [[32, 32]], "warm_up": 0}))
    command = ["train", str(dataset), "--config", str(file), "--steps", "2", "--pixels", "2048", "--json"]
    assert status([*command, "--ablation", "A4", "--output", str(tmp_path / "weights")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["variant"] == "label-free"
    _, record = load_weights(tmp_path / "weights")
    assert record.training["configuration"]["labels"] == "geometry"
    assert status([*command, "--output", str(tmp_path / "absent" / "weights")]) == 1
    assert "does not exist" in capsys.readouterr().err
    assert status([*command, "--labels", "truth", "--ablation", "A0", "--output", str(tmp_path / "x")]) == 1
    assert "label-free" in capsys.readouterr().err
    file.write_text('{"stepps": 3}')
    assert status([*command, "--output", str(tmp_path / "x")]) == 1
    assert "settings.json" in capsys.readouterr().err


def test_losses_without_labels_need_a_weight() -> None:
    with pytest.raises(ValueError, match="label_free"):
        TrainingConfiguration(labels="none", label_free=0.0)


def test_a_state_holds_the_optimiser(dataset: Path, tmp_path: Path) -> None:
    trained(dataset, tmp_path / "first")
    state = read_checkpoint(tmp_path / "first.training")
    names = {name for name, _ in Refiner(SMALL).named_parameters()}
    assert {n.removeprefix("second.") for n in state.tensors if n.startswith("second.")} == names


def test_datasets_without_a_split_train_on_everything(dataset: Path, tmp_path: Path) -> None:
    opened = open_dataset(dataset)
    plain = Dataset(opened.root, dict(list(opened.samples.items())[:1]), None, opened.rig)
    training = train([plain], QUICK.model_copy(update={"steps": 1}), tmp_path / "weights")
    assert training is not None
    assert training.record.training["views"] == 2
