"""Which camera, and how it is wired."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, IPvAnyAddress


class GenicamConfiguration(BaseModel):
    """Which camera, and how it is wired.

    serial, address: either finds it, both must agree; without any, the only camera that answers is taken.
    trigger_line: Line3 for TTL wired directly, Line0 for the opto-isolated input. width, height: px, taken down to the
    camera's steps; offset_x, offset_y: px, None for the middle of the sensor. black_level: per cent; debounce_us: of
    the trigger line; link_limit: bytes/s; None leaves any of them as it is. readout_us: of such an image, where the
    camera does not say. ready_by: whether the camera's own word that it waits for a trigger is believed. settle_s:
    wait after arming where it is not, or not given. first_frame_id: of the first frame after arming, on USB; GigE
    Vision always begins with 1. processing: leave gamma and the like as they are, although they bend the fringes. Of
    Aravis alone: library, the path of libaravis, and usb_mode, None for the library's own.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    serial: str | None = None
    address: IPvAnyAddress | None = None
    library: str | None = None
    trigger_line: Literal["Line0", "Line1", "Line2", "Line3"] = "Line3"
    trigger_activation: Literal["RisingEdge", "FallingEdge"] = "RisingEdge"
    trigger_overlap: Literal["Off", "ReadOut"] = "ReadOut"
    width: int = Field(640, gt=0)
    height: int = Field(480, gt=0)
    offset_x: int | None = Field(None, ge=0)
    offset_y: int | None = Field(None, ge=0)
    reverse_x: bool = False
    black_level: float | None = Field(None, allow_inf_nan=False)
    readout_us: float = Field(3000.0, ge=0, allow_inf_nan=False)
    ready_by: Literal["status", "settle"] = "status"
    settle_s: float = Field(0.05, ge=0, le=10)
    first_frame_id: Literal[0, 1] = 0
    live_rate_hz: float = Field(30.0, gt=0, allow_inf_nan=False)
    debounce_us: int | None = Field(None, ge=0)
    link_limit: int | None = Field(None, gt=0)
    processing: bool = False
    usb_mode: Literal["sync", "async"] | None = None
