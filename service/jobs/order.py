"""What a job's own process is told: the request, and where the things lie that it names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from models.dataset import Dataset, open_dataset
from models.errors import DatasetError
from service.jobs.record import JobKind

CAPTURES = "captures"
"""What a job's captures of the library are called together, where a dataset would stand with its name."""


class Order(BaseModel):
    """All paths are absolute. folder: of the job. datasets, captures: by name or id; one of both is empty.

    weights: the service's own folder of weights. adapt: of those to begin from.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: JobKind
    folder: Path
    request: dict[str, object]
    datasets: dict[str, Path] = {}
    captures: dict[str, Path] = {}
    weights: Path
    adapt: Path | None = None

    def opened(self) -> list[Dataset]:
        """The datasets, or one of all captures, which are read where they are. Raises DatasetError, by name."""
        if self.captures:
            return [Dataset(Path(CAPTURES), self.captures)]
        return [named_dataset(name, path) for name, path in self.datasets.items()]

    def public(self, text: str) -> str:
        """A text for clients: with names where it has paths of this computer."""
        known = {**self.captures, **self.datasets}
        if self.adapt is not None:
            known[self.adapt.name] = self.adapt
        for name, path in sorted(known.items(), key=lambda item: -len(str(item[1]))):
            text = text.replace(str(path), name)
        return text.replace(f"{self.folder}/", "").replace(f"{self.weights}/", "")


def named_dataset(name: str, path: Path) -> Dataset:
    """A dataset that calls itself by its name. Raises DatasetError, likewise."""
    try:
        return replace(open_dataset(path), root=Path(name))
    except DatasetError as error:
        raise DatasetError(str(error).replace(str(path), name)) from error
