"""The camera behind its registers: acquisition, trigger line, images."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

from drivers.gigevision.faults import TriggerFaults
from drivers.gigevision.pictures import ImageMaker, as_pixels, numbered_ramp
from drivers.gigevision.protocol import PIXEL_FORMATS, TEST_PACKET_FLAG, Bootstrap, probe_packet
from drivers.gigevision.registers import Registers
from drivers.gigevision.sensor import Exposure, Sensor
from drivers.gigevision.stream import FrameSender, Parcel

_DEFAULT_RATE_HZ = 60.0


class CameraBody:
    """Everything but the control socket. ``lock`` guards registers and sensor."""

    def __init__(
        self,
        identity: Mapping[Bootstrap, bytes],
        sender: FrameSender,
        image: ImageMaker | None,
        clock_offset_ns: int,
        on_start: Callable[[], None] | None,
    ) -> None:
        self.lock = threading.RLock()
        self.faults = TriggerFaults()
        self.dead = False
        self._sender = sender
        self._image = image
        self._clock_offset_ns = clock_offset_ns
        self._on_start = on_start
        self._sensor = Sensor()
        self._acquiring = False
        self._stopped = threading.Event()
        self._free_run: threading.Thread | None = None
        made: dict[str, Callable[[], float]] = {
            "AcquisitionStatus": self._status,
            "PayloadSize": lambda: float(self._payload_bytes()),
        }
        self.registers = Registers(identity, made, self._on_write)

    def pulse(self, line: str, edge: str, at_s: float | None, image: ImageMaker | None) -> bool:
        """One edge on a line; whether it started an exposure."""
        at_s = time.monotonic() if at_s is None else at_s
        with self.lock:
            return self._trigger(line, edge, at_s, image)

    def hears(self, line: str) -> bool:
        """Whether an edge on a line could start an exposure now."""
        registers = self.registers
        with self.lock:
            return (
                self._acquiring
                and not self.dead
                and registers.entry("TriggerSelector") == "FrameStart"
                and registers.entry("TriggerMode") == "On"
                and registers.entry("TriggerSource") == line
            )

    def stop(self) -> None:
        """Stop acquisition and forget what is on its way."""
        with self.lock:
            self._acquiring = False
            self._stopped.set()
            self._sender.clear()

    def close(self) -> None:
        """Stop, and wait until nothing more is exposed."""
        self.stop()
        if self._free_run is not None:
            self._free_run.join()

    def die(self) -> None:
        """Fall silent, as with the cable pulled."""
        self.dead = True
        self.stop()

    def revive(self) -> None:
        """Be there again, in the state after switching on."""
        self.stop()
        with self.lock:
            self.registers.reset()
            self.dead = False

    def _on_write(self, name: str) -> None:
        if name == "AcquisitionStart":
            self._start()
        elif name == "AcquisitionStop":
            self.stop()
        elif name == "TriggerSoftware":
            self._trigger("Software", None, time.monotonic(), None)
        elif name == "PACKET_SIZE" and self.registers.bootstrap(Bootstrap.PACKET_SIZE) & TEST_PACKET_FLAG:
            size = self.registers.bootstrap(Bootstrap.PACKET_SIZE) & 0xFFFF
            self.registers.set_bootstrap(Bootstrap.PACKET_SIZE, size)
            self._sender.send_raw(probe_packet(size), self._receiver())

    def _start(self) -> None:
        if self._acquiring:
            return
        self._sensor.start()
        self._acquiring = True
        self._stopped = threading.Event()
        if self.registers.entry("TriggerMode") == "Off":
            self._free_run = threading.Thread(target=self._run_freely, args=(self._stopped,), daemon=True)
            self._free_run.start()
        if self._on_start is not None:
            self._on_start()

    def _run_freely(self, stopped: threading.Event) -> None:
        values = self.registers.values
        limited = values["AcquisitionFrameRateEnabled"] and not values["AcquisitionFrameRateAuto"]
        period_s = 1 / (values["AcquisitionFrameRate"] if limited else _DEFAULT_RATE_HZ)
        while not stopped.is_set():
            with self.lock:
                if stopped.is_set():
                    return
                self._sensor.pulses += 1
                self._expose(time.monotonic(), overlap=True)
            stopped.wait(period_s)

    def _trigger(self, source: str, edge: str | None, now_s: float, image: ImageMaker | None) -> bool:
        registers = self.registers
        if not self.hears(source) or edge not in (None, registers.entry("TriggerActivation")):
            return False
        index = self._sensor.pulses
        self._sensor.pulses += 1
        if index == self.faults.dead_at:
            self.die()
            return False
        if index in self.faults.ignored:
            return False
        if registers.values["TriggerDelayEnabled"]:
            now_s += 1e-6 * registers.values["TriggerDelay"]
        return self._expose(now_s, overlap=self._overlaps(), image=image)

    def _expose(self, now_s: float, *, overlap: bool, image: ImageMaker | None = None) -> bool:
        values = self.registers.values
        rows = int(values["Height"])
        exposure = self._sensor.expose(now_s, values["ExposureTime"], values["Gain"], rows, overlap=overlap)
        if exposure is None:
            return False
        image = image or self._image
        self._ship(exposure, image)
        if exposure.index in self.faults.doubled:
            self._ship(self._sensor.bounce(exposure, rows), image)
        return True

    def _ship(self, exposure: Exposure, maker: ImageMaker | None) -> None:
        if exposure.index in self.faults.dropped:
            return
        roi = self._roi()
        pixel_format = int(self.registers.values["PixelFormat"])

        def make_pixels() -> bytes:
            asked = (exposure.index, exposure.exposure_us, exposure.gain_db)
            image = numbered_ramp(*asked, roi[:2]) if maker is None else maker(*asked)
            return as_pixels(image, roi, pixel_format)

        parcel = Parcel(
            due_s=exposure.read_s + self.faults.delayed.get(exposure.index, 0.0),
            block=exposure.block,
            ticks=round(exposure.start_s * 1e9) + self._clock_offset_ns,
            pixel_format=pixel_format,
            roi=roi,
            make_pixels=make_pixels,
            receiver=self._receiver(),
            packet_size=self.registers.bootstrap(Bootstrap.PACKET_SIZE) & 0xFFFF,
            corrupt=exposure.index in self.faults.corrupt,
        )
        if parcel.receiver[1]:
            self._sender.put(parcel)

    def _receiver(self) -> tuple[str, int]:
        address = self.registers.bootstrap(Bootstrap.STREAM_ADDRESS).to_bytes(4, "big")
        return ".".join(map(str, address)), self.registers.bootstrap(Bootstrap.STREAM_PORT) & 0xFFFF

    def _roi(self) -> tuple[int, int, int, int]:
        width, height, x, y = (int(self.registers.values[n]) for n in ("Width", "Height", "OffsetX", "OffsetY"))
        return width, height, x, y

    def _payload_bytes(self) -> int:
        width, height = self._roi()[:2]
        return width * height * (1 if self.registers.values["PixelFormat"] == PIXEL_FORMATS["Mono8"] else 2)

    def _overlaps(self) -> bool:
        return self.registers.entry("TriggerOverlap") == "ReadOut"

    def _status(self) -> float:
        waiting = (
            self.registers.entry("AcquisitionStatusSelector") == "FrameTriggerWait"
            and self._acquiring
            and self.registers.entry("TriggerMode") == "On"
            and self._sensor.takes(time.monotonic(), overlap=self._overlaps())
        )
        return float(waiting)
