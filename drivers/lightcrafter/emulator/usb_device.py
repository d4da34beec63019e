"""The emulated controller as a device of pyusb: everything of pyusb but the C library runs."""

from __future__ import annotations

import array
import errno
import threading
import time
from collections import deque
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

from drivers.errors import ProtocolError
from drivers.lightcrafter.emulator.controller import EmulatedController, RefusedError, SilentError
from drivers.lightcrafter.messages import REPORT_BYTES, Reply, Request, reports_of
from drivers.lightcrafter.usb import PRODUCT, VENDOR

_OUT, _IN = 0x01, 0x81
_REPLY_FLAGS = 0xC0


class EmulatedUsb(usb.backend.IBackend):  # type: ignore[misc]  # pyusb has no types
    """A backend of pyusb with a controller on its bus.

    ports: where it is attached; several places look like several controllers.
    denied: the account may not open it. held: another program has claimed it. kernel_driver: of the system, on
    interface 0. resets: how often anybody reset the device, which nobody should.
    last_sequence: number of the last message.
    """

    def __init__(self, controller: EmulatedController, *, ports: tuple[tuple[int, ...], ...] = ((2,),)) -> None:
        self._controller = controller
        self._ports = ports
        self._ready = threading.Condition()
        self._reports: deque[bytes] = deque()
        self._partial = b""
        self.denied = False
        self.held = False
        self.kernel_driver = True
        self.resets = 0
        self.claimed = False
        self.last_sequence = 0
        self._visit = 0
        controller.on_unplug(self._forget)

    def _forget(self) -> None:
        with self._ready:
            self._reports.clear()
            self._partial = b""
            self.claimed = False
            self.kernel_driver = True
            self._visit += 1
            self._ready.notify_all()

    def leave_report(self, report: bytes) -> None:
        """Have a report wait that an earlier program asked for and did not read."""
        with self._ready:
            self._reports.append(report.ljust(REPORT_BYTES, b"\0"))

    def enumerate_devices(self) -> Iterator[tuple[int, ...]]:
        if self._controller.plugged:
            yield from self._ports

    def get_device_descriptor(self, dev: tuple[int, ...]) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0110,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=VENDOR,
            idProduct=PRODUCT,
            bcdDevice=0x0100,
            iManufacturer=0,
            iProduct=0,
            iSerialNumber=0,
            bNumConfigurations=1,
            address=7,
            bus=1,
            port_number=dev[-1],
            port_numbers=dev,
            speed=2,
        )

    def get_configuration_descriptor(self, dev: tuple[int, ...], config: int) -> SimpleNamespace:
        if config:
            raise IndexError(config)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=73,
            bNumInterfaces=2,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=0,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: tuple[int, ...], intf: int, alt: int, config: int) -> SimpleNamespace:
        if alt or intf > 1:
            raise IndexError(intf)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=intf,
            bAlternateSetting=0,
            bNumEndpoints=2,
            bInterfaceClass=3,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(
        self, dev: tuple[int, ...], ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=(_IN, _OUT)[ep] + intf,
            bmAttributes=3,
            wMaxPacketSize=REPORT_BYTES,
            bInterval=1,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, dev: tuple[int, ...]) -> SimpleNamespace:
        if not self._controller.plugged:
            raise _gone()
        if self.denied:
            raise usb.core.USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        return SimpleNamespace(dev=dev, visit=self._visit)

    def close_device(self, dev_handle: SimpleNamespace) -> None:
        self.claimed = self.claimed and dev_handle.visit != self._visit

    def get_configuration(self, dev_handle: SimpleNamespace) -> int:
        self._be_there(dev_handle)
        return 1

    def is_kernel_driver_active(self, dev_handle: SimpleNamespace, intf: int) -> bool:
        self._be_there(dev_handle)
        return self.kernel_driver

    def detach_kernel_driver(self, dev_handle: SimpleNamespace, intf: int) -> None:
        self._be_there(dev_handle)
        self.kernel_driver = False

    def attach_kernel_driver(self, dev_handle: SimpleNamespace, intf: int) -> None:
        self._be_there(dev_handle)
        self.kernel_driver = True

    def claim_interface(self, dev_handle: SimpleNamespace, intf: int) -> None:
        self._be_there(dev_handle)
        if self.held or self.kernel_driver or self.claimed:
            raise usb.core.USBError("Resource busy", -6, errno.EBUSY)
        self.claimed = True

    def release_interface(self, dev_handle: SimpleNamespace, intf: int) -> None:
        self._be_there(dev_handle)
        self.claimed = False

    def reset_device(self, dev_handle: SimpleNamespace) -> None:
        self.resets += 1

    def intr_write(self, dev_handle: SimpleNamespace, ep: int, intf: int, data: array.array[int], timeout: int) -> int:
        self._be_there(dev_handle)
        if ep != _OUT or len(data) != REPORT_BYTES:
            raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
        self._partial += bytes(data)
        if len(self._partial) == REPORT_BYTES * reports_of(self._partial):
            message, self._partial = self._partial, b""
            self._answer(Request.decode(message))
        return len(data)

    def _answer(self, request: Request) -> None:
        self.last_sequence = request.sequence
        try:
            if request.read:
                data = self._controller.handle(request.code, None, request.payload)
            else:
                data = self._controller.handle(request.code, request.payload)
            reply = Reply(request.sequence, data)
        except (RefusedError, ProtocolError):
            reply = Reply(request.sequence, refused=True)
        except SilentError:
            return
        if not request.acknowledged:
            return
        stale = Reply(request.sequence ^ 0x55, b"stale" * 20).encode(_REPLY_FLAGS)
        with self._ready:
            for message in (*[stale] * self._controller.faults.stale_replies, reply.encode(_REPLY_FLAGS)):
                self._reports.extend(message[at : at + REPORT_BYTES] for at in range(0, len(message), REPORT_BYTES))
            self._ready.notify_all()

    def intr_read(self, dev_handle: SimpleNamespace, ep: int, intf: int, buff: array.array[Any], timeout: int) -> int:
        deadline = time.monotonic() + 1e-3 * timeout
        with self._ready:
            while not self._reports:
                self._be_there(dev_handle)
                left = deadline - time.monotonic()
                if left <= 0:
                    raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
                self._ready.wait(left)
            report = self._reports.popleft()
        size = min(len(report), len(buff))
        buff[:size] = array.array("B", report[:size])
        return size

    def _be_there(self, handle: SimpleNamespace) -> None:
        """A handle lives until the device leaves the bus, even if it comes back."""
        if not self._controller.plugged or handle.visit != self._visit:
            raise _gone()


def _gone() -> usb.core.USBError:
    return usb.core.USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
