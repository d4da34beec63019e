"""Settings of the transform methods as ``python -m benchmarks.select_transforms`` chose them and stored them."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

PATH = Path(__file__).with_suffix(".json")
"""Package data: by method ``settings`` and ``figures``, and from which scenes they come."""


@lru_cache(maxsize=1)
def _stored() -> dict[str, Any]:
    return dict(json.loads(PATH.read_text(encoding="utf-8"))["methods"])


def chosen_settings(method: str) -> dict[str, Any]:
    """Keyword arguments of the settings class of a method."""
    return dict(_stored()[method]["settings"])
