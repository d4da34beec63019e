"""What ids, clocks and settings tell about a sequence: every frame there, once, in time, under the settings asked for.

They cannot tell what a frame shows; that is the audit's part.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivers.camera import AppliedSettings, Frame, Trigger
from drivers.errors import DeviceLostError
from service.acquisition.finding import Fault, Finding
from service.acquisition.recorded import RecordedSequence, View

_INTERVAL_TOLERANCE = 0.05
"""Of the period; what a device clock may disagree with the pulses."""
_CLOCK_RESOLUTION_NS = 250_000
"""Two ticks of the coarsest camera clock known."""
LATE_S = 0.15
"""A frame that arrives this much after its neighbours' delay was held up, and may be another exposure's."""


def check_sequence(sequence: RecordedSequence, late_s: float = LATE_S) -> tuple[Finding, ...]:
    """All findings of a sequence, the projector's first; empty for a good one."""
    findings: list[Finding] = []
    views = tuple(sequence.views.values())
    if sequence.error is not None:
        findings.append(Finding(Fault.LOST, sequence.error.device, str(sequence.error)))
    if all(not view.frames and not view.incomplete and view.error is None for view in views):
        return (*findings, _nothing(sequence))
    for view in views:
        findings += _Check(view, sequence).findings()
    findings += _late(sequence, late_s)
    return tuple(findings)


def _nothing(sequence: RecordedSequence) -> Finding:
    if sequence.trigger is Trigger.SOFTWARE:
        message = "left camera: neither it nor the right camera gave a frame when called; check their links"
        return Finding(Fault.NO_TRIGGER, "left camera", message, index=0)
    message = (
        "projector: no camera saw a pulse, the sequence did not start; "
        "check the lamp, the trigger cable and the trigger's polarity"
    )
    return Finding(Fault.NOT_STARTED, "projector", message, index=0)


class _Check:
    """The checks of one camera's view."""

    def __init__(self, view: View, sequence: RecordedSequence) -> None:
        self.view = view
        self.plan = sequence.loaded.plan
        self.pulses_ns = 1000 * np.asarray(sequence.loaded.pulses_us)
        self.started_ns = sequence.started_ns
        self.wired = sequence.trigger is Trigger.HARDWARE_EDGE

    def findings(self) -> list[Finding]:
        view, count = self.view, len(self.plan)
        arrived = len(view.frames) + len(view.incomplete)
        if view.error is not None:
            fault = Fault.LOST if isinstance(view.error, DeviceLostError) else Fault.INCOMPLETE
            return [self._finding(fault, min(arrived, count - 1), str(view.error))]
        if arrived == 0:
            wiring = "saw no pulse; check its trigger cable, line and polarity"
            return [self._finding(Fault.NO_TRIGGER, 0, wiring if self.wired else "did not take the call to expose")]
        found = [self._finding(Fault.INCOMPLETE, i, f"came damaged ({s})") for i, s in view.incomplete.items()]
        early = [k for k, frame in enumerate(view.frames) if frame.host_ns < self.started_ns]
        if early:
            found.append(self._finding(Fault.EARLY, 0, "came before the projector started; check the trigger's wiring"))
        if arrived < count:
            found.append(self._missing())
        elif view.statistics.unclaimed or arrived > count:
            found.append(self._extra())
        elif not found:
            found += self._numbering() or (self._spacing() if self.wired else [])
        return found + list(self._settings())

    def _missing(self) -> Finding:
        """Which frame is not there: a gap in the ids was lost on the way, a gap in time was never exposed."""
        ids = [frame.frame_id - self.view.first_frame_id for frame in self.view.frames]
        for position, number in enumerate(ids):
            if number != position and not self.view.incomplete:
                return self._finding(Fault.DROPPED, position, "was exposed but never arrived; check the link's load")
        gap = self._gap() if self.wired else None
        if gap is not None:
            return self._finding(Fault.IGNORED, gap, "was not exposed: the pulse came while the camera was not ready")
        last = len(self.view.frames) + len(self.view.incomplete)
        return self._finding(Fault.DROPPED, last, "and those after it never arrived")

    def _gap(self) -> int | None:
        """Position of the first exposure that the device clock shows to be missing."""
        times = np.array([frame.device_ns for frame in self.view.frames])
        if len(times) < 2 or self.view.incomplete:
            return None
        since = times - times[0]
        wanted = self.pulses_ns[: len(times)] - self.pulses_ns[0]
        off = np.flatnonzero(since - wanted > self._tolerance_ns())
        return int(off[0]) if len(off) else None

    def _extra(self) -> Finding:
        times = np.array([frame.device_ns for frame in self.view.frames])
        wanted = np.diff(self.pulses_ns[: len(times)])
        short = np.flatnonzero(np.diff(times) < wanted - self._tolerance_ns())
        index = int(short[0]) + 1 if len(short) else len(self.plan) - 1
        extra = self.view.statistics.unclaimed or 1
        return self._finding(Fault.EXTRA, index, f"is followed by {extra} frame(s) too many; a pulse was seen twice")

    def _numbering(self) -> list[Finding]:
        for position, frame in enumerate(self.view.frames):
            wanted = self.view.first_frame_id + position
            if frame.frame_id != wanted:
                return [self._finding(Fault.DROPPED, position, f"has id {frame.frame_id}, not {wanted}: one was lost")]
        return []

    def _spacing(self) -> list[Finding]:
        times = np.array([frame.device_ns for frame in self.view.frames])
        off = np.diff(times) - np.diff(self.pulses_ns[: len(times)])
        wrong = np.flatnonzero(np.abs(off) > self._tolerance_ns())
        if not len(wrong):
            return []
        index = int(wrong[0]) + 1
        found = f"was exposed {off[index - 1] / 1e6:+.2f} ms off its pulse"
        return [self._finding(Fault.INTERVAL, index, found)]

    def _tolerance_ns(self) -> float:
        period = float(np.diff(self.pulses_ns).min()) if len(self.pulses_ns) > 1 else 0.0
        return max(_CLOCK_RESOLUTION_NS, _INTERVAL_TOLERANCE * period)

    def _settings(self) -> Iterator[Finding]:
        view = self.view
        if view.after is not None and view.after != view.applied:
            changed = _difference(view.applied, view.after)
            message = f"{view.device}: {changed} changed during the sequence; switch automatic functions off"
            yield Finding(Fault.SETTINGS, view.device, message)
        for index, frame in enumerate(view.frames):
            fault = _frame_fault(frame, view.applied)
            if fault:
                yield self._finding(Fault.SETTINGS, index, fault)
                return

    def _finding(self, fault: Fault, index: int, what: str) -> Finding:
        if fault is Fault.LOST:
            at = f"{what} (at exposure {index}, {self.plan.names[index]})"
            return Finding(fault, self.view.device, at, index, self.plan.names[index])
        index = min(index, len(self.plan) - 1)
        name = self.plan.names[index]
        return Finding(fault, self.view.device, f"{self.view.device}: exposure {index} ({name}) {what}", index, name)


