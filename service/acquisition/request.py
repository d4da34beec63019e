"""What can be asked of the rig."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from models.patterns import Pattern

LONGEST_PLAN = 256


PlanField = str | tuple[str | Pattern, ...]
PLAN_HELP = (
    "composite, reference, full, complementary, calibration, or patterns in exposure order: by name (high_00) or with "
    "all parameters. Groups must be whole."
)


class CaptureOptions(BaseModel):
    """Everything about one capture but its plan."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    exposure_us: float | None = Field(
        None,
        gt=0,
        le=10_000_000,
        allow_inf_nan=False,
        strict=True,
        description="Exposure of cameras and patterns for this capture alone, microseconds; by default the cameras'.",
    )
    object_id: str | None = Field(
        None, min_length=1, max_length=200, description="Identity of the object; decides a dataset's splits."
    )
    notes: str | None = Field(None, max_length=4000, description="Kept with the capture.")
    scene: str | None = Field(
        None,
        max_length=200,
        description="Which recorded capture (replayed rig) or simulated scene stands before the rig; a real rig "
        "refuses it. By default recorded captures take turns in name order and a simulated scene stays.",
    )


class CaptureRequest(CaptureOptions):
    """One capture."""

    plan: PlanField = Field("composite", max_length=LONGEST_PLAN, description=PLAN_HELP)


class AssistRequest(BaseModel):
    """What the exposure assistant is to reach."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    target: float = Field(
        0.85, gt=0.1, lt=0.98, description="Reading of the brightest lit pixels, share of full scale."
    )
    longest_exposure_us: float = Field(
        66_667.0,
        gt=0,
        le=1_000_000,
        allow_inf_nan=False,
        strict=True,
        description="Above this the gain is raised instead.",
    )
    largest_gain_db: float = Field(12.0, ge=0, le=48, allow_inf_nan=False, strict=True)
    apply: bool = Field(True, description="Keep the settings found; otherwise only report them.")
