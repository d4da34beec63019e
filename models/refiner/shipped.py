"""Weights that come with the package, by name."""

from __future__ import annotations

from pathlib import Path

from models.refiner.errors import RefinerError
from models.refiner.weights import RECORD_NAME, TENSORS_NAME

FOLDER = Path(__file__).with_name("shipped_weights")
DEFAULT = "sim"


def shipped_names() -> tuple[str, ...]:
    """Names of the weights in the package, the default first."""
    names = sorted(path.parent.name for path in FOLDER.glob(f"*/{RECORD_NAME}"))
    return tuple(sorted(names, key=lambda name: name != DEFAULT))


def find_weights(chosen: str | None = None) -> Path:
    """The folder of weights: None for the default, a shipped name, or the path of a folder or of one of its two files.

    Raises RefinerError where there is none.
    """
    if chosen is None or chosen in shipped_names():
        return FOLDER / (chosen or DEFAULT)
    path = Path(chosen)
    if path.name in (RECORD_NAME, TENSORS_NAME):
        path = path.parent
    if not path.is_dir():
        raise RefinerError(
            f"weights '{chosen}' are neither a folder nor shipped; shipped are {', '.join(shipped_names()) or 'none'}"
        )
    return path
