"""The method refiner with the shipped weights, on scenes that they did not learn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch
from simulated_captures import objects_before_wall, only

from drivers.simulator.dataset import render_sample
from models.capture import Capture
from models.geometry.rig import Side
from models.patterns import FringeParameters, make_plan
from models.phase.fringe import FringePhase
from models.phase.wft import WindowedFourierTransform
from models.refiner import Refiner, RefinerConfiguration, RefinerError, find_weights, save_weights, shipped_names
from models.refiner.extractor import RefinedFourierTransform, RefinementSettings
from models.refiner.training.views import truth_columns

SEED = 606
"""Of scenes that neither training nor the choice of any setting used."""
SMALL = RefinerConfiguration(image_widths=(8, 8, 16), guidance_widths=(4, 8, 8), head_widths=(8, 8), attention_heads=2)


@dataclass(frozen=True)
class HeldOut:
    """Absolute phase errors, rad (n,), of both carriers of both views over the pixels that carry a phase, before and
    after refinement, with the refiner's certainty."""

    before: np.ndarray
    after: np.ndarray
    certainty: np.ndarray


@lru_cache(maxsize=1)
def scenes() -> tuple[Capture, ...]:
    plan = make_plan("composite")
    usual = [render_sample(SEED, index, plan) for index in range(2)]
    return (*usual, render_sample(SEED, 2, plan, varied=True))


def errors(capture: Capture, phases: Mapping[Side, FringePhase]) -> np.ndarray:
    assert capture.rig is not None
    truth = truth_columns(capture, capture.rig)
    return np.concatenate(
        [
            np.abs(np.angle(carrier.numpy() * np.exp(-2j * np.pi * truth[side] / period)))
            for side, phase in phases.items()
            for carrier, period in zip(phase.carriers, phase.periods, strict=True)
        ]
    )


@lru_cache(maxsize=1)
def held_out() -> HeldOut:
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for capture in scenes():
        given = WindowedFourierTransform(capture.rig).extract(capture)
        refined = RefinedFourierTransform(capture.rig).extract(capture)
        before, after = errors(capture, given), errors(capture, refined)
        tables = [phase.certainty for phase in refined.values()]
        certainty = np.concatenate([np.concatenate([table.numpy()] * 2) for table in tables if table is not None])
        usable = np.concatenate([np.concatenate([phase.mask.numpy() == 0] * 2) for phase in refined.values()])
        kept = usable & np.isfinite(before) & np.isfinite(after)
        parts.append((before[kept], after[kept], certainty[kept]))
    return HeldOut(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def test_hardly_a_good_phase_gets_worse() -> None:
    found = held_out()
    good = found.before < 0.2
    assert np.mean(found.after[good] > found.before[good] + 0.1) < 0.02


def test_phases_get_closer() -> None:
    found = held_out()
    assert np.median(found.after) < 0.6 * np.median(found.before)
    assert np.mean(found.after > 0.35) < 0.6 * np.mean(found.before > 0.35)


def test_certainty_is_the_resultant_length_that_comes_true() -> None:
    """In each class of foretold certainty the mean cosine of the errors is about what was foretold, or better: the
    smaller certainty of both carriers is told."""
    found = held_out()
    for low, high in ((0.5, 0.7), (0.7, 0.9), (0.9, 0.97), (0.97, 1.01)):
        inside = (found.certainty >= low) & (found.certainty < high)
        assert inside.sum() > 500
        assert np.cos(found.after[inside]).mean() > found.certainty[inside].mean() - 0.12


def test_weights_for_other_fringes_are_refused() -> None:
    capture = render_sample(SEED, 0, make_plan("composite", FringeParameters(periods=(8, 13))))
    with pytest.raises(RefinerError, match="9 and 14 columns, not 8 and 13") as caught:
        RefinedFourierTransform(capture.rig).extract(capture)
    assert "--adapt" in str(caught.value)


def test_an_untrained_network_gives_the_filtered_phase(tmp_path: Path) -> None:
    save_weights(tmp_path / "w", Refiner(SMALL), (9.0, 14.0), "label-free")
    capture = only(objects_before_wall(), {"composite"})
    given = WindowedFourierTransform(capture.rig).extract(capture)
    refined = RefinedFourierTransform(capture.rig, weights=str(tmp_path / "w")).extract(capture)
    for side, phase in refined.items():
        assert phase.certainty is None
        assert (phase.carriers - given[side].carriers).abs().max() < 1e-5
        assert (phase.mask != given[side].mask).float().mean() < 1e-3


def test_without_trust_the_filtered_phase_stays() -> None:
    capture = scenes()[0]
    settings = RefinementSettings(trust=2.0, misfit_gain=1e9, least_certainty=0.0)
    given = WindowedFourierTransform(capture.rig).extract(capture)
    refined = RefinedFourierTransform(capture.rig, settings=settings).extract(capture)
    for side, phase in refined.items():
        assert torch.equal(phase.carriers, given[side].carriers)


def test_a_view_does_not_depend_on_the_other() -> None:
    capture = scenes()[0]
    both = RefinedFourierTransform(capture.rig).extract(capture)
    alone = RefinedFourierTransform(capture.rig).extract(replace(capture, images={"left": capture.images["left"]}))
    assert torch.equal(both["left"].carriers, alone["left"].carriers)


def test_weights_are_found_by_name_folder_and_file(tmp_path: Path) -> None:
    save_weights(tmp_path / "mine", Refiner(SMALL), (9.0, 14.0), "label-free")
    assert find_weights() == find_weights(shipped_names()[0])
    assert find_weights(str(tmp_path / "mine")) == tmp_path / "mine"
    assert find_weights(str(tmp_path / "mine" / "refiner.json")) == tmp_path / "mine"
    with pytest.raises(RefinerError, match="shipped are sim"):
        find_weights("nothing")


def test_shipped_weights_are_small_and_say_how_they_were_made() -> None:
    for name in shipped_names():
        folder = find_weights(name)
        assert sum(path.stat().st_size for path in folder.iterdir()) < 8e6
        record = RefinedFourierTransform(weights=name).record
        assert {"configuration", "datasets", "seconds", "data_sha256"} <= record.training.keys()


def test_changed_weights_are_read_again(tmp_path: Path) -> None:
    for variant in ("label-free", "sim"):
        folder = tmp_path / "w"
        if folder.exists():
            for path in folder.iterdir():
                path.unlink()
            folder.rmdir()
        save_weights(folder, Refiner(SMALL), (9.0, 14.0), variant)  # type: ignore[arg-type]
        assert RefinedFourierTransform(weights=str(folder)).record.variant == variant
