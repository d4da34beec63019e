"""How the simulator's loops are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Loop = TypeVar("Loop", bound=Callable[..., Any])


def compiled(loop: Loop) -> Loop:
    """Machine code that runs without the interpreter's lock, so that threads may share the work; kept on disk."""
    return cast(Loop, numba.njit(nogil=True, cache=True)(loop))
