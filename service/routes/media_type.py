"""Which bodies an operation takes."""

from __future__ import annotations

from fastapi import Request
from starlette.exceptions import HTTPException


def media_type_of(request: Request) -> str:
    """Type of the body without parameters, "" where none is given."""
    return request.headers.get("content-type", "").split(";")[0].strip().lower()


def require_json(request: Request) -> None:
    """Raise 415 for a body that says it is something else than JSON, or does not say what it is."""
    has_body = request.headers.get("content-length", "0") != "0" or "transfer-encoding" in request.headers
    given = media_type_of(request)
    if has_body and given != "application/json" and not (given.startswith("application/") and given.endswith("+json")):
        raise HTTPException(415, f"the body is '{given or 'untyped'}'; send application/json")
