"""How operations document their errors."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

_CONTENT = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """``responses=`` of an operation: its own errors beside those that any operation may have."""
    return {status: {"description": HTTPStatus(status).phrase, "content": _CONTENT} for status in statuses}


def files(*media_types: str) -> dict[int | str, dict[str, Any]]:
    """``responses=`` of an operation that answers with one file of these types."""
    content = {media_type: {"schema": {"type": "string", "format": "binary"}} for media_type in media_types}
    return {200: {"description": "The file", "content": content}}


ANY_ERROR: dict[int | str, dict[str, Any]] = {
    "default": {"description": "Problem details (RFC 9457)", "content": _CONTENT}
}
