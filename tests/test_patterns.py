"""Patterns: what each mirror shows, and that it decodes to the coordinate it was made from."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from models.errors import DuofringeError
from models.patterns import (
    LIGHTCRAFTER_4500,
    PLAN_NAMES,
    FringeParameters,
    Pattern,
    PatternIndexError,
    PatternPlan,
    Raster,
    make_pattern,
    make_plan,
)

SQUARE = Raster(912, 1140, "square")
RASTERS = pytest.mark.parametrize("raster", [SQUARE, LIGHTCRAFTER_4500], ids=["square", "diamond"])
COLUMNS = st.floats(-50, 1000, allow_nan=False)


def decode_gray(planes: np.ndarray) -> np.ndarray:
    """Binary orders from boolean Gray planes (bits, ...), most significant first: the prefix parity of the bits."""
    binary = np.cumsum(planes.astype(int), axis=0) % 2
    weights = 1 << np.arange(len(planes))[::-1]
    return np.tensordot(weights, binary, 1)


def test_diamond_raster_shifts_odd_rows_by_half_a_column():
    u, v = Raster(4, 3, "diamond").lattice()
    np.testing.assert_array_equal(u, [[0, 1, 2, 3], [0.5, 1.5, 2.5, 3.5], [0, 1, 2, 3]])
    np.testing.assert_array_equal(v, [[0] * 4, [1] * 4, [2] * 4])
    np.testing.assert_array_equal(Raster(4, 3).lattice()[0], [[0, 1, 2, 3]] * 3)


@RASTERS
def test_gray_planes_decode_to_the_fringe_order_of_every_mirror(raster):
    planes = [p.render(raster) for p in make_plan("reference").of_kind("gray")]
    assert len(planes) == 7
    order = decode_gray(np.stack(planes) > 127)
    np.testing.assert_array_equal(order, np.floor(raster.lattice()[0] / 9))
    assert order.max() == 101


def test_row_gray_planes_decode_to_the_row_order():
    planes = [p.render(LIGHTCRAFTER_4500) for p in make_plan("calibration").of_kind("row_gray")]
    order = decode_gray(np.stack(planes) > 127)
    np.testing.assert_array_equal(order, np.floor(LIGHTCRAFTER_4500.lattice()[1] / 18))


@given(period=st.floats(2, 60), columns=st.integers(8, 400), kind=st.sampled_from(["square", "diamond"]))
def test_gray_bits_suffice_for_any_period_and_raster(period, columns, kind):
    raster = Raster(columns, 2, kind)
    planes = make_plan("complementary", FringeParameters(periods=(period, 1.5 * period), raster=raster))
    shown = np.stack([p.render(raster) for p in planes.of_kind("gray")])
    np.testing.assert_array_equal(decode_gray(shown > 127), np.floor(raster.lattice()[0] / period))
    inverse = np.stack([p.render(raster) for p in planes.of_kind("gray_inv")])
    np.testing.assert_array_equal(inverse, 255 - shown)


@given(columns=st.lists(st.floats(0, 911), min_size=2, max_size=30).map(sorted))
def test_neighbouring_gray_orders_differ_in_one_bit(columns):
    orders = np.unique(np.floor(np.array(columns) / 9)) * 9.0
    pairs = np.stack([orders, orders + 9])
    bits = np.stack([p.evaluate(pairs) for p in make_plan("reference").of_kind("gray")]) > 127
    np.testing.assert_array_equal((bits[:, 0] != bits[:, 1]).sum(axis=0), 1)


@RASTERS
def test_composite_is_the_papers_equation_and_stays_within_grey_levels(raster):
    u, _ = raster.lattice()
    exact = 127.5 + 63.75 * (np.cos(2 * np.pi * u / 9) + np.cos(2 * np.pi * u / 14))
    composite = make_pattern("composite")
    assert 0 <= exact.min() < 4
    assert exact.max() <= 255
    np.testing.assert_allclose(composite.evaluate(*raster.lattice()), exact, atol=1e-9)
    image = composite.render(raster)
    assert image.dtype == np.uint8
    assert image.shape == (1140, 912)
    assert np.abs(image - exact).max() <= 0.5 + 1e-9
    assert image.max() == 255


@given(u=st.lists(COLUMNS, min_size=1, max_size=20), kind=st.sampled_from(["high", "low"]))
def test_fringe_steps_decode_to_the_phase_of_the_column(u, kind):
    patterns = make_plan("reference").of_kind(kind)
    period = patterns[0].periods[0]
    z = sum(p.evaluate(np.array(u)) * np.exp(2j * np.pi * p.step / p.steps) for p in patterns) * 2 / len(patterns)
    error = np.angle(z * np.exp(-2j * np.pi * np.array(u) / period))
    np.testing.assert_allclose(error, 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(z), 127.5, rtol=1e-9)


def test_shift_sign_and_phase_offset_turn_the_fringe():
    u = np.linspace(0, 50, 101)
    pattern = Pattern(name="a", kind="high", period=16, step=1, steps=4, shift_sign=-1, phase_offset=0.3)
    np.testing.assert_allclose(
        pattern.evaluate(u), 127.5 + 127.5 * np.cos(2 * np.pi * u / 16 - 0.3 + np.pi / 2), atol=1e-9
    )


def test_row_patterns_vary_along_v_only():
    pattern = make_pattern("row_high_02")
    u, v = np.meshgrid(np.arange(5.0), np.arange(40.0))
    values = pattern.evaluate(u, v)
    assert np.ptp(values, axis=1).max() == 0
    assert np.ptp(values, axis=0).min() > 200
    assert pattern.evaluate(np.arange(5.0), 3.0).shape == (5,)


@RASTERS
@pytest.mark.parametrize("name", ["white", "black", "composite", "high_08", "low_13", "gray_06", "row_low_00"])
def test_every_kind_renders_to_the_raster(raster, name):
    image = make_pattern(name).render(raster)
    assert (image.dtype, image.shape) == (np.uint8, (1140, 912))
    if name in ("white", "black"):
        assert set(np.unique(image)) == {255 if name == "white" else 0}


def test_named_plans_have_the_exposures_of_the_method():
    sizes = {name: len(make_plan(name)) for name in PLAN_NAMES}
    assert sizes == {"composite": 1, "reference": 32, "full": 33, "complementary": 39, "calibration": 61}
    full = make_plan("full").names
    assert full[:3] == ("white", "composite", "high_00")
    assert full[-2:] == ("gray_06", "black")


@pytest.mark.parametrize("plan", PLAN_NAMES)
def test_plans_survive_json(plan):
    made = make_plan(plan)
    assert PatternPlan.model_validate(json.loads(made.model_dump_json())) == made
    for pattern in made.patterns:
        assert make_pattern(pattern.name) == pattern


def test_restriction_keeps_the_order_of_the_plan():
    plan = make_plan("full").restricted_to(["black", "composite", "white"])
    assert plan.names == ("white", "composite", "black")


@pytest.mark.parametrize("name", ["", "high", "white_00", "high_0", "high_000", "../a", "gray_1", "High_00", "sum"])
def test_unknown_names_are_refused(name):
    with pytest.raises(DuofringeError, match="is unknown"):
        make_pattern(name)


@pytest.mark.parametrize("name", ["high_09", "low_14", "gray_07", "gray_inv_07", "row_gray_07"])
def test_names_beyond_their_group_are_told_apart(name):
    with pytest.raises(PatternIndexError, match=r"capture\.json"):
        make_pattern(name)


@pytest.mark.parametrize(
    "parameters",
    [
        {"kind": "composite", "period": 9},
        {"kind": "high", "period": [9, 14], "step": 0, "steps": 3},
        {"kind": "high", "period": 9, "step": 3, "steps": 3},
        {"kind": "high", "period": 9, "step": 0, "steps": 2},
        {"kind": "high", "period": 9, "step": 0, "steps": 10**9},
        {"kind": "high", "period": 0, "step": 0, "steps": 3},
        {"kind": "high", "period": float("nan"), "step": 0, "steps": 3},
        {"kind": "high", "period": 9, "step": 0, "steps": 3, "phase_offset": float("inf")},
        {"kind": "high", "period": 9, "step": 0, "steps": 3, "phase_offset": [0, 1]},
        {"kind": "gray", "period": 9, "bit": 7, "bits": 7},
        {"kind": "gray", "period": 9, "bit": 0, "bits": 17},
        {"kind": "white", "exposure_us": -1},
        {"kind": "white", "exposure_us": float("inf")},
    ],
)
def test_impossible_parameters_are_refused(parameters):
    with pytest.raises(ValidationError):
        Pattern.model_validate({"name": "p", **parameters})


@pytest.mark.parametrize("name", ["../x", "a/b", "A", "a.png", "", "a" * 65])
def test_names_cannot_leave_the_folder(name):
    with pytest.raises(ValidationError):
        Pattern(name=name, kind="white")


def _fringe(name: str, **changed: float) -> Pattern:
    return Pattern.model_validate({"name": name, "kind": "high", "period": 9, "step": 0, "steps": 3, **changed})


@pytest.mark.parametrize(
    "patterns",
    [
        (_fringe("a"), _fringe("a", step=1)),
        (_fringe("a"), _fringe("b")),
        (_fringe("a"), _fringe("b", step=1, steps=4)),
        (_fringe("a"), _fringe("b", step=1, period=10)),
    ],
    ids=["name twice", "step twice", "steps differ", "periods differ"],
)
def test_contradicting_plans_are_refused(patterns):
    with pytest.raises(ValidationError):
        PatternPlan(patterns=patterns)
