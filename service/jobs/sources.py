"""Where the things lie that a request for a job names: datasets, captures, weights."""

from __future__ import annotations

import re
from pathlib import Path

from models.dataset import Dataset
from models.errors import DuofringeError
from models.refiner.shipped import DEFAULT
from service.jobs.errors import UnknownDatasetError, WeightsTakenError
from service.jobs.order import CAPTURES, Order, named_dataset
from service.jobs.record import JobKind
from service.jobs.requests import DATASET_PATTERN, EvaluationJobRequest, JobRequest, TrainingJobRequest
from service.library import DamagedError, Library
from service.sample_evaluation import MethodChoice
from service.weights import WeightsShelf

_SHOWN = 20


class Sources:
    """datasets: folder of datasets, which need not exist."""

    def __init__(self, library: Library, weights: WeightsShelf, datasets: Path) -> None:
        self.weights = weights
        self._library = library
        self._datasets = datasets

    def check(self, request: JobRequest) -> None:
        """Raise DuofringeError, by class, for a request that names what does not exist or cannot serve."""
        split = "train" if isinstance(request, TrainingJobRequest) else request.split
        for name in _datasets_of(request):
            named_dataset(name, self._dataset_path(name)).capture_paths(split)
        if request.captures:
            Dataset(Path(CAPTURES), self._capture_paths(request.captures)).capture_paths(split)
        if isinstance(request, EvaluationJobRequest):
            for choice in map(MethodChoice.parse, request.methods):
                if choice.method == "refiner":
                    self.weights.get(choice.weights)
            return
        if request.adapt is not None:
            self.weights.get(request.adapt)
        _require_device(request.device)
        self.require_free(request.name)

    def require_free(self, name: str) -> None:
        """Raise WeightsTakenError for a name that new weights cannot have."""
        if name == DEFAULT or name in self.weights.names or (self.weights.folder / name).exists():
            raise WeightsTakenError(f"weights '{name}' exist already; choose another name")

    def order(self, kind: JobKind, request: JobRequest, folder: Path) -> Order:
        """A job as its process is told of it. Raises as ``check``, for what has vanished since."""
        adapt = None
        if isinstance(request, TrainingJobRequest) and request.adapt is not None:
            adapt = self.weights.get(request.adapt).folder.resolve()
        return Order(
            kind=kind,
            folder=folder.resolve(),
            request=request.model_dump(mode="json"),
            datasets={name: self._dataset_path(name) for name in _datasets_of(request)},
            captures=self._capture_paths(request.captures or ()),
            weights=self.weights.folder.resolve(),
            adapt=adapt,
        )

    def _dataset_path(self, name: str) -> Path:
        path = self._datasets / name
        if not path.is_dir():
            raise UnknownDatasetError(f"dataset '{name}' is unknown; there are {', '.join(self._names()) or 'none'}")
        return path.resolve()

    def _names(self) -> list[str]:
        if not self._datasets.is_dir():
            return []
        names = sorted(p.name for p in self._datasets.iterdir() if p.is_dir() and re.fullmatch(DATASET_PATTERN, p.name))
        return names if len(names) <= _SHOWN else [*names[:_SHOWN], "..."]

    def _capture_paths(self, ids: tuple[str, ...]) -> dict[str, Path]:
        found = {}
        for id in dict.fromkeys(ids):  # noqa: A001  (an id is called id)
            stored = self._library.captures.get(id)
            if stored.damaged is not None:
                raise DamagedError("capture", id, stored.damaged)
            found[id] = (self._library.root / "captures" / id).resolve()
        return found


def _datasets_of(request: JobRequest) -> tuple[str, ...]:
    if isinstance(request, TrainingJobRequest):
        return tuple(dict.fromkeys(request.datasets or ()))
    return () if request.dataset is None else (request.dataset,)


def _require_device(device: str) -> None:
    if device != "cpu":
        import torch  # a second of import that only a request for CUDA needs to wait for here

        index = int(device.partition(":")[2] or 0)
        if index >= torch.cuda.device_count():
            raise DuofringeError(f"device '{device}' is not in this computer; use cpu")
