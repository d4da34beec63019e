"""The lane of jobs: one after the other, each in a process of its own, beside captures and reconstructions."""

# ruff: noqa: A002  (an id is called id)

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from pydantic import ValidationError

from models.errors import DuofringeError
from service.jobs.completion import publish, tidy
from service.jobs.errors import JobsFullError, JobStateError, WeightsTakenError
from service.jobs.estimate import Estimate
from service.jobs.messages import Failed, Finished, Message, Stage, Unexpected
from service.jobs.process import JobProcess
from service.jobs.record import RECORD_NAME, RESUMABLE, UNFINISHED, JobRecord, JobState
from service.jobs.requests import EvaluationJobRequest, JobRequest, TrainingJobRequest
from service.jobs.sources import Sources
from service.jobs.store import KIND, JobStore
from service.library.errors import DamagedError, LibraryError

logger = logging.getLogger("duofringe.service")
_WRITTEN_EVERY_S = 1.0
_END_S = 30.0


@dataclass(eq=False)
class _Running:
    """The job in work. stop: the state that it is to be left in, once somebody wants it to end."""

    id: str
    process: JobProcess | None = None
    stop: JobState | None = None

    def end(self, state: JobState) -> None:
        self.stop = self.stop or state
        if self.process is not None:
            self.process.kill()


