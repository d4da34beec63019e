"""Bit planes, what the flash holds, and plans as LUT entries."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightcrafter_benches import MANIFEST, PARAMETERS, PLAN, SMALL
from pydantic import ValidationError

from drivers.errors import DeviceConfigurationError, SequenceInvalidError
from drivers.lightcrafter import planes
from drivers.lightcrafter.manifest import FlashManifest, StoredPattern
from drivers.lightcrafter.sequence import Program, compile_plan, hold_program
from drivers.lightcrafter.values import LedSelect, Timing
from drivers.projector import LoadedSequence, ProjectorInfo, ProjectorLimits
from models.patterns import FringeParameters, Pattern, PatternPlan, make_pattern, make_plan

INFO = ProjectorInfo(
    "lightcrafter",
    "",
    "",
    "",
    "real",
    MANIFEST.raster,
    ProjectorLimits(dark_us=240.0),
    stored=MANIFEST.plan,
)


def compiled(
    plan: PatternPlan, period_us: float = 8600.0, load_us: float = 0.0, manifest: FlashManifest = MANIFEST
) -> tuple[Program, LoadedSequence]:
    info = ProjectorInfo("", "", "", "", "real", None, INFO.limits, stored=manifest.plan)
    return compile_plan(plan, period_us, manifest, info, lambda _: load_us)


def lasting(plan: PatternPlan, exposure_us: float) -> PatternPlan:
    return PatternPlan(
        name=plan.name, patterns=tuple(p.model_copy(update={"exposure_us": exposure_us}) for p in plan.patterns)
    )


@pytest.mark.parametrize(
    ("number", "depth", "plane"),
    [
        (0, 1, 0),
        (8, 1, 8),
        (23, 1, 23),
        (1, 2, 2),
        (0, 4, 0),
        (2, 4, 8),
        (0, 5, 1),
        (1, 6, 6),
        (0, 7, 1),
        (1, 7, 9),
        (0, 8, 0),
        (1, 8, 8),
        (2, 8, 16),
    ],
)
def test_pattern_numbers_stand_for_the_planes_of_the_guides_table(number: int, depth: int, plane: int) -> None:
    assert planes.lowest_plane(number, depth) == plane


@pytest.mark.parametrize(("number", "depth"), [(24, 1), (12, 2), (8, 3), (6, 4), (4, 5), (4, 6), (3, 7), (3, 8)])
def test_the_table_ends_where_the_image_ends(number: int, depth: int) -> None:
    planes.lowest_plane(number - 1, depth)
    with pytest.raises(ValueError, match="beyond an image"):
        planes.lowest_plane(number, depth)


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(0, 23), unique=True, min_size=1, max_size=6))
def test_what_is_put_into_planes_is_shown_again_and_touches_no_other(seed: int, numbers: list[int]) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (6, 7, 3), dtype=np.uint8)
    before = image.copy()
    put = {n: rng.choice(np.array([0, 255], np.uint8), (6, 7)) for n in numbers}
    for number, levels in put.items():
        planes.insert(image, number, 1, levels)
    for number in range(24):
        expected = put.get(number, planes.shown(before, number, 1))
        assert np.array_equal(planes.shown(image, number, 1), expected)


@given(st.integers(0, 2), st.integers(0, 2**32 - 1))
def test_eight_bits_are_one_channel(number: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (5, 4, 3), dtype=np.uint8)
    before = image.copy()
    levels = rng.integers(0, 256, (5, 4), dtype=np.uint8)
    planes.insert(image, number, 8, levels)
    assert np.array_equal(planes.shown(image, number, 8), levels)
    others = [k for k in range(3) if k != number]
    assert np.array_equal(image[..., others], before[..., others])


@pytest.mark.parametrize("name", ["composite", "reference", "full", "complementary", "calibration"])
def test_a_packed_flash_gives_every_pattern_back(name: str) -> None:
    plan = make_plan(name, PARAMETERS)  # type: ignore[arg-type]
    manifest = FlashManifest.packed(plan)
    assert manifest.plan.patterns == plan.patterns
    images = [manifest.render(k, SMALL) for k in range(manifest.images)]
    for stored in manifest.patterns:
        shown = planes.shown(images[stored.image], stored.number, stored.depth)
        assert np.array_equal(shown, stored.pattern.render(SMALL)), stored.pattern.name
    least = 0
    for row_coded in (False, True):
        members = [p for p in plan.patterns if p.is_row_coded == row_coded]
        eight = sum(not (p.is_gray or p.is_uniform) for p in members)
        least += -(-eight // 3) + -(-(len(members) - eight) // 24)
    assert manifest.images == least
    for image in range(manifest.images):
        assert len({s.pattern.is_row_coded for s in manifest.patterns if s.image == image}) == 1


def test_three_fringes_share_an_image_as_green_red_and_blue() -> None:
    first = [s for s in MANIFEST.patterns if s.image == 0]
    assert [(s.number, s.depth) for s in first] == [(0, 8), (1, 8), (2, 8)]
    image = MANIFEST.render(0)
    assert image.shape == (1140, 912, 3)
    for channel, stored in enumerate(first):
        assert np.array_equal(image[..., channel], stored.pattern.render(MANIFEST.raster))


def test_patterns_must_not_share_planes_or_lose_levels() -> None:
    fringe, plane = make_pattern("high_00", PARAMETERS), make_pattern("gray_00", PARAMETERS)
    stored = StoredPattern(pattern=fringe, image=0, number=1, depth=8)
    FlashManifest(patterns=(stored, StoredPattern(pattern=plane, image=0, number=7, depth=1)))
    with pytest.raises(ValidationError, match="share a plane"):
        FlashManifest(patterns=(stored, StoredPattern(pattern=plane, image=0, number=8, depth=1)))
    with pytest.raises(ValidationError, match="more than two grey levels"):
        StoredPattern(pattern=fringe, image=0, number=0, depth=1)
    with pytest.raises(ValidationError, match="beyond an image"):
        StoredPattern(pattern=fringe, image=0, number=3, depth=8)


def test_a_manifest_survives_its_file_and_a_damaged_one_is_told(tmp_path: Path) -> None:
    path = tmp_path / "flash.json"
    MANIFEST.write(path)
    assert FlashManifest.from_file(path) == MANIFEST
    for damage in (path.read_bytes()[:-40], b"[]", b"\xff\xfe", b'{"patterns": []}'):
        path.write_bytes(damage)
        with pytest.raises(DeviceConfigurationError) as caught:
            FlashManifest.from_file(path)
        assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(DeviceConfigurationError, match=r"nowhere\.json"):
        FlashManifest.from_file(tmp_path / "nowhere.json")


def test_one_image_is_taken_for_each_run_of_patterns_of_one_image() -> None:
    program, loaded = compiled(PLAN)
    images = [stored.image for stored in MANIFEST.patterns]
    runs = [images[0]] + [b for a, b in pairwise(images) if a != b]
    assert program.images == tuple(runs)
    assert program.entries[0].swap
    assert sum(entry.swap for entry in program.entries) == len(runs)
    assert program.control == (len(PLAN), False, len(PLAN), len(runs))
    assert program.timing == Timing(8333, 8600)
    assert all(entry.black and not entry.share and entry.leds is LedSelect.WHITE for entry in program.entries)
    assert loaded.pulses_us == tuple(8600.0 * k for k in range(len(PLAN)))


@given(st.floats(8333, 20_000), st.floats(0, 60_000))
def test_pulses_keep_the_period_the_dark_and_the_load(period_us: float, load_us: float) -> None:
    program, loaded = compiled(PLAN, period_us, load_us)
    exposure, period = program.timing
    assert exposure == 8333
    assert period >= period_us
    assert period - exposure > 230
    at = [k for k, entry in enumerate(program.entries) if entry.swap]
    assert all((b - a) * period >= load_us for a, b in pairwise(at))
    assert loaded.pulses_us[1] == period


def test_a_longer_load_means_a_longer_period_and_no_longer_than_needed() -> None:
    """White stands alone in its image before the first fringes, so their load decides."""
    assert compiled(PLAN, 8600.0, 30_000.0)[0].timing.period_us == 30_000
    fringes = PLAN.restricted_to([f"high_{k:02d}" for k in range(2, 8)])
    assert compiled(fringes, 8600.0, 30_000.0)[0].timing.period_us == 10_000


def test_one_pattern_needs_no_neighbour() -> None:
    program, loaded = compiled(lasting(PLAN.restricted_to(["white"]), 235.0), 235.0)
    assert program.timing == Timing(235, 475)
    assert loaded.pulses_us == (0.0,)
    assert loaded.duration_us == 235.0


@pytest.mark.parametrize("exposure_us", [8334.0, 20_000.0])
def test_exposures_that_differ_are_refused_by_name(exposure_us: float) -> None:
    patterns = list(PLAN.patterns)
    patterns[3] = patterns[3].model_copy(update={"exposure_us": exposure_us})
    with pytest.raises(SequenceInvalidError, match=rf"'{patterns[3].name}' is to last .* and 'white' 8333 us"):
        compiled(PatternPlan(patterns=tuple(patterns)), 30_000.0)


def test_a_plane_stored_with_eight_bits_needs_their_time() -> None:
    gray = make_pattern("gray_00", PARAMETERS)
    manifest = FlashManifest(patterns=(StoredPattern(pattern=gray, image=0, number=0, depth=8),))
    plan = lasting(PatternPlan(patterns=(gray,)), 1000.0)
    with pytest.raises(SequenceInvalidError, match="'gray_00' is stored with 8 bits and is to last 1000 us; 8333"):
        compiled(plan, 2000.0, manifest=manifest)


def test_more_images_than_the_lut_takes_are_refused_at_their_pattern() -> None:
    """Patterns of two images in turn take a swap each."""
    parameters = FringeParameters(steps=(40, 40), exposure_us=8333.0)
    names = [f"{kind}_{k:02d}" for k in range(40) for kind in ("high", "low")]
    patterns = tuple(make_pattern(name, parameters) for name in names)
    manifest = FlashManifest(
        patterns=tuple(
            StoredPattern(pattern=p, image=2 * (k // 6) + k % 2, number=k % 6 // 2, depth=8)
            for k, p in enumerate(patterns)
        )
    )
    with pytest.raises(SequenceInvalidError, match=f"'{names[64]}' needs image number 65"):
        compiled(PatternPlan(patterns=patterns), manifest=manifest)
    compiled(PatternPlan(patterns=patterns[:64]), manifest=manifest)


@pytest.mark.parametrize("period_us", [float("nan"), float("inf"), -1.0, 1e12])
def test_an_impossible_period_is_refused(period_us: float) -> None:
    with pytest.raises(SequenceInvalidError):
        compiled(PLAN, period_us)


def test_parameters_make_another_pattern() -> None:
    other = make_pattern("high_00", FringeParameters(periods=(10.0, 14.0), exposure_us=8333.0))
    with pytest.raises(SequenceInvalidError, match="'high_00' is not stored"):
        compiled(PatternPlan(patterns=(other,)))


@given(st.sampled_from(MANIFEST.patterns), st.integers(1, 100_000))
def test_a_held_pattern_repeats_without_dark(stored: StoredPattern, exposure_us: int) -> None:
    program = hold_program(stored, exposure_us)
    assert program.timing.exposure_us == program.timing.period_us
    assert program.timing.exposure_us == max(exposure_us, planes.minimum_exposure_us(stored.depth))
    assert program.control == (1, True, 1, 1)
    assert isinstance(stored.pattern, Pattern)
