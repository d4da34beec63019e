"""Links between the parts of a list."""

from __future__ import annotations

from urllib.parse import urlencode


def next_link(path: str, **query: object) -> str:
    """``Link`` header to the page after this one, of the same list; parameters that are None are left out."""
    given = {name: value for name, value in query.items() if value is not None}
    return f'<{path}?{urlencode(given)}>; rel="next"'
