"""Settings of a LightCrafter 4500. What nobody has measured yet has the value that does no harm."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.lightcrafter.serial import ADDRESS, READY

LedLimits = tuple[int, int, int]
TRIGGER_OUT_DELAYS_US = (-20.05, 2.787)
"""Range of the edges of the first trigger output, before and after the light."""


class LightCrafterConfiguration(BaseModel):
    """How to reach the projector and how to drive it.

    manifest: what its flash holds; None where the caller hands a FlashManifest over. connection: "usb", or the bridge
    to I2C at ``port``. usb_path: bus and ports of one of several projectors, "1-2.4". i2c_address: 7 bits.
    i2c_ready_mask: bits of the byte before each answer of which one says that it is ready. timeout_s: for each answer.

    led_limits: largest drive of the red, green and blue LED, 1..255, at brightness 1. led_inverted: 255 is dark, as on
    the EVM's own LED board. led_polarity: register 1A 05, written before any current.
    leds: which LEDs light each pattern.

    dark_us: between two patterns; the controller wants none at all or more than 230 us. longest_us: longest exposure.
    swap_two_images: send an image LUT of two entries in exchanged order, as the controller reads it.
    image_load_us: longest load of an image from flash, where it cannot be measured; None asks the controller.
    trigger_out_polarity: first byte of register 1A 1D. 0 is high while a pattern is lit; of 1 and 2 one is low, and
    sources disagree which. trigger_out_delays_us: of the rising and of the falling edge, -20.05..2.787. With None for
    both the register is left alone.
    flip_long, flip_short: mirror the picture along its columns or its rows; either alone also exchanges which rows of
    the diamond are shifted. None leaves the registers alone.
    hold: what ``show`` does. "sequence" repeats the pattern in pattern mode: the light is that of a sequence, but the
    trigger output goes high when the holding begins. "video" shows a still image, each 8-bit pattern by the one LED of
    its colour: no pulse, other light, and no Gray plane.

    pacing_s: pause between two reads of a status. settle_s: how long a mode, a stop or a start may take.
    validate_s: how long validation may take; validate_first_s: before its first look. wake_s: from standby.

    allow_flash: whether the projector's flash may be overwritten from here.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    manifest: Path | None = None
    connection: Literal["usb", "usb-iss", "bus-pirate"] = "usb"
    usb_path: str | None = Field(None, max_length=64)
    port: str | None = Field(None, max_length=256)
    i2c_address: int = Field(ADDRESS, ge=0x08, le=0x77)
    i2c_ready_mask: int = Field(READY, ge=1, le=255)
    pull_ups: bool = False
    timeout_s: float = Field(2.0, gt=0, le=60)

    led_limits: LedLimits = (151, 120, 125)
    led_inverted: bool = True
    led_polarity: Literal[0, 1] = 0
    leds: Literal["white", "red", "green", "blue"] = "white"

    dark_us: int = Field(240, gt=230, le=1_000_000)
    longest_us: int = Field(2_000_000, ge=8333, le=200_000_000)
    swap_two_images: bool = True
    image_load_us: float | None = Field(None, ge=0, le=5_000_000, allow_inf_nan=False)
    trigger_out_polarity: Literal[0, 1, 2] | None = None
    trigger_out_delays_us: tuple[float, float] | None = None
    flip_long: bool | None = None
    flip_short: bool | None = None
    hold: Literal["sequence", "video"] = "sequence"

    pacing_s: float = Field(0.02, ge=0, le=1)
    settle_s: float = Field(1.0, gt=0, le=30)
    validate_first_s: float = Field(0.1, ge=0, le=5)
    validate_s: float = Field(5.0, gt=0, le=60)
    wake_s: float = Field(2.0, ge=0, le=60)

    allow_flash: bool = False

    @model_validator(mode="after")
    def _it_is_possible(self) -> LightCrafterConfiguration:
        if any(not 1 <= limit <= 255 for limit in self.led_limits):
            raise ValueError(f"led_limits are 1..255 each, got {self.led_limits}")
        low, high = TRIGGER_OUT_DELAYS_US
        if any(not low <= delay <= high for delay in self.trigger_out_delays_us or ()):
            raise ValueError(f"trigger_out_delays_us are {low}..{high} each, got {self.trigger_out_delays_us}")
        if self.connection != "usb" and self.port is None:
            raise ValueError(f"connection '{self.connection}' needs the serial port of the bridge")
        return self
