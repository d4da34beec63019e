"""Bearer keys; without any configured the loopback interface is the lock."""

from __future__ import annotations

import secrets
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.exceptions import HTTPException

_bearer = HTTPBearer(auto_error=False, description="One of DUOFRINGE_API_KEYS; needed only where keys are configured.")


def authenticate(
    request: Request, given: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)] = None
) -> None:
    """Raise 401 unless no keys are configured or one of them was sent; every key is compared, in constant time.

    Without keys raise 403 for a request that a page of another site made in a browser on this computer.
    """
    keys = request.app.state.settings.api_keys
    if not keys:
        _require_same_origin(request)
        return
    sent = b"" if given is None else given.credentials.encode()
    matches = [secrets.compare_digest(sent, key.get_secret_value().encode()) for key in keys]
    if not any(matches):
        raise HTTPException(
            401, "send 'Authorization: Bearer KEY' with one of the service's keys", {"WWW-Authenticate": "Bearer"}
        )


def _require_same_origin(request: Request) -> None:
    """Browsers name the page's origin whenever they send anything but a plain GET."""
    origin = request.headers.get("origin")
    if origin is not None and urlsplit(origin).netloc.lower() != request.headers.get("host", "").lower():
        raise HTTPException(403, "without API keys only pages of this very service may use it")
