"""Bearer keys; without any configured the loopback interface is the lock."""

from __future__ import annotations

import secrets
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.exceptions import HTTPException

_bearer = HTTPBearer(auto_error=False, description="One of DUOFRINGE_API_KEYS; needed only where keys are configured.")


def authenticate(
    request: Request, given: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)] = None
) -> None:
    """Raise 401 unless no keys are configured or one of them was sent; every key is compared, in constant time."""
    keys = request.app.state.settings.api_keys
    if not keys:
        return
    sent = b"" if given is None else given.credentials.encode()
    matches = [secrets.compare_digest(sent, key.get_secret_value().encode()) for key in keys]
    if not any(matches):
        raise HTTPException(
            401, "send 'Authorization: Bearer KEY' with one of the service's keys", {"WWW-Authenticate": "Bearer"}
        )
