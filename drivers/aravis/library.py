"""libaravis-0.8 by ctypes: prototypes, errors, and the release of what has died.

Works with 0.8.26 and later of the 0.8 series. Calls that wait let go of Python's lock.
"""

from __future__ import annotations

import ctypes
import functools
import os
import queue
import threading
from typing import Any, Literal

from drivers.errors import DeviceUnavailableError
from drivers.genicam.connection import LibraryError

PATH_VARIABLE = "ARAVIS_LIBRARY"
_DEFAULT = "libaravis-0.8.so.0"
_Handle = ctypes.c_void_p
_Text = ctypes.c_char_p
ErrorDomain = Literal["device", "genicam", "other"]
ControlLost = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
RANGE_CHECK = ACCESS_CHECK = 1
USB_MODES = {"sync": 0, "async": 1}


class AravisError(LibraryError):
    """What the library reports; callers turn it into a DriverError."""

    def __init__(self, domain: ErrorDomain, code: int, text: str) -> None:
        super().__init__(text)
        self.domain = domain
        self.code = code

    @property
    def is_silence(self) -> bool:
        """Not connected, transfer failed, or no answer in time."""
        return self.domain == "device" and self.code in (2, 4, 5)


class _GError(ctypes.Structure):
    _fields_ = [("domain", ctypes.c_uint32), ("code", ctypes.c_int), ("message", ctypes.c_char_p)]


_GErrorPointer = ctypes.POINTER(_GError)
_DOUBLE_TYPE = 15 << 2


class _GValue(ctypes.Structure):
    _fields_ = [("type", ctypes.c_size_t), ("data", ctypes.c_uint64 * 2)]


_PLAIN: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "update_device_list": (None, ()),
    "get_n_devices": (ctypes.c_uint, ()),
    "get_device_id": (_Text, (ctypes.c_uint,)),
    "get_device_model": (_Text, (ctypes.c_uint,)),
    "get_device_serial_nbr": (_Text, (ctypes.c_uint,)),
    "get_device_address": (_Text, (ctypes.c_uint,)),
    "get_device_protocol": (_Text, (ctypes.c_uint,)),
    "camera_get_device": (_Handle, (_Handle,)),
    "camera_is_gv_device": (ctypes.c_int, (_Handle,)),
    "camera_is_uv_device": (ctypes.c_int, (_Handle,)),
    "camera_set_range_check_policy": (None, (_Handle, ctypes.c_int)),
    "camera_set_access_check_policy": (None, (_Handle, ctypes.c_int)),
    "camera_uv_set_usb_mode": (None, (_Handle, ctypes.c_int)),
    "camera_gv_set_stream_options": (None, (_Handle, ctypes.c_int)),
    "gv_device_is_controller": (ctypes.c_int, (_Handle,)),
    "buffer_new_allocate": (_Handle, (ctypes.c_size_t,)),
    "buffer_get_data": (_Handle, (_Handle, ctypes.POINTER(ctypes.c_size_t))),
    "buffer_get_status": (ctypes.c_int, (_Handle,)),
    "buffer_get_frame_id": (ctypes.c_uint64, (_Handle,)),
    "buffer_get_timestamp": (ctypes.c_uint64, (_Handle,)),
    "buffer_get_system_timestamp": (ctypes.c_uint64, (_Handle,)),
    "buffer_get_image_width": (ctypes.c_int, (_Handle,)),
    "buffer_get_image_height": (ctypes.c_int, (_Handle,)),
    "buffer_get_image_pixel_format": (ctypes.c_uint32, (_Handle,)),
    "stream_push_buffer": (None, (_Handle, _Handle)),
    "stream_timeout_pop_buffer": (_Handle, (_Handle, ctypes.c_uint64)),
    "stream_try_pop_buffer": (_Handle, (_Handle,)),
    "device_error_quark": (ctypes.c_uint32, ()),
    "gc_error_quark": (ctypes.c_uint32, ()),
}
_CHECKED: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "camera_new": (_Handle, (_Text,)),
    "camera_is_feature_available": (ctypes.c_int, (_Handle, _Text)),
    "camera_get_string": (_Text, (_Handle, _Text)),
    "camera_set_string": (None, (_Handle, _Text, _Text)),
    "camera_get_integer": (ctypes.c_int64, (_Handle, _Text)),
    "camera_set_integer": (None, (_Handle, _Text, ctypes.c_int64)),
    "camera_get_integer_increment": (ctypes.c_int64, (_Handle, _Text)),
    "camera_get_integer_bounds": (
        None,
        (_Handle, _Text, ctypes.POINTER(ctypes.c_int64), ctypes.POINTER(ctypes.c_int64)),
    ),
    "camera_get_float": (ctypes.c_double, (_Handle, _Text)),
    "camera_set_float": (None, (_Handle, _Text, ctypes.c_double)),
    "camera_get_float_bounds": (
        None,
        (_Handle, _Text, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double)),
    ),
    "camera_get_boolean": (ctypes.c_int, (_Handle, _Text)),
    "camera_set_boolean": (None, (_Handle, _Text, ctypes.c_int)),
    "camera_execute_command": (None, (_Handle, _Text)),
    "camera_is_enumeration_entry_available": (ctypes.c_int, (_Handle, _Text, _Text)),
    "camera_get_payload": (ctypes.c_uint, (_Handle,)),
    "camera_create_stream": (_Handle, (_Handle, _Handle, _Handle)),
    "camera_start_acquisition": (None, (_Handle,)),
    "camera_stop_acquisition": (None, (_Handle,)),
}


