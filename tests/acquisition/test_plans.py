"""Plans against what a projector stores."""

from __future__ import annotations

import pytest

from models.patterns import PLAN_NAMES, FringeParameters, Pattern, make_plan
from service.acquisition.plans import PlanError, resolve_plan, with_exposure


@pytest.mark.parametrize("name", PLAN_NAMES)
def test_a_free_projector_shows_the_named_plans(name: str) -> None:
    assert resolve_plan(name, None).names == make_plan(name).names  # type: ignore[arg-type]


def test_stored_parameters_hold() -> None:
    stored = make_plan("full", FringeParameters(periods=(18.0, 28.0), steps=(4, 5)))
    plan = resolve_plan("reference", stored)
    assert plan.kinds == {"white", "high", "low", "gray", "black"}
    assert {p.period for p in plan.of_kind("high")} == {18.0}
    assert len(plan.of_kind("high")) == 4


@pytest.mark.parametrize(
    ("name", "stored", "lacks"),
    [
        ("composite", "reference", "composite"),
        ("full", "composite", "high"),
        ("complementary", "reference", "gray_inv"),
        ("calibration", "full", "row_high"),
    ],
)
def test_what_is_not_stored_is_told(name: str, stored: str, lacks: str) -> None:
    with pytest.raises(PlanError, match=lacks):
        resolve_plan(name, make_plan(stored))  # type: ignore[arg-type]


def test_own_patterns_may_be_given_in_full() -> None:
    patterns = [
        Pattern(name=f"high_{k:02d}", kind="high", period=12.0, step=k, steps=3, exposure_us=9000) for k in range(3)
    ]
    assert resolve_plan(patterns, None).patterns == tuple(patterns)
    with pytest.raises(PlanError, match="high_02"):
        resolve_plan(patterns[:2], None)


def test_an_exposure_is_every_pattern_s() -> None:
    assert {p.exposure_us for p in with_exposure(make_plan("full"), 20_000).patterns} == {20_000}
