"""What the operations on captures do, apart from HTTP."""

from __future__ import annotations

from dataclasses import replace

from models.capture import Capture
from models.patterns import PatternKind
from service.acquisition.outcome import CaptureOutcome
from service.acquisition.request import CaptureRequest
from service.context import Service
from service.library import NotFoundError, StoredCapture


def take(
    service: Service, request: CaptureRequest, capture_id: str, *, needs: frozenset[PatternKind] = frozenset()
) -> CaptureOutcome:
    """Take a capture that bears the id already; nothing is stored. Raises as ``Orchestrator.capture``, or disk full."""
    service.library.require_space()
    outcome = service.orchestrator.capture(request, needs=needs)
    return replace(outcome, capture=_named(outcome.capture, capture_id))


def already_stored(service: Service, capture_id: str) -> StoredCapture | None:
    """The capture of an earlier request that ended before it could answer."""
    try:
        return service.library.captures.get(capture_id)
    except NotFoundError:
        return None


def _named(capture: Capture, capture_id: str) -> Capture:
    record = capture.record.model_copy(update={"id": capture_id})
    return replace(capture, record=record, source=f"capture {capture_id}")