def _difference(before: AppliedSettings, after: AppliedSettings) -> str:
    """What reads back otherwise, in words."""
    names = [n for n in ("exposure_us", "gain_db", "bit_depth", "size") if getattr(before, n) != getattr(after, n)]
    features = {*before.features, *after.features}
    names += sorted(n for n in features if before.features.get(n) != after.features.get(n))
    return ", ".join(names) or "a setting"


def _frame_fault(frame: Frame, applied: AppliedSettings) -> str | None:
    height, width = frame.image.shape
    if (width, height) != applied.size:
        return f"is {width}x{height}, not {applied.size[0]}x{applied.size[1]}"
    if frame.exposure_us != applied.exposure_us or frame.gain_db != applied.gain_db:
        return f"was exposed {frame.exposure_us:g} us at {frame.gain_db:g} dB, not as configured"
    return None


def _late(sequence: RecordedSequence, late_s: float) -> list[Finding]:
    """Frames held up on their way: against those before in their view, and against the other view's arrival."""
    found = []
    views = tuple(sequence.views.values())
    for view in views:
        if not view.frames:
            continue
        delays = np.array([frame.host_ns - frame.device_ns for frame in view.frames])
        over = (delays - np.minimum.accumulate(delays)) / 1e9
        for other in views:
            if other is not view and len(other.frames) == len(view.frames):
                arrivals = [(a.host_ns - b.host_ns) / 1e9 for a, b in zip(view.frames, other.frames, strict=True)]
                over = np.maximum(over, arrivals)
        slow = np.flatnonzero(over > late_s)
        if len(slow):
            index = min(int(slow[0]), len(sequence.loaded.plan) - 1)
            name = sequence.loaded.plan.names[index]
            message = (
                f"{view.device}: exposure {index} ({name}) arrived {1e3 * over[index]:.0f} ms late; "
                "the link or this computer is overloaded"
            )
            found.append(Finding(Fault.LATE, view.device, message, index, name))
    return found
