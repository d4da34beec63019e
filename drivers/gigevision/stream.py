"""Frames on their way to the receiver, one thread that sends them in order."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.gigevision.protocol import PACKET_OVERHEAD, leader, payload_header, trailer

_BURST, _PAUSE_S = 8, 0.0003
"""An ordinary user's receive buffer holds 208 kB, less than a frame: the sender must leave gaps."""


@dataclass(frozen=True, eq=False)
class Parcel:
    """One frame to be sent at ``due_s``. make_pixels: called then. roi: width, height, x, y px."""

    due_s: float
    block: int
    ticks: int
    pixel_format: int
    roi: tuple[int, int, int, int]
    make_pixels: Callable[[], bytes]
    receiver: tuple[str, int]
    packet_size: int
    corrupt: bool = False


class FrameSender:
    """``put`` and ``clear`` may come from any thread."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, 0))
        self._changed = threading.Condition()
        self._parcels: deque[Parcel] = deque()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name=f"frames of {address}", daemon=True)
        self._thread.start()

    def put(self, parcel: Parcel) -> None:
        with self._changed:
            self._parcels.append(parcel)
            self._changed.notify()

    def clear(self) -> None:
        """Forget what is not sent yet."""
        with self._changed:
            self._parcels.clear()
            self._changed.notify()

    def close(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        self._socket.close()

    def send_raw(self, packet: bytes, receiver: tuple[str, int]) -> None:
        """One packet at once; lost silently where nobody receives, as UDP is."""
        with contextlib.suppress(OSError):
            self._socket.sendto(packet, receiver)

    def _run(self) -> None:
        while (parcel := self._next()) is not None:
            self._send(parcel)

    def _next(self) -> Parcel | None:
        with self._changed:
            while not self._ended:
                wait_s = self._parcels[0].due_s - time.monotonic() if self._parcels else None
                if wait_s is not None and wait_s <= 0:
                    return self._parcels.popleft()
                self._changed.wait(wait_s)
        return None

    def _send(self, parcel: Parcel) -> None:
        pixels = memoryview(parcel.make_pixels())
        step = parcel.packet_size - PACKET_OVERHEAD
        self.send_raw(leader(parcel.block, parcel.ticks, parcel.pixel_format, parcel.roi), parcel.receiver)
        count = -(-len(pixels) // step)
        for i in range(count):
            if parcel.corrupt and i == count // 2:
                continue
            with contextlib.suppress(OSError):
                part = pixels[i * step : (i + 1) * step]
                self._socket.sendmsg([payload_header(parcel.block, i + 1), part], [], 0, parcel.receiver)
            if i % _BURST == _BURST - 1:
                time.sleep(_PAUSE_S)
        self.send_raw(trailer(parcel.block, count + 1, parcel.roi[1]), parcel.receiver)
