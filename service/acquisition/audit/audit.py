"""Is every frame the pattern that it should be, well exposed, of a scene that stood still?"""

from __future__ import annotations

from collections.abc import Mapping

from models.capture import Image
from models.errors import CaptureError
from models.geometry.rig import SIDES, Side
from models.patterns import PatternPlan
from service.acquisition.audit.culprits import Diagnosis
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.report import AuditReport
from service.acquisition.audit.view import ViewAudit, audit_view
from service.acquisition.finding import Fault, Finding

SHOWN_AT_MOST = 4
"""Findings of order that are listed one by one."""


def audit(
    images: Mapping[Side, Mapping[str, Image]],
    plan: PatternPlan,
    white_level: int,
    limits: AuditLimits | None = None,
) -> AuditReport:
    """Prove from the images alone that frame k shows pattern k.

    images: per side, per pattern name, uint8 or uint16 (height, width); one view is enough. white_level: full scale.
    A fault seen by both views is the projector's, one seen by one view is that camera's. Raises CaptureError where an
    image of the plan is missing or images of one view differ in size.
    """
    limits = limits or AuditLimits()
    sides = [side for side in SIDES if side in images]
    if not sides or not plan.patterns:
        raise CaptureError("audit: there are no images to look at")
    views = {side: audit_view(f"{side} camera", images[side], plan, white_level, limits) for side in sides}
    findings = [finding for view in views.values() for finding in view.findings]
    findings += _darkness(list(views.values()))
    findings += _order(list(views.values()), plan)
    findings += _motion(list(views.values()), limits)
    return AuditReport(
        tuple(sorted(findings, key=lambda f: not f.fatal)),
        {side: view.statistics for side, view in views.items()},
        {side: view.proven for side, view in views.items()},
    )


def _darkness(views: list[ViewAudit]) -> list[Finding]:
    dark = [view for view in views if view.dark]
    if len(dark) == len(views) > 1:
        message = "projector: its light shows in neither camera; check its lamp, the pattern sequence and the lens caps"
        return [Finding(Fault.DARK, "projector", message)]
    return [
        Finding(
            Fault.DARK,
            view.device,
            f"{view.device}: the projector's light does not show; check lens cap, aperture and exposure",
        )
        for view in dark
    ]


def _order(views: list[ViewAudit], plan: PatternPlan) -> list[Finding]:
    wrong = [view for view in views if view.diagnosis is not None]
    if len(wrong) == len(views) > 1:
        first, second = (view.diagnosis for view in wrong)
        assert first is not None
        assert second is not None
        agreed = _common(first, second)
        if agreed is not None:
            return _findings("projector", agreed, plan)
    return [
        finding
        for view in wrong
        if view.diagnosis is not None
        for finding in _findings(view.device, view.diagnosis, plan)
    ]


def _common(first: Diagnosis, second: Diagnosis) -> Diagnosis | None:
    """What both views say, or None when they tell different stories."""
    if not first.misplaced or not second.misplaced:
        return first if first.misplaced == second.misplaced else None
    known = {m.place: m.shown for m in second.misplaced}
    shared = [m for m in first.misplaced if m.place in known]
    agree = all(m.shown == known[m.place] or m.shown is None or known[m.place] is None for m in shared)
    if not shared or not agree:
        return None
    told = [diagnosis for diagnosis in (first, second) if all(m.shown is not None for m in diagnosis.misplaced)]
    return told[0] if told else first


def _findings(device: str, diagnosis: Diagnosis, plan: PatternPlan) -> list[Finding]:
    advice = (
        "check the order of the patterns in the projector"
        if device == "projector"
        else "check its trigger line and that its buffers were empty at the start"
    )
    if not diagnosis.misplaced:
        return [Finding(Fault.ORDER, device, f"{device}: {diagnosis.remark}; {advice}")]
    findings = []
    for misplaced in diagnosis.misplaced[:SHOWN_AT_MOST]:
        name = plan.names[misplaced.place]
        what = diagnosis.remark or "shows none of the plan's patterns"
        if misplaced.shown is not None:
            what = f"shows {misplaced.shown}"
        more = len(diagnosis.misplaced) - SHOWN_AT_MOST
        also = f" (and {more} more)" if more > 0 and misplaced is diagnosis.misplaced[SHOWN_AT_MOST - 1] else ""
        message = f"{device}: exposure {misplaced.place} ({name}) {what}{also}; {advice}"
        findings.append(Finding(Fault.ORDER, device, message, misplaced.place, name))
    return findings


def _motion(views: list[ViewAudit], limits: AuditLimits) -> list[Finding]:
    seen = {
        view.device: max(m.moved for m in view.motions if m.is_motion(limits))
        for view in views
        if view.diagnosis is None and any(m.is_motion(limits) for m in view.motions)
    }
    if not seen:
        return []
    share = 100 * max(seen.values())
    message = (
        f"scene: moved during the sequence ({share:.0f} % of what the {' and '.join(seen)} sees lit); keep it still"
    )
    return [Finding(Fault.MOTION, "scene", message)]