class Library:
    """Calls by their names without ``arv_``; those that can fail raise AravisError."""

    def __init__(self, path: str) -> None:
        aravis = ctypes.CDLL(path)
        self._gobject = ctypes.CDLL("libgobject-2.0.so.0")
        self._glib = ctypes.CDLL("libglib-2.0.so.0")
        self._glib.g_error_free.argtypes = [_GErrorPointer]
        self._gobject.g_object_unref.argtypes = [_Handle]
        self._gobject.g_signal_connect_data.argtypes = [_Handle, _Text, ControlLost, _Handle, _Handle, ctypes.c_int]
        self._gobject.g_signal_connect_data.restype = ctypes.c_ulong
        self._gobject.g_signal_handler_disconnect.argtypes = [_Handle, ctypes.c_ulong]
        self._gobject.g_value_init.argtypes = [ctypes.POINTER(_GValue), ctypes.c_size_t]
        self._gobject.g_value_set_double.argtypes = [ctypes.POINTER(_GValue), ctypes.c_double]
        self._gobject.g_object_set_property.argtypes = [_Handle, _Text, ctypes.POINTER(_GValue)]
        self._calls = {name: _prototype(aravis, name, *types) for name, types in _PLAIN.items()}
        for name, (result, arguments) in _CHECKED.items():
            plain = _prototype(aravis, name, result, (*arguments, ctypes.POINTER(_GErrorPointer)))
            self._calls[name] = functools.partial(self._checked, plain)
        self._domains: dict[int, ErrorDomain] = {
            self.call("device_error_quark"): "device",
            self.call("gc_error_quark"): "genicam",
        }
        self._doomed: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._dying = 0
        self._released = threading.Condition()
        threading.Thread(target=self._bury, name="aravis release", daemon=True).start()

    def call(self, name: str, *arguments: Any) -> Any:
        return self._calls[name](*arguments)

    def release(self, handle: int) -> None:
        """Give up one reference; waits for the device where it was the last."""
        self._gobject.g_object_unref(handle)

    def release_later(self, handle: int) -> None:
        """Give up the handle of a device that is gone: the library would wait seconds for its answers."""
        with self._released:
            self._dying += 1
        self._doomed.put(handle)

    def await_releases(self, timeout_s: float) -> bool:
        """Wait until nothing of ``release_later`` is left; whether there was anything, and it went in time."""
        with self._released:
            return self._dying > 0 and self._released.wait_for(lambda: self._dying == 0, timeout_s)

    def on_control_lost(self, device: int, callback: Any) -> int:
        """Call a ControlLost from one of the library's threads; the caller keeps it alive. Returns what ends it."""
        return int(self._gobject.g_signal_connect_data(device, b"control-lost", callback, None, None, 0))

    def disconnect(self, device: int, handler: int) -> None:
        self._gobject.g_signal_handler_disconnect(device, handler)

    def set_number(self, handle: int, name: str, number: float) -> None:
        """Set a property, of type double, of an object of the library."""
        value = _GValue()
        self._gobject.g_value_init(ctypes.byref(value), _DOUBLE_TYPE)
        self._gobject.g_value_set_double(ctypes.byref(value), number)
        self._gobject.g_object_set_property(handle, name.encode(), ctypes.byref(value))

    def _checked(self, function: Any, *arguments: Any) -> Any:
        error = _GErrorPointer()
        result = function(*arguments, ctypes.byref(error))
        if not error:
            return result
        domain = self._domains.get(error.contents.domain, "other")
        code = error.contents.code
        text = " ".join((error.contents.message or b"").decode(errors="replace").split())
        self._glib.g_error_free(error)
        raise AravisError(domain, code, text)

    def _bury(self) -> None:
        while True:
            self.release(self._doomed.get())
            with self._released:
                self._dying -= 1
                self._released.notify_all()


def load_library(device: str, path: str | None = None) -> Library:
    """The library at ``path``, else at ARAVIS_LIBRARY, else the system's; once a process.

    Raises DeviceUnavailableError, naming the package that lacks, for ``device``.
    """
    wanted = path or os.environ.get(PATH_VARIABLE) or _DEFAULT
    try:
        return _load(wanted)
    except (OSError, AttributeError) as error:
        raise DeviceUnavailableError(
            device,
            f"the library {wanted} cannot be loaded ({error}); apt-get install libaravis-0.8-0, "
            f"or name another one in {PATH_VARIABLE}",
        ) from error


@functools.cache
def _load(path: str) -> Library:
    return Library(path)


def _prototype(library: ctypes.CDLL, name: str, result: Any, arguments: tuple[Any, ...]) -> Any:
    function = getattr(library, f"arv_{name}")
    function.restype, function.argtypes = result, list(arguments)
    return function
