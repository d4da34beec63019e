"""The image's files, read as far as their tests need."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

import yaml

ROOT = Path(__file__).parents[2]
DOCKER = ROOT / "docker"
_DEFAULT = re.compile(r"\$\{(?P<name>\w+)(?::-(?P<default>[^}]*)|:\?[^}]*)?\}")


class Instruction(NamedTuple):
    """One instruction of the Dockerfile, on one line."""

    name: str
    text: str


def instructions() -> list[Instruction]:
    lines = (DOCKER / "Dockerfile").read_text().splitlines()
    text = "\n".join(line for line in lines if not line.lstrip().startswith("#")).replace("\\\n", " ")
    found = (line.strip().partition(" ") for line in text.splitlines() if line.strip())
    return [Instruction(name.upper(), " ".join(rest.split())) for name, _, rest in found]


def of(name: str) -> list[str]:
    """The texts of all instructions of one name."""
    return [instruction.text for instruction in instructions() if instruction.name == name]


def services(**environment: str) -> dict[str, Any]:
    """The services of compose.yaml with variables filled in as Compose does."""
    text = (DOCKER / "compose.yaml").read_text()
    filled = _DEFAULT.sub(lambda m: environment.get(m["name"], m["default"] or ""), text)
    made: dict[str, Any] = yaml.safe_load(filled)["services"]
    return made


def is_sent_to_the_builder(path: str) -> bool:
    """Whether the list of ignored files lets a path of the source folder through; the last line that fits decides."""
    sent = True
    for line in (DOCKER / "Dockerfile.dockerignore").read_text().splitlines():
        pattern = line.strip().removeprefix("!")
        if line.strip() and not line.startswith("#") and fnmatch(path, pattern):
            sent = line.startswith("!")
    return sent
