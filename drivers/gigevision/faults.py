"""What can be made to go wrong at a certain pulse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TriggerFaults:
    """Indices count the pulses on the trigger line, or software triggers, since acquisition started, from 0.

    dropped: exposed, and never sent. corrupt: one packet of it is missing. delayed: sent so many seconds late.
    doubled: exposed twice, as by a bouncing edge. ignored: not exposed. dead_at: the camera falls silent at this pulse.
    """

    dropped: frozenset[int] = frozenset()
    corrupt: frozenset[int] = frozenset()
    delayed: Mapping[int, float] = field(default_factory=dict)
    doubled: frozenset[int] = frozenset()
    ignored: frozenset[int] = frozenset()
    dead_at: int | None = None
