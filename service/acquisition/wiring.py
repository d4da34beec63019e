"""Whether each camera sees each pulse of the projector: counted in the dark first, then over a short sequence."""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from drivers.camera import Camera, Trigger
from drivers.devices import RigDevices
from drivers.errors import FrameTimeoutError, IncompleteFrameError
from models.geometry.rig import Side
from models.patterns import PatternPlan, make_plan
from service.acquisition.cancellation import Cancellation
from service.acquisition.recorded import RigSettings, View
from service.acquisition.sequence import record_sequence

_PULSES = 8
_LISTEN_S = 0.3
_SLICE_S = 0.05


@dataclass(frozen=True)
class LineCount:
    """What one camera saw of its trigger line.

    stray: exposures while the projector was dark, or before it started. seen: exposures during the sequence.
    lost: of these, frames that did not arrive whole. failure: what ended the counting early, empty where nothing did.
    """

    device: str
    stray: int
    seen: int
    lost: int = 0
    failure: str = ""


@dataclass(frozen=True)
class WiringCount:
    """sent: pulses of the projector. lines: what each camera saw. failure: the projector's own, if any."""

    sent: int
    lines: Mapping[Side, LineCount]
    failure: str = ""

    @property
    def silent(self) -> bool:
        """Whether no camera saw anything: then it is the projector, or what all cables have in common."""
        return all(line.seen == 0 and line.stray == 0 and not line.failure for line in self.lines.values())


def count_pulses(
    devices: RigDevices, settings: RigSettings, *, pulses: int = _PULSES, cancellation: Cancellation | None = None
) -> WiringCount:
    """Arm both open cameras, listen while it is dark, then show a short sequence and count its pulses.

    Whatever happens, it ends dark and the cameras disarmed. Raises DriverError where a device cannot be configured,
    loaded, armed or started, or is lost while it is dark, and CaptureCancelledError.
    """
    cancellation = cancellation or Cancellation()
    stray = _listen(devices, settings, cancellation)
    plan = _first(devices.projector.info.stored or make_plan("reference"), pulses)
    sequence = record_sequence(devices, plan, settings, cancellation)
    lines = {side: _line(view, stray[side], sequence.started_ns) for side, view in sequence.views.items()}
    return WiringCount(len(plan), lines, "" if sequence.error is None else str(sequence.error))


def _first(plan: PatternPlan, count: int) -> PatternPlan:
    """What is shown matters to nobody here: it need not be decodable."""
    return PatternPlan(patterns=plan.patterns[:count])


def _listen(devices: RigDevices, settings: RigSettings, cancellation: Cancellation) -> dict[Side, int]:
    """Exposures of each camera while the projector is dark."""
    cameras = devices.cameras
    devices.projector.stop()
    with ThreadPoolExecutor(len(cameras), thread_name_prefix="duofringe-listener") as pool:
        try:
            for side, camera in cameras.items():
                camera.configure(settings.cameras[side])
            for camera in cameras.values():
                camera.arm(None, Trigger.HARDWARE_EDGE)
            until_s = time.monotonic() + _LISTEN_S
            listening = {side: pool.submit(_strays, c, until_s, cancellation) for side, c in cameras.items()}
            return {side: future.result() for side, future in listening.items()}
        finally:
            for camera in cameras.values():
                camera.disarm()


def _strays(camera: Camera, until_s: float, cancellation: Cancellation) -> int:
    count = 0
    while (left_s := until_s - time.monotonic()) > 0:
        cancellation.raise_if_requested()
        try:
            camera.wait_frame(min(_SLICE_S, left_s))
        except FrameTimeoutError:
            continue
        except IncompleteFrameError:
            pass  # damaged, but exposed
        count += 1
    return count


def _line(view: View, stray: int, started_ns: int) -> LineCount:
    early = sum(frame.host_ns < started_ns for frame in view.frames)
    arrived = len(view.frames) + len(view.incomplete) + view.statistics.unclaimed
    highest = max((frame.frame_id for frame in view.frames), default=view.first_frame_id - 1)
    exposed = max(arrived, highest + 1 - view.first_frame_id)
    lost = exposed - arrived + len(view.incomplete)
    failure = "" if view.error is None else str(view.error)
    return LineCount(view.device, stray + early, exposed - early, lost, failure)
