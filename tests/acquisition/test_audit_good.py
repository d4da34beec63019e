"""The audit never refuses a good sequence, and says what it proved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from audited_captures import audited, fatal, simulated, small_plate, with_sensor
from simulated_captures import exposed, objects_before_wall, only, plate_before_wall

from drivers.simulator.sensor import Sensor
from models.capture import Capture
from models.foreign import import_capture
from models.patterns import FringeParameters, PlanName, make_plan
from service.acquisition.audit import AuditLimits, audit
from service.acquisition.finding import Fault

MANIFESTS = Path(__file__).resolve().parents[2] / "examples" / "manifests"


@pytest.mark.parametrize("plan", ["complementary", "calibration"])
def test_every_pattern_of_a_plan_is_proven(plan: PlanName) -> None:
    capture = simulated(plan, 31, 2)
    report = audited(capture)
    assert report.ok
    assert report.proven == {side: list(capture.plan.names) for side in capture.sides}


@pytest.mark.parametrize("capture", [objects_before_wall, plate_before_wall], ids=lambda c: c.__name__)
@pytest.mark.parametrize("plan", ["full", "reference", "composite"])
def test_every_pattern_of_a_part_is_proven(capture, plan: PlanName) -> None:
    part = only(capture(), make_plan(plan).kinds)
    report = audited(part)
    assert report.ok
    assert report.proven == {side: list(part.plan.names) for side in part.sides}
    assert not any(statistics["unproven"] for statistics in report.statistics.values())


@pytest.mark.parametrize(
    ("seed", "index", "sensor", "interreflection"),
    [
        (32, 0, Sensor(bit_depth=12, exposure_us=2500.0), False),
        (32, 3, Sensor(exposure_us=2500.0, gain_db=10.0), True),
        (32, 5, Sensor(exposure_us=11_000.0), False),
    ],
    ids=["12 bit, 0.3 times the light", "gain", "1.3 times the light"],
)
def test_exposures(seed: int, index: int, sensor: Sensor, interreflection: bool) -> None:
    capture = with_sensor(seed, index, sensor, interreflection)
    for plan in ("full", "reference", "composite"):
        part = only(capture, make_plan(plan).kinds)  # type: ignore[arg-type]
        report = audited(part)
        assert not fatal(report), plan
        assert all(set(report.proven[side]) == set(part.plan.names) for side in part.sides)


@pytest.mark.parametrize("gain", [0.15, 0.3, 1.2])
def test_brightness_of_the_same_scene(gain: float) -> None:
    report = audited(exposed(objects_before_wall(), gain))
    assert report.ok


def test_one_view_is_enough() -> None:
    capture = objects_before_wall()
    report = audited(capture, {"left": capture.images["left"]})
    assert report.ok
    assert report.proven == {"left": list(capture.plan.names)}


def test_little_may_be_lit() -> None:
    capture = small_plate()
    for plan in ("full", "reference", "composite"):
        assert audited(only(capture, make_plan(plan).kinds)).ok  # type: ignore[arg-type]


def test_planes_that_look_alike_on_a_small_scene_are_not_called_proven() -> None:
    """All of the plate lies in one half of the coarsest plane: that plane is plain white or black there."""
    report = audited(small_plate())
    for side, proven in report.proven.items():
        assert "gray_00" not in proven
        assert "gray_00" in report.statistics[side]["unproven"]
        assert {f"high_{k:02d}" for k in range(9)} <= set(proven)


@pytest.mark.parametrize(("steps", "periods"), [((3, 3), (9.0, 14.0)), ((4, 5), (9.0, 14.0)), ((16, 20), (16.0, 21.0))])
def test_other_steps_and_periods(steps: tuple[int, int], periods: tuple[float, float]) -> None:
    capture = simulated("full", 33, 1, FringeParameters(periods=periods, steps=steps))
    report = audited(capture)
    assert report.ok
    assert report.proven["left"] == list(capture.plan.names)


def test_shift_sign_and_offset_are_those_of_the_plan() -> None:
    """The same images under names that run backwards from another start."""
    capture = objects_before_wall()
    patterns, images = [], {side: dict(by) for side, by in capture.images.items()}
    for pattern in capture.plan.patterns:
        if pattern.kind != "high":
            patterns.append(pattern)
            continue
        assert pattern.step is not None
        mirrored = (2 - pattern.step) % 9
        patterns.append(pattern.model_copy(update={"shift_sign": -1, "phase_offset": 2 * 2 * np.pi / 9}))
        for side in capture.sides:
            images[side][pattern.name] = capture.images[side][f"high_{mirrored:02d}"]
    plan = capture.plan.model_copy(update={"patterns": tuple(patterns)})
    assert audit(images, plan, 255).ok
    assert not audit(images, capture.plan, 255).ok


def test_a_carrier_without_code_is_not_called_proven() -> None:
    report = audited(only(objects_before_wall(), {"high", "low"}))
    assert report.ok
    assert report.proven == {"left": [], "right": []}
    assert set(report.statistics["left"]["unproven"]) >= {"high", "low"}


def test_statistics_are_those_of_the_images() -> None:
    """Within what thinning to rows costs."""
    capture = objects_before_wall()
    statistics = audited(capture).statistics["left"]
    high = np.stack([capture.images["left"][f"high_{k:02d}"] for k in range(9)]).astype(float)
    modulation = np.abs(np.tensordot(np.exp(2j * np.pi * np.arange(9) / 9), high, 1)) * 2 / 9
    lit = modulation > 3
    saturated = np.any([image >= 255 for image in capture.images["left"].values()], axis=0)
    assert statistics["lit_percent"] == pytest.approx(100 * lit.mean(), abs=1.5)
    assert statistics["modulation"]["high"] == pytest.approx(np.median(modulation[lit]), rel=0.05)
    assert statistics["mean_white"] == pytest.approx(capture.images["left"]["white"][lit].mean(), rel=0.03)
    assert statistics["saturated_percent"] == pytest.approx(100 * saturated[lit].mean(), abs=0.5)
    assert statistics["composite_moved_percent"] == 0
    assert statistics["proving_pixels_percent"]["high"] > 99
    assert statistics["consistent_percent"]["u"] > 99


def test_gloss_is_warned_of_not_refused() -> None:
    capture = simulated("full", 4242, 6)
    report = audited(capture)
    assert report.ok
    assert {f.fault for f in report.findings} == {Fault.SATURATED}
    assert len(report.warnings) == 2
    saturated = np.any([image >= 255 for image in capture.images["left"].values()], axis=0)
    lit = capture.images["left"]["white"] > 10
    assert report.statistics["left"]["saturated_percent"] == pytest.approx(100 * saturated[lit].mean(), abs=1.0)


def test_limits_rule() -> None:
    capture = simulated("full", 4242, 6)
    strict = AuditLimits(saturated_fatal=0.01)
    assert [f.fault for f in fatal(audit(capture.images, capture.plan, 255, strict))] == [Fault.SATURATED] * 2


@pytest.fixture(scope="module")
def plaster_head(real_data: Path) -> Capture:
    return import_capture(real_data / "stereo_small_mit", MANIFESTS / "stereo_small_mit.toml")


@pytest.mark.realdata
class TestRecordedSets:
    def test_four_steps_and_code_of_half_a_fringe(self, plaster_head: Capture) -> None:
        """Its unlit frame was taken under the room's lamps: a warning, and the only pattern that is not proven."""
        report = audited(plaster_head)
        assert report.ok
        expected = [name for name in plaster_head.plan.names if name != "black"]
        assert report.proven == {"left": expected, "right": expected}
        assert all("black" in warning and "ambient" in warning for warning in report.warnings)
        assert len(report.warnings) == 2

    def test_white_twice_is_not_ambient_light(self, plaster_head: Capture) -> None:
        rng = np.random.default_rng(5)
        images = {side: dict(by) for side, by in plaster_head.images.items()}
        for by in images.values():
            by["black"] = np.clip(np.rint(by["white"] + rng.normal(0, 1.5, by["white"].shape)), 0, 255).astype(np.uint8)
        found = fatal(audited(plaster_head, images))
        assert [(f.device, f.index) for f in found] == [("projector", 11)]

    @pytest.mark.parametrize("first", [0, 2, 4, 9])
    def test_neighbours_exchanged(self, plaster_head: Capture, first: int) -> None:
        names = plaster_head.plan.names
        left = dict(plaster_head.images["left"])
        left[names[first]], left[names[first + 1]] = left[names[first + 1]], left[names[first]]
        found = fatal(audited(plaster_head, {**plaster_head.images, "left": left}))
        assert {f.device for f in found} == {"left camera"}
        assert found[0].index == first

    @pytest.mark.parametrize("name", ["object", "plane"])
    def test_one_camera_with_other_periods(self, real_data: Path, name: str) -> None:
        capture = import_capture(real_data / "composite_fringe", MANIFESTS / f"composite_fringe_{name}.toml")
        report = audited(capture)
        assert report.ok
        assert not report.warnings
        assert report.proven == {"left": list(capture.plan.names)}
        assert audited(only(capture, {"composite"})).proven == {"left": ["composite"]}

    @pytest.mark.parametrize("kind", ["high", "low"])
    def test_one_carrier_instead_of_the_composite(self, real_data: Path, kind: str) -> None:
        capture = only(
            import_capture(real_data / "composite_fringe", MANIFESTS / "composite_fringe_object.toml"),
            {"composite", "high", "low"},
        )
        alone = replace(capture, plan=capture.plan.restricted_to(["composite"]))
        found = fatal(audited(alone, {"left": {"composite": capture.images["left"][f"{kind}_00"]}}))
        assert [(f.fault, f.device, f.index) for f in found] == [(Fault.ORDER, "left camera", 0)]