class JobLane:
    """Carries out the queued jobs of a store; may be used by many threads. longest_queue: how many may wait."""

    def __init__(self, store: JobStore, sources: Sources, longest_queue: int = 16) -> None:
        self._store, self._sources, self._longest_queue = store, sources, longest_queue
        self._changed = threading.Condition()
        self._queue: deque[str] = deque()
        self._running: _Running | None = None
        self._closing = False
        self._thread: threading.Thread | None = None

    def add(self, record: JobRecord) -> JobRecord:
        """Keep and queue a new job.

        Raises JobsFullError, WeightsTakenError where another job that is not done makes weights of the same name,
        JobStateError when the service ends, LibraryError.
        """
        with self._changed:
            self._require_place(record)
            stored = self._store.add(record)
            self._enqueue(record.id)
            return stored

    def resume(self, id: str) -> JobRecord:
        """Queue a job again that was interrupted or has failed; raises as ``add``, InvalidIdError, NotFoundError."""
        with self._changed:
            record = self._store.get(id)
            if record.state not in RESUMABLE:
                raise JobStateError(f"job '{id}' is {record.state}; only {' or '.join(sorted(RESUMABLE))} jobs go on")
            self._require_place(record)  # reads its request, too
            record = self._store.change(
                id, state="queued", started=None, ended=None, stage="", share=0.0, remaining_s=None, error=None
            )
            self._enqueue(id)
            return record

    def _require_place(self, record: JobRecord) -> None:
        if self._closing:
            raise JobStateError("the service is ending; ask again when it is back")
        if len(self._queue) >= self._longest_queue:
            raise JobsFullError(self._longest_queue)
        request = request_of(record)
        if isinstance(request, TrainingJobRequest):
            working = [*([] if self._running is None else [self._running.id]), *self._queue]
            for other in map(self._store.get, working):
                if other.kind == "training" and other.request["name"] == request.name:
                    raise WeightsTakenError(f"job '{other.id}' makes weights '{request.name}' already")

    def _enqueue(self, id: str) -> None:
        self._queue.append(id)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="duofringe-jobs", daemon=True)
            self._thread.start()
        self._changed.notify_all()

    def cancel(self, id: str) -> JobRecord:
        """End a job that runs, or drop one that is not done; what it has written is removed. Twice is no harm.

        Raises InvalidIdError, NotFoundError, and JobStateError for one that is done.
        """
        with self._changed:
            running = self._running
            if running is not None and running.id == id:
                running.end("cancelled")
                self._changed.wait_for(lambda: self._running is not running, _END_S)
            record = self._store.get(id)
            if record.state == "cancelled":
                return record
            if record.state == "done":
                raise JobStateError(f"job '{id}' is done; there is nothing to cancel")
            if id in self._queue:
                self._queue.remove(id)
            return self._cancelled(id)

    def close(self) -> None:
        """End what runs, which is left interrupted; what waits is found so by the next start."""
        with self._changed:
            self._closing = True
            self._queue.clear()
            if self._running is not None:
                self._running.end("interrupted")
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._queue)
                if self._closing:
                    return
                running = self._running = _Running(self._queue.popleft())
            try:
                self._carry_out(running)
            except DuofringeError as error:
                self._fail(running.id, str(error))
            except OSError as error:
                self._fail(running.id, error.strerror or str(error))
            except Exception:
                logger.exception("job %s failed", running.id)
                self._fail(running.id, _unexpected(running.id))
            finally:
                with self._changed:
                    self._running = None
                    self._changed.notify_all()

    def _carry_out(self, running: _Running) -> None:
        record = self._store.change(
            running.id, state="running", started=datetime.now(UTC), stage="starting", share=0.0, remaining_s=None
        )
        request = request_of(record)
        assert record.kind is not None
        folder = self._store.folder(running.id)
        process = JobProcess(self._sources.order(record.kind, request, folder))
        try:
            with self._changed:
                running.process = process
                if running.stop is not None:
                    process.kill()
            said = self._follow(running.id, process)
        except BaseException:
            process.kill()
            raise
        finally:
            ended = process.ended()
        with self._changed:  # from here on it is too late to stop it
            stop, running.process = running.stop, None
        if stop == "cancelled":
            self._cancelled(running.id)
        elif stop is not None:
            self._end(running.id, stop)
        elif isinstance(said, Finished):
            if isinstance(request, TrainingJobRequest):
                publish(folder, request, said.result, self._sources.weights.folder)
            self._end(running.id, "done", result=said.result, stage="done", share=1.0)
            tidy(folder)
        elif isinstance(said, Unexpected):
            logger.error("job %s failed: %s", running.id, said.trace)
            self._end(running.id, "failed", error=_unexpected(running.id))
        else:
            self._end(running.id, "failed", error=said.reason if isinstance(said, Failed) else ended)

    def _follow(self, id: str, process: JobProcess) -> Message | None:
        """Write down how far it is, at most once a second; the message that it ended with, if any."""
        estimate, written = Estimate(), 0.0
        last: Message | None = None
        for message in process.messages():
            if not isinstance(message, Stage):
                last = message
                continue
            now = time.monotonic()
            remaining = estimate.remaining_s(message.share, now)
            if now - written < _WRITTEN_EVERY_S:
                continue
            written = now
            try:
                self._store.change(id, stage=message.text, share=message.share, remaining_s=remaining)
            except DuofringeError as error:
                logger.warning("%s", error)
        return last

    def _cancelled(self, id: str) -> JobRecord:
        record = self._end(id, "cancelled")
        self._store.discard_output(id)
        return record

    def _end(self, id: str, state: JobState, **changed: Any) -> JobRecord:
        logger.info("job %s is %s", id, state)
        return self._store.change(id, state=state, ended=datetime.now(UTC), remaining_s=None, **changed)

    def _fail(self, id: str, error: str) -> None:
        try:
            self._end(id, "failed", error=error)
        except DuofringeError as unwritten:
            logger.error("job %s failed, %s, which could not be written: %s", id, error, unwritten)


def request_of(record: JobRecord) -> JobRequest:
    """What a job was asked to do. Raises DamagedError where its record does not tell."""
    if record.kind is None:
        raise DamagedError(KIND, record.id, record.error or RECORD_NAME)
    kind = TrainingJobRequest if record.kind == "training" else EvaluationJobRequest
    try:
        return kind.model_validate(record.request)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, ("request", *first["loc"])))
        raise DamagedError(KIND, record.id, f"{RECORD_NAME}: {where}: {first['msg']}") from error


def interrupt_unfinished(store: JobStore) -> None:
    """Mark what an earlier service left queued or running; what cannot be written is told in the log."""
    for record in store:
        if record.state in UNFINISHED:
            try:
                store.change(record.id, state="interrupted", ended=datetime.now(UTC), remaining_s=None)
            except LibraryError as error:
                logger.warning("%s", error)


def _unexpected(id: str) -> str:
    return f"the job met an error of the program itself; the service's log has the details under {id}"
