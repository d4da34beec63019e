"""The live view: frames of both cameras while somebody watches and nobody captures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from drivers.camera import Camera, CameraState, Frame, Trigger
from drivers.devices import RigDevices
from drivers.errors import DriverError, FrameTimeoutError, IncompleteFrameError
from drivers.projector import Projector, ProjectorState
from models.errors import DuofringeError
from models.geometry.rig import SIDES, Side
from models.patterns import Pattern
from service.acquisition.recorded import RigSettings

_FRAME_S = 0.5
_ASK_S = 1.0
"""How often devices that nobody watches are asked whether they are there."""
_PAUSE_S = 0.5
"""Wait after a device failed, before the live view tries it again."""


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """The newest frame of one camera; ``number`` grows with every frame."""

    frame: Frame
    white_level: int
    number: int


class LiveView:
    """Runs the cameras freely, in one thread, as long as there are watchers.

    settings: asked before each start, so that changes show. pattern: what the projector holds meanwhile, None for dark.
    """

    def __init__(
        self, devices: RigDevices, settings: Callable[[], RigSettings], pattern: Callable[[], Pattern | None]
    ) -> None:
        self._devices = devices
        self._settings = settings
        self._pattern = pattern
        self._changed = threading.Condition()
        self._watchers: dict[Side, int] = dict.fromkeys(SIDES, 0)
        self._suspensions = 0
        self._closed = False
        self._running = False
        self._thread: threading.Thread | None = None
        self._newest: dict[Side, LiveFrame] = {}
        self._number = 0

    @property
    def running(self) -> bool:
        """Whether cameras run freely at this moment."""
        return self._running

    @property
    def closed(self) -> bool:
        """Whether the view has ended for good."""
        return self._closed

    @property
    def watchers(self) -> Mapping[Side, int]:
        """How many watch each camera."""
        return dict(self._watchers)

    @contextmanager
    def watch(self, side: Side) -> Iterator[Callable[[], LiveFrame | None]]:
        """Keep a camera running; yields a function that returns the newest frame since the watching began, or None."""
        with self._changed:
            begun = self._number
            self._watchers[side] += 1
            if not self._closed and (self._thread is None or not self._thread.is_alive()):
                self._thread = threading.Thread(target=self._run, name="duofringe-live", daemon=True)
                self._thread.start()
            self._changed.notify_all()

        def newest() -> LiveFrame | None:
            frame = self._newest.get(side)
            return frame if frame is not None and frame.number > begun else None

        try:
            yield newest
        finally:
            with self._changed:
                self._watchers[side] -= 1
                self._changed.notify_all()

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Cameras and projector are the caller's alone until the block ends."""
        with self._changed:
            self._suspensions += 1
            self._changed.notify_all()
            while self._running:
                for camera in self._devices.cameras.values():
                    camera.disarm()  # wakes a waiting frame at once
                self._changed.wait(0.02)
        try:
            yield
        finally:
            with self._changed:
                self._suspensions -= 1
                self._changed.notify_all()

    def end(self) -> None:
        """Ask the thread and all watchers to end, without waiting for them."""
        self._closed = True

    def close(self) -> None:
        """End the thread, whoever still watches."""
        self.end()
        with self._changed:
            self._changed.notify_all()
            thread = self._thread
        if thread is not None:
            thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._suspensions and self._wanted():
                    self._changed.wait()
                if not self._wanted():
                    self._thread = None
                    return
                self._running = True
            failed = False
            try:
                self._grab()
            except DuofringeError:
                failed = True  # whoever captures next meets the fault and names it
            finally:
                self._rest()
                with self._changed:
                    self._running = False
                    self._changed.notify_all()
            if failed:
                with self._changed:
                    if not self._suspensions:
                        self._changed.wait(_PAUSE_S)

    def _grab(self) -> None:
        """Frames from the watched cameras in turn, until suspended or nobody watches."""
        if self._devices.projector.state in (ProjectorState.OPEN, ProjectorState.LOADED, ProjectorState.HOLDING):
            self._devices.projector.show(self._pattern())
        settings = self._settings()
        white_levels: dict[Side, int] = {}
        asked_s = time.monotonic()
        while self._wanted() and not self._is_suspended():
            if time.monotonic() - asked_s > _ASK_S:
                self._ask_all()
                asked_s = time.monotonic()
            for side, camera in self._devices.cameras.items():
                if not self._watchers[side]:
                    if camera.state is CameraState.ARMED:
                        camera.disarm()
                    continue
                if camera.state is not CameraState.ARMED:
                    white_levels[side] = camera.configure(settings.cameras[side]).white_level
                    if self._is_suspended():
                        return
                    camera.arm(None, Trigger.FREE_RUN)
                self._publish(side, camera, white_levels[side])

    def _ask_all(self) -> None:
        """Have each device show that it is there; one that is lost says so by its state, and the view goes on."""
        devices: tuple[Camera | Projector, ...] = (*self._devices.cameras.values(), self._devices.projector)
        for device in devices:
            with suppress(DriverError):
                device.check()

    def _wanted(self) -> bool:
        return not self._closed and any(self._watchers.values())

    def _is_suspended(self) -> bool:
        return self._suspensions > 0

    def _publish(self, side: Side, camera: Camera, white_level: int) -> None:
        try:
            frame = camera.wait_frame(_FRAME_S)
        except (FrameTimeoutError, IncompleteFrameError):
            return
        self._number += 1
        self._newest[side] = LiveFrame(frame, white_level, self._number)

    def _rest(self) -> None:
        for camera in self._devices.cameras.values():
            camera.disarm()
        self._devices.projector.stop()
