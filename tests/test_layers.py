"""The rule of the rooms: imports go down only (service, then calibration and drivers, then models)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_ERROR, EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).parent.parent


def test_imports_go_down_only(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    status = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert status == EXIT_STATUS_SUCCESS, capsys.readouterr().out


@pytest.mark.parametrize(
    ("room_that_imports", "imported", "status"),
    [
        ("service", "models", EXIT_STATUS_SUCCESS),
        ("drivers", "models", EXIT_STATUS_SUCCESS),
        ("models", "service", EXIT_STATUS_ERROR),
        ("models", "drivers", EXIT_STATUS_ERROR),
        ("calibration", "drivers", EXIT_STATUS_ERROR),
        ("drivers", "calibration", EXIT_STATUS_ERROR),
    ],
)
def test_the_contract_catches_what_goes_up_or_sideways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room_that_imports: str, imported: str, status: int
) -> None:
    """The contract of pyproject.toml, applied to four empty rooms and one import."""
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]
    rooms = [room for layer in contract["layers"] for room in layer.replace(" ", "").split("|")]
    stand_ins = {room: f"room_of_{room}" for room in rooms}
    for room, package in stand_ins.items():
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text(
            f"import {stand_ins[imported]}\n" if room == room_that_imports else ""
        )
    layers = [" | ".join(stand_ins[r] for r in layer.replace(" ", "").split("|")) for layer in contract["layers"]]
    config = f"[tool.importlinter]\nroot_packages = {list(stand_ins.values())}\n"
    config += f'[[tool.importlinter.contracts]]\nname = "layers"\ntype = "{contract["type"]}"\nlayers = {layers}\n'
    (tmp_path / "pyproject.toml").write_text(config)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    assert lint_imports(config_filename=str(tmp_path / "pyproject.toml"), no_cache=True) == status
