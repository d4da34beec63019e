"""What every error of the API has to be."""

from __future__ import annotations

from typing import Any
from urllib.parse import unquote

import httpx2


def problem(response: httpx2.Response, status: int, slug: str) -> dict[str, Any]:
    """The body of an error, which has to be problem details of this kind."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body: dict[str, Any] = response.json()
    assert body["type"] == f"/v1/problems/{slug}"
    assert body["status"] == status
    assert body["title"]
    assert body["detail"]
    assert unquote(body["instance"]) == unquote(response.request.url.path)
    return body
