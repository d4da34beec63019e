"""How long a job will take still, from how its share grew."""

from __future__ import annotations

_LEAST_SHARE = 1e-9


class Estimate:
    """Fed with the share done and the time; begins anew where the share falls, for that is another stage."""

    def __init__(self) -> None:
        self._begun: tuple[float, float] | None = None
        self._last = 0.0

    def remaining_s(self, share: float, now_s: float) -> float | None:
        """Seconds until the share is 1 at the mean rate so far; None before that can be told."""
        if self._begun is None or share < self._last:
            self._begun = (share, now_s)
        self._last = share
        grown, spent = share - self._begun[0], now_s - self._begun[1]
        if grown < _LEAST_SHARE or spent <= 0:
            return None
        return round(spent * (1 - share) / grown, 1)
