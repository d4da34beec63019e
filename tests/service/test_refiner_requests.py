"""The refiner over REST: the method chosen, the weights that may be named, and what is said when they do not serve."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from problem_checks import problem
from small_rig import DEPTH_RANGE, small_rig
from small_service import SmallService, small_service

from drivers.replay.source import ReplaySource
from models.capture import read_capture
from models.reconstruct import ReconstructionOptions, reconstruct
from models.refiner import shipped
from models.refiner.weights import RECORD_NAME, TENSORS_NAME
from service.warm_up import warm_up

CALL, RECONSTRUCTIONS = "/v1/capture-and-reconstruct", "/v1/reconstructions"
SHIPPED = shipped.FOLDER / shipped.DEFAULT
Put = Callable[..., Path]


def copy_weights(folder: Path, **changed: Any) -> Path:
    """The shipped weights once more, with other words in their record."""
    shutil.copytree(SHIPPED, folder, copy_function=shutil.copyfile)
    record = json.loads((folder / RECORD_NAME).read_text())
    (folder / RECORD_NAME).write_text(json.dumps(record | changed))
    return folder


@pytest.fixture
def put(small: SmallService) -> Put:
    """Puts weights into the service's own folder."""
    return lambda name, **changed: copy_weights(small.service.library.root / "weights" / name, **changed)


