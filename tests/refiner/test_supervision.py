"""Losses against known phases, and the image as bright and dark surfaces show it alike."""

from __future__ import annotations

import pytest
import torch
from planes import plane

from models.refiner import RefinedPhase
from models.refiner.local_contrast import locally_normalised
from models.refiner.supervision import modulus_loss, phasor_loss


def everywhere(carriers: torch.Tensor) -> torch.Tensor:
    return torch.ones_like(carriers.real[:, :1], dtype=torch.bool)


def unit(carriers: torch.Tensor) -> torch.Tensor:
    return carriers / carriers.abs()


def test_the_truth_itself_costs_nothing() -> None:
    carriers = plane(8.3)
    assert phasor_loss(RefinedPhase.of(carriers), unit(carriers), everywhere(carriers)) < 1e-5


def test_a_turned_phase_costs_its_chord() -> None:
    carriers = plane(8.3)
    turned = carriers * torch.polar(torch.tensor(1.0), torch.tensor(0.5))
    chord = 2 * torch.tensor(0.25).sin()
    loss = phasor_loss(RefinedPhase.of(turned), unit(carriers), everywhere(carriers))
    assert loss == pytest.approx(float((chord**2 + 0.02**2).sqrt() - 0.02 + chord**2), rel=1e-3)


def test_of_contradicting_labels_the_best_length_is_their_mean() -> None:
    """Half of the pixels are told +1 rad, half -1 rad: nothing better than cos 1 along 0 can be foretold."""
    carriers = torch.full((1, 2, 4, 40), 0.2 + 0j)
    sign = torch.where(torch.arange(40) % 2 == 0, 1.0, -1.0)
    target = torch.polar(torch.ones(40), sign).expand(1, 2, 4, 40)
    lengths = torch.linspace(0.1, 1.0, 91)
    modulus = carriers.abs()
    costs = [
        float(
            phasor_loss(RefinedPhase(carriers, modulus, torch.full_like(modulus, float(n))), target, everywhere(target))
        )
        for n in lengths
    ]
    assert float(lengths[int(torch.tensor(costs).argmin())]) == pytest.approx(float(torch.tensor(1.0).cos()), abs=0.011)


def test_where_nothing_is_known_nothing_is_learned() -> None:
    carriers = plane(8.3).requires_grad_()
    target = torch.zeros_like(carriers.detach())
    loss = phasor_loss(RefinedPhase.of(carriers), target, ~everywhere(target))
    loss.backward()  # type: ignore[no-untyped-call]
    assert carriers.grad is not None
    assert float(carriers.grad.abs().max()) == 0


def test_where_there_is_no_light_the_length_should_vanish() -> None:
    carriers = plane(8.3)
    target = torch.zeros_like(carriers)
    sure, unsure = (
        phasor_loss(
            RefinedPhase(carriers, carriers.abs(), torch.full_like(carriers.real, n)), target, everywhere(target)
        )
        for n in (1.0, 0.1)
    )
    assert unsure < 0.02 * sure


def test_the_modulus_is_judged_under_the_known_phase() -> None:
    target = unit(plane(8.3))
    texture = torch.full_like(target.real[:, :1], 0.3)
    image = texture + 0.1 * target.real.sum(dim=1, keepdim=True)
    right, wrong = (
        modulus_loss(RefinedPhase.of(level * target), target, everywhere(target), image, texture)
        for level in (0.1, 0.15)
    )
    assert right < 1e-6
    assert wrong > 0.1


@pytest.mark.parametrize("gain", [0.2, 0.5, 1.0])
def test_fringes_look_alike_on_dark_and_bright_surfaces(gain: float) -> None:
    image = 0.5 + 0.2 * unit(plane(8.3)).real[:, :1]
    seen, dimmed = locally_normalised(image), locally_normalised(gain * image)
    assert seen.shape == image.shape
    assert float((seen - dimmed).abs().max()) < 0.1
    assert 0.8 < float(seen.std()) < 1.2


def test_a_flat_image_shows_nothing() -> None:
    assert float(locally_normalised(torch.full((1, 1, 40, 50), 0.7)).abs().max()) < 1e-3
