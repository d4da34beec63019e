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
_KEPT = 8


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


class _Packets:
    """A frame cut into packets: 0 is the leader, the last one the trailer."""

    def __init__(self, parcel: Parcel) -> None:
        self.parcel = parcel
        self._pixels = memoryview(parcel.make_pixels())
        self._step = parcel.packet_size - PACKET_OVERHEAD
        self.last = -(-len(self._pixels) // self._step) + 1
        self._missing = self.last // 2 if parcel.corrupt else None

    def parts(self, number: int) -> list[bytes | memoryview]:
        """Nothing where there is no such packet, or a fault keeps it back."""
        parcel = self.parcel
        if number == self._missing or not 0 <= number <= self.last:
            return []
        if number == 0:
            return [leader(parcel.block, parcel.ticks, parcel.pixel_format, parcel.roi)]
        if number == self.last:
            return [trailer(parcel.block, number, parcel.roi[1])]
        start = (number - 1) * self._step
        return [payload_header(parcel.block, number), self._pixels[start : start + self._step]]


class FrameSender:
    """``put`` and ``clear`` may come from any thread."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, 0))
        self._changed = threading.Condition()
        self._parcels: deque[Parcel] = deque()
        self._kept: deque[_Packets] = deque(maxlen=_KEPT)
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
            self._kept.clear()
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

    def resend(self, block: int, first: int, last: int) -> None:
        """Packets that the receiver misses, as long as their frame is among the last few."""
        with self._changed:
            kept = next((packets for packets in reversed(self._kept) if packets.parcel.block == block), None)
        if kept is not None:
            self._send(kept, first, min(last, kept.last))

    def _run(self) -> None:
        while (parcel := self._next()) is not None:
            packets = _Packets(parcel)
            with self._changed:
                self._kept.append(packets)
            self._send(packets, 0, packets.last)

    def _next(self) -> Parcel | None:
        with self._changed:
            while not self._ended:
                wait_s = self._parcels[0].due_s - time.monotonic() if self._parcels else None
                if wait_s is not None and wait_s <= 0:
                    return self._parcels.popleft()
                self._changed.wait(wait_s)
        return None

    def _send(self, packets: _Packets, first: int, last: int) -> None:
        for number in range(first, last + 1):
            parts = packets.parts(number)
            if parts:
                with contextlib.suppress(OSError):
                    self._socket.sendmsg(parts, [], 0, packets.parcel.receiver)
            if (number - first) % _BURST == _BURST - 1:
                time.sleep(_PAUSE_S)