@pytest.fixture
def other_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Has other weights shipped in place of the real ones."""

    def replaced(**changed: Any) -> Path:
        monkeypatch.setattr(shipped, "FOLDER", tmp_path / "shipped")
        return copy_weights(tmp_path / "shipped" / shipped.DEFAULT, **changed)

    return replaced


def sha256() -> str:
    return str(json.loads((SHIPPED / RECORD_NAME).read_text())["sha256"])


def call(small: SmallService, **request: Any) -> dict[str, Any]:
    response = small.client.post(CALL, json={"depth_range": DEPTH_RANGE, **request})
    assert response.status_code == 201, response.text
    assert str(small.service.library.root) not in response.text
    found: dict[str, Any] = response.json()["reconstruction"]
    return found


def stored_capture(small: SmallService, plan: Any) -> str:
    return str(small.client.post("/v1/captures", json={"plan": plan}).raise_for_status().json()["id"])


class TestChoice:
    def test_the_refiner_is_the_default_and_is_named_everywhere(self, small: SmallService) -> None:
        made = call(small)
        assert made["method"] == "refiner"
        assert made["weights"] == {"name": "sim", "variant": "sim", "sha256": sha256()}
        here = made["links"]["self"]
        assert small.client.get(here).json()["weights"] == made["weights"]
        assert small.client.get(RECONSTRUCTIONS).json()["items"][0]["weights"] == made["weights"]
        assert sha256() in small.client.get(made["links"]["report"]).text
        record = small.service.library.root / "reconstructions" / made["id"] / "reconstruction.json"
        assert json.loads(record.read_text())["weights"] == made["weights"]
        capture = read_capture(small.service.library.root / "captures" / made["capture"])
        own = reconstruct(capture, ReconstructionOptions("refiner", None, DEPTH_RANGE))
        assert made["statistics"]["points"] == len(own.points) > 1000

    @pytest.mark.parametrize(
        ("plan", "method"),
        [("composite", "refiner"), ("full", "refiner"), ("reference", "nstep"), (["white", "composite"], "refiner")],
    )
    def test_the_best_that_the_patterns_allow(self, small: SmallService, plan: Any, method: str) -> None:
        assert call(small, plan=plan)["method"] == method
        answer = small.client.post(RECONSTRUCTIONS, json={"capture": stored_capture(small, plan)})
        assert answer.json()["method"] == method
        assert (answer.json()["weights"] is None) == (method != "refiner")

    def test_patterns_that_serve_no_method(self, small: SmallService) -> None:
        before = small.bench.pulses_sent
        problem(small.client.post(CALL, json={"plan": ["white"]}), 422, "plan-invalid")
        assert small.bench.pulses_sent == before
        capture = stored_capture(small, ["white"])
        body = problem(small.client.post(RECONSTRUCTIONS, json={"capture": capture}), 422, "capture-unusable")
        assert "composite" in body["detail"]

    def test_default_weights_for_other_fringes(self, small: SmallService, other_default: Callable[..., Path]) -> None:
        other_default(periods=[8.0, 13.0])
        made = call(small)
        assert (made["method"], made["weights"]) == ("wft", None)
        body = problem(small.client.post(CALL, json={"method": "refiner"}), 422, "captured-not-reconstructed")
        assert "sim: weights are for fringes of 8 and 13 columns, not 9 and 14" in body["detail"]
        kept = small.client.get(body["capture"]).json()["id"]
        request = {"capture": kept, "method": "refiner"}
        problem(small.client.post(RECONSTRUCTIONS, json=request), 422, "weights-unusable")
        assert small.client.get("/v1/health/ready").json()["ready"]

    @pytest.mark.parametrize("damage", ["numbers", "record", "missing", "gone"])
    def test_damaged_default_weights(
        self,
        small: SmallService,
        other_default: Callable[..., Path],
        caplog: pytest.LogCaptureFixture,
        damage: str,
    ) -> None:
        folder = other_default()
        if damage == "gone":
            shutil.rmtree(folder)
        elif damage == "missing":
            (folder / TENSORS_NAME).unlink()
        else:
            path = folder / (TENSORS_NAME if damage == "numbers" else RECORD_NAME)
            path.write_bytes(path.read_bytes()[:-9])
        with caplog.at_level(logging.WARNING):
            warm_up(small.service)
        (line,) = [record.getMessage() for record in caplog.records]
        assert "wft" in line
        assert "\n" not in line
        ready = small.client.get("/v1/health/ready")
        assert ready.status_code == 200
        (check,) = [check for check in ready.json()["checks"] if not check["needed"]]
        assert (check["name"], check["ok"]) == ("weights", False)
        assert str(folder) not in ready.text
        assert call(small)["method"] == "wft"
        before = small.bench.pulses_sent
        problem(small.client.post(CALL, json={"method": "refiner"}), 422, "weights-unusable")
        assert small.bench.pulses_sent == before
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(SHIPPED, folder)
        assert call(small)["method"] == "refiner"
        assert all(check["ok"] for check in small.client.get("/v1/health/ready").json()["checks"])


class TestNamedWeights:
    def test_those_of_the_service_s_own_folder(self, small: SmallService, put: Put) -> None:
        put("my-rig_2.0+b", variant="sim+adapt")
        made = call(small, weights="my-rig_2.0+b")
        assert made["method"] == "refiner"
        assert made["weights"] == {"name": "my-rig_2.0+b", "variant": "sim+adapt", "sha256": sha256()}
        record = small.service.library.root / "reconstructions" / made["id"] / "reconstruction.json"
        assert "weights/my-rig" not in record.read_text()
        assert call(small, method="refiner", weights="sim")["weights"]["variant"] == "sim"

    def test_a_folder_named_in_the_configuration(self, recorded: Path, tmp_path: Path) -> None:
        copy_weights(tmp_path / "elsewhere" / "mine")
        source = ReplaySource(recorded)
        with small_service(source, tmp_path / "library", weights=tmp_path / "elsewhere") as running:
            assert call(running, weights="mine")["weights"]["name"] == "mine"

    def test_a_shipped_name_is_not_taken_over(self, small: SmallService, put: Put) -> None:
        put("sim", variant="label-free")
        assert call(small, weights="sim")["weights"]["variant"] == "sim"

    @pytest.mark.parametrize("path", [CALL, RECONSTRUCTIONS])
    def test_an_unknown_name_tells_what_there_is(self, small: SmallService, put: Put, path: str) -> None:
        put("mine")
        put("No-Name")
        request = {} if path == CALL else {"capture": stored_capture(small, "composite")}
        before = small.bench.pulses_sent
        body = problem(small.client.post(path, json={**request, "weights": "yours"}), 422, "weights-unusable")
        assert body["detail"] == "weights 'yours' are unknown; there are sim, mine"
        assert small.bench.pulses_sent == before
        assert len(small.service.library.reconstructions) == 0

    @pytest.mark.parametrize(
        "name", ["", ".", "..", "../sim", "a/b", "/tmp", "~", "Sim", "sim\n", "sim\x00", "-sim", "é", "x" * 65, 7]
    )
    def test_a_path_is_no_name(self, lasting: SmallService, name: object) -> None:
        for path, request in ((CALL, {}), (RECONSTRUCTIONS, {"capture": "x"})):
            body = problem(lasting.client.post(path, json={**request, "weights": name}), 422, "validation")
            assert body["errors"][0]["field"] == "body.weights"

    @pytest.mark.parametrize("method", ["wft", "nstep", "shearlet"])
    def test_other_methods_take_none(self, lasting: SmallService, method: str) -> None:
        body = problem(lasting.client.post(CALL, json={"method": method, "weights": "sim"}), 422, "validation")
        assert "only refiner does" in body["detail"]

    def test_weights_for_other_fringes_are_not_passed_over(self, small: SmallService, put: Put) -> None:
        put("other", periods=[9.0, 15.0])
        request = {"capture": stored_capture(small, "full"), "weights": "other"}
        body = problem(small.client.post(RECONSTRUCTIONS, json=request), 422, "weights-unusable")
        assert body["detail"].startswith("other: weights are for fringes of 9 and 15 columns, not 9 and 14")

    def test_weights_that_take_the_place_of_others_are_noticed(self, small: SmallService, put: Put) -> None:
        folder = put("mine")
        request = {"capture": stored_capture(small, "composite"), "weights": "mine", "depth_range": DEPTH_RANGE}
        assert small.client.post(RECONSTRUCTIONS, json=request).status_code == 201
        shutil.rmtree(folder)
        put("mine", periods=[9.0, 15.0])
        problem(small.client.post(RECONSTRUCTIONS, json=request), 422, "weights-unusable")
        shutil.rmtree(folder)
        problem(small.client.post(RECONSTRUCTIONS, json=request), 422, "weights-unusable")


class TestRepeating:
    def test_the_first_answer_stays_when_the_default_changes(
        self, small: SmallService, other_default: Callable[..., Path]
    ) -> None:
        request = {"depth_range": DEPTH_RANGE}
        first = small.client.post(CALL, json=request, headers={"Idempotency-Key": "k"})
        assert first.json()["reconstruction"]["method"] == "refiner"
        (other_default() / TENSORS_NAME).unlink()
        again = small.client.post(CALL, json=request, headers={"Idempotency-Key": "k"})
        assert again.json() == first.json()
        assert small.bench.pulses_sent == 1

    @pytest.mark.parametrize("other", [{"method": "refiner"}, {"method": "wft"}, {"weights": "sim"}])
    def test_another_method_or_weights_are_another_request(self, small: SmallService, other: dict[str, str]) -> None:
        capture = stored_capture(small, "composite")
        request = {"capture": capture, "depth_range": DEPTH_RANGE}
        headers = {"Idempotency-Key": "k"}
        assert small.client.post(RECONSTRUCTIONS, json=request, headers=headers).status_code == 201
        response = small.client.post(RECONSTRUCTIONS, json={**request, **other}, headers=headers)
        problem(response, 422, "idempotency-key-reused")


def test_the_warm_up_loads_the_weights(recorded: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    source = ReplaySource(recorded)
    with small_service(source, tmp_path / "library", calibration=small_rig().rig) as running:
        with caplog.at_level(logging.WARNING):
            warm_up(running.service)
        assert not caplog.records
        assert running.client.get("/v1/health/ready").json()["checks"][-1]["detail"] == "sim serves"
