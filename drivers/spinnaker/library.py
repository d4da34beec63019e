"""PySpin, and what it asks of whoever uses it: who holds a camera, and when the whole may be released."""

from __future__ import annotations

import importlib
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from drivers.errors import DeviceUnavailableError
from drivers.genicam.connection import LibraryError

NOT_INITIALIZED, RESOURCE_IN_USE, ACCESS_DENIED, IO, TIMEOUT = -1002, -1004, -1005, -1010, -1011
NOT_AVAILABLE, BUSY, NO_ACCESS, GENICAM_TIMEOUT = -1014, -1022, -2006, -2007
"""Numbers of Spinnaker::Error, as its SpinnakerDefs.h gives them."""
_NUMBER = re.compile(r"\[(-\d+)\]")
_LOADING = threading.Lock()
_loaded: Spinnaker | None = None


class SpinnakerError(LibraryError):
    """What the library reports. code: one of Spinnaker::Error."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code

    @property
    def is_silence(self) -> bool:
        """The camera is not there, or gives no answer in time."""
        return self.code in (NOT_INITIALIZED, IO, TIMEOUT, GENICAM_TIMEOUT)


class Spinnaker:
    """The library in this process. module: PySpin.

    Its system is one for all cameras: made for the first of its users, released once after the last. Spinnaker refuses
    to release it while any pointer to a camera or an image is left anywhere.
    """

    def __init__(self, module: Any) -> None:
        self.module = module
        self._lock = threading.Lock()
        self._system: Any = None
        self._users = 0
        self._claimed: set[str] = set()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Raises SpinnakerError for what the library raises."""
        try:
            return function(*arguments)
        except self.module.SpinnakerException as error:
            failure = _translated(error)
        del function, arguments  # who keeps the error would keep the camera
        raise failure

    def acquire(self) -> None:
        """Use the system until ``release``."""
        with self._lock:
            if self._system is None:
                self._system = self.call(self.module.System.GetInstance)
            self._users += 1

    def release(self) -> None:
        """End one use; never raises."""
        with self._lock:
            self._users -= 1
            if self._users:
                return
            with suppress(SpinnakerError):  # left in use: kept for the next user, and released after that one
                self.call(self._system.ReleaseInstance)
                self._system = None

    @contextmanager
    def cameras(self) -> Iterator[Any]:
        """The cameras that answer, as the library lists them; only between ``acquire`` and ``release``."""
        listed = self.call(self._system.GetCameras)
        try:
            yield listed
        finally:
            self.call(listed.Clear)

    def claim(self, camera: str) -> bool:
        """Whether nobody in this process held the camera, who then does; the library would share it."""
        with self._lock:
            free = camera not in self._claimed
            self._claimed.add(camera)
            return free

    def disclaim(self, camera: str) -> None:
        with self._lock:
            self._claimed.discard(camera)


class CameraHandle:
    """The only owner of a pointer to a camera, which an error or a waiting thread would else keep alive."""

    def __init__(self, spinnaker: Spinnaker, pointer: Any) -> None:
        self.spinnaker = spinnaker
        self._pointer = pointer

    def call(self, name: str, *arguments: Any) -> Any:
        """A method of the camera. Raises SpinnakerError, also after ``drop``."""
        if self._pointer is None:
            raise SpinnakerError(NOT_INITIALIZED, "the camera was let go")
        return self.spinnaker.call(getattr(self._pointer, name), *arguments)

    def drop(self) -> None:
        self._pointer = None


def load_spinnaker(device: str) -> Spinnaker:
    """The library; once a process. Raises DeviceUnavailableError for ``device`` where PySpin is not installed."""
    global _loaded
    with _LOADING:
        try:
            module: Any = importlib.import_module("PySpin")
        except (ImportError, OSError) as error:
            raise DeviceUnavailableError(
                device,
                f"PySpin cannot be loaded ({_one_line(error)}); install FLIR's Spinnaker SDK and the PySpin wheel for "
                'this Python that comes with it, or set rig.cameras.driver to "aravis"',
            ) from error
        if _loaded is None or _loaded.module is not module:
            _loaded = Spinnaker(module)
        return _loaded


def _translated(error: Exception) -> SpinnakerError:
    """The number is an attribute, and in older releases only the end of the text."""
    text = _one_line(error)
    numbers = _NUMBER.findall(text)
    code = getattr(error, "errorcode", None)
    if code is None:
        code = int(numbers[-1]) if numbers else 0
    return SpinnakerError(code, text)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
