"""What the count of trigger pulses says of the wires."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.errors import DriverError
from models.geometry.rig import Side
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.wiring import LineCount, WiringCount, count_pulses
from service.diagnosis.symptom import Symptom

SUBJECT = "trigger wiring"


def examine_wiring(orchestrator: Orchestrator) -> Iterator[Symptom]:
    """Count pulses over a short sequence, under the settings that captures use, and judge the count."""
    try:
        counted = count_pulses(orchestrator.devices, orchestrator.settings)
    except DriverError as error:
        yield Symptom(SUBJECT, "fault", str(error), "mend what is named and run this again")
    else:
        yield from judge(counted)


def judge(counted: WiringCount) -> Iterator[Symptom]:
    """One symptom for each camera, or one for what they have in common."""
    if counted.failure:
        yield Symptom(SUBJECT, "fault", counted.failure, "mend what is named and run this again")
    elif counted.silent:
        text = f"no camera saw any of {counted.sent} pulses"
        remedy = (
            "projector J14 pin 2 (TRIG_OUT_1) and 3 (ground) to both cameras, its level jumper at 3.3 V; "
            "rig.cameras.*.trigger_line must name the lines that are wired (Line3 for TTL, Line0 opto-isolated)"
        )
        yield Symptom(SUBJECT, "fault", text, remedy)
    else:
        for side, line in counted.lines.items():
            yield _line(side, line, counted.sent)


def _line(side: Side, line: LineCount, sent: int) -> Symptom:
    subject = f"{SUBJECT} of {line.device}"
    text = f"{line.seen} of {sent} pulses"
    key = f"rig.cameras.{side}"
    if line.failure:
        return Symptom(subject, "fault", f"{text}; {line.failure}", "check its cable and power, then run this again")
    if line.stray:
        text += f", and {line.stray} while nothing was shown"
        remedy = f"connect the grounds of camera and projector; {key}.trigger_line may name an open input"
    elif line.seen == 0:
        text = f"none of {sent} pulses"
        remedy = (
            f"check its trigger cable and {key}.trigger_line; the opto-isolated Line0 takes more current than the "
            "projector's bare output gives"
        )
    elif line.seen > sent:
        remedy = f"edges bounce: connect the grounds, shorten or shield the cable, set {key}.debounce_us = 10"
    elif line.seen < sent:
        remedy = (
            f"a weak level: jumper at 3.3 V, a buffer before opto-isolated inputs; or a busy camera: raise "
            f"{key}.readout_us, lower {key}.debounce_us"
        )
    elif line.lost:
        lost = f"{text}, but {line.lost} frame(s) did not arrive whole"
        return Symptom(subject, "warning", lost, "the wire is well; look at link speed, cable and usbfs memory")
    else:
        return Symptom(subject, "ok", text)
    return Symptom(subject, "fault", text, remedy)
