"""The jobs of a service: asked for, looked at, cancelled, resumed."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from service.jobs.lane import JobLane, interrupt_unfinished, request_of
from service.jobs.record import RESUMABLE, JobKind, JobRecord
from service.jobs.requests import EvaluationJobRequest, JobRequest, TrainingJobRequest
from service.jobs.sources import Sources
from service.jobs.store import KIND, JobStore
from service.jobs.work import EVALUATION_NAME, WEIGHTS_NAME
from service.library import DamagedError, Library, LibraryError, NotFoundError, Page
from service.weights import WeightsShelf

FOLDER_NAME = "jobs"


class Jobs:
    """Use ``Jobs.open``, and ``close``; may be used by many threads."""

    def __init__(self, library: Library, store: JobStore, sources: Sources, lane: JobLane) -> None:
        self._library, self._store, self._sources, self._lane = library, store, sources, lane

    @classmethod
    def open(cls, library: Library, weights: WeightsShelf, datasets: Path, *, longest_queue: int = 16) -> Jobs:
        """The jobs of a library. What an earlier service left unfinished is interrupted from now on.

        datasets: folder of datasets that requests may name. longest_queue: how many may wait. Raises LibraryError.
        """
        folder = library.root / FOLDER_NAME
        try:
            store = JobStore(folder)
        except OSError as error:
            raise LibraryError(f"jobs '{folder}' cannot be opened: {error.strerror or error}") from error
        interrupt_unfinished(store)
        sources = Sources(library, weights, datasets)
        return cls(library, store, sources, JobLane(store, sources, longest_queue))

    def train(self, request: TrainingJobRequest, id: str) -> JobRecord:
        """Queue a training under a new id; the job of that id where there is one already.

        Raises InvalidIdError, NotFoundError or DamagedError for a capture, DatasetError, RefinerError for weights
        to begin from, WeightsTakenError, JobsFullError, DiskFullError.
        """
        return self._begin("training", request, id)

    def evaluate(self, request: EvaluationJobRequest, id: str) -> JobRecord:
        """Queue an evaluation; raises as ``train``."""
        return self._begin("evaluation", request, id)

    def get(self, id: str) -> JobRecord:
        """A job, as it is now; raises InvalidIdError and NotFoundError."""
        return self._store.get(id)

    def page(self, limit: int, cursor: str | None = None) -> Page[JobRecord]:
        """Jobs, newest first; raises CursorError."""
        return self._store.page(limit, cursor)

    def evaluation(self, id: str) -> Path:
        """File of all figures of an evaluation that is done; raises InvalidIdError, NotFoundError, DamagedError."""
        record = self._store.get(id)
        if record.kind != "evaluation" or record.state != "done":
            raise NotFoundError(KIND, id, "has no file of figures; evaluations have one when they are done")
        path = self._store.folder(id) / EVALUATION_NAME
        if not path.is_file():
            raise DamagedError(KIND, id, f"{EVALUATION_NAME} is missing")
        return path

    def cancel(self, id: str) -> JobRecord:
        """End or drop a job; raises InvalidIdError, NotFoundError, and JobStateError for one that is done."""
        return self._lane.cancel(id)

    def resume(self, id: str) -> JobRecord:
        """Go on with a job that was interrupted or has failed: a training from its newest state, an evaluation anew.

        Raises as ``train``, and JobStateError for a job in another state.
        """
        record = self._store.get(id)
        request = request_of(record)
        # where it has weights already, the name may be its own: they were published just before the service ended
        published = (self._store.folder(id) / WEIGHTS_NAME).exists()
        if isinstance(request, TrainingJobRequest) and record.state in RESUMABLE and not published:
            self._sources.require_free(request.name)
        self._library.require_space()
        return self._lane.resume(id)

    def close(self) -> None:
        """End what runs; it is left interrupted."""
        self._lane.close()

    def _begin(self, kind: JobKind, request: JobRequest, id: str) -> JobRecord:
        if id in self._store:
            return self._store.get(id)
        self._library.require_space()
        self._sources.check(request)
        record = JobRecord(
            id=id, kind=kind, state="queued", created=datetime.now(UTC), request=request.model_dump(mode="json")
        )
        return self._lane.add(record)
