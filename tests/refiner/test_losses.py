"""Each loss vanishes where its equation says so, sees no dark pixel, and has finite gradients."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from planes import PERIODS, everywhere, plane
from pydantic import ValidationError

from models.refiner import (
    ABLATIONS,
    LossConfiguration,
    Observation,
    RefinedPhase,
    RefinerError,
    lit_pixels,
    total_loss,
)
from models.refiner.differences import phase_gradient
from models.refiner.losses import (
    continuity_loss,
    direction_loss,
    ratio_loss,
    rebuilt_image,
    reconstruction_loss,
    scale_loss,
    total_variation,
)

FULL = ABLATIONS["A3"]
TERMS = ("reconstruction", "scale", "direction", "continuity", "ratio", "edges")
fringes = st.floats(min_value=6.0, max_value=14.0)
tilts = st.floats(min_value=-1.2, max_value=1.2)


def noisy(seed: int = 0, size: tuple[int, int] = (32, 40)) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(1, 2, *size, dtype=torch.complex64, generator=generator)
    return plane(8.3, size=size) + 0.03 * noise


def judged(carriers: torch.Tensor, lit: torch.Tensor | None = None) -> tuple[RefinedPhase, Observation]:
    generator = torch.Generator().manual_seed(5)
    texture = 0.3 + 0.05 * torch.rand(carriers[:, :1].shape, generator=generator)
    image = texture + plane(8.3, size=(carriers.shape[2], carriers.shape[3])).real.sum(dim=1, keepdim=True)
    return RefinedPhase.of(carriers), Observation(image, texture, everywhere(carriers) if lit is None else lit)


@settings(max_examples=30, deadline=None)
@given(period=fringes, tilt=tilts)
def test_planes_have_consistent_slopes(period: float, tilt: float) -> None:
    carriers = plane(period, tilt)
    gradient = phase_gradient(carriers, everywhere(carriers))
    assert gradient.valid[:, :, :-1, :-1].all()
    slopes = torch.tensor([2 * math.pi / period, 2 * math.pi / period * 9 / 14])[:, None, None]
    assert (gradient.x[0] - slopes * math.cos(tilt))[:, :-1, :-1].abs().max() < 1e-5
    assert (gradient.y[0] - slopes * math.sin(tilt))[:, :-1, :-1].abs().max() < 1e-5
    assert scale_loss(gradient, PERIODS) < 1e-5
    assert direction_loss(gradient).abs() < 1e-5
    assert continuity_loss(gradient, 1e-3) < 1e-5


@settings(max_examples=20, deadline=None)
@given(period=fringes, tilt=tilts)
def test_the_inverse_factor_is_no_plane(period: float, tilt: float) -> None:
    carriers = plane(period, tilt)
    gradient = phase_gradient(carriers, everywhere(carriers))
    assert scale_loss(gradient, (PERIODS[1], PERIODS[0])) > 0.1


def test_central_differences_read_the_sine_of_the_slope() -> None:
    carriers = plane(8.3)
    central = phase_gradient(carriers, everywhere(carriers), "central")
    slopes = torch.tensor([2 * math.pi / 8.3, 2 * math.pi / 8.3 * 9 / 14])
    inner = central.x[0, :, 1:-1, 1:-1]
    assert (inner - slopes.sin()[:, None, None]).abs().max() < 1e-5
    assert (inner[0] / inner[1]).mean() == pytest.approx(1.468, abs=2e-3)
    assert scale_loss(central, PERIODS) > 1e-2


def test_slopes_of_different_direction_cost() -> None:
    carriers = torch.cat([plane(8.0)[:, :1], plane(8.0, tilt=math.pi / 2)[:, 1:]], dim=1)
    assert direction_loss(phase_gradient(carriers, everywhere(carriers))) == pytest.approx(1.0, abs=1e-4)


def test_constant_fields_do_not_vary() -> None:
    lit = torch.ones(1, 1, 12, 9, dtype=torch.bool)
    constant = torch.full((1, 2, 12, 9), 0.7)
    assert total_variation(constant, lit, 1e-3).abs() < 1e-7
    assert ratio_loss(constant, lit, 1e-3, 1e-3).abs() < 1e-7
    step = constant.clone()
    step[..., 4:] = 0.2
    assert total_variation(step, lit, 1e-3) == pytest.approx(2 * 0.5 / 8, rel=2e-2)


def test_an_exact_synthesis_is_reconstructed() -> None:
    carriers = plane(8.3, 0.4)
    texture = torch.linspace(0.2, 0.5, carriers.shape[-1]).expand(1, 1, *carriers.shape[2:])
    image = texture + carriers.real.sum(dim=1, keepdim=True)
    lit = everywhere(carriers)
    assert reconstruction_loss(rebuilt_image(carriers, texture), image, lit, 0.5) < 1e-5
    assert reconstruction_loss(rebuilt_image(1.1 * carriers, texture), image, lit, 0.0) > 5e-3
    assert reconstruction_loss(image + 0.1, image, lit, 0.0) == pytest.approx(0.1, abs=1e-6)
    unlike = reconstruction_loss(rebuilt_image(-carriers, texture), image, lit, 1.0)
    assert unlike - reconstruction_loss(rebuilt_image(-carriers, texture), image, lit, 0.0) > 0.5


def test_edges_cost_where_the_texture_has_none() -> None:
    flat = plane(8.3)
    observation = Observation(
        torch.zeros_like(flat.real[:, :1]), torch.full_like(flat.real[:, :1], 0.3), everywhere(flat)
    )
    stepped = flat.clone()
    stepped[..., 20:] *= torch.polar(torch.tensor(0.5), torch.tensor(1.5))
    assert total_loss(RefinedPhase.of(flat), observation, PERIODS, FULL).terms["edges"] < 1e-4
    costly = total_loss(RefinedPhase.of(stepped), observation, PERIODS, FULL).terms["edges"]
    texture = observation.texture.clone()
    texture[..., 20:] = 0.6
    shared = Observation(observation.image, texture, observation.lit)
    assert costly > 1e-2
    assert total_loss(RefinedPhase.of(stepped), shared, PERIODS, FULL).terms["edges"] < costly


@pytest.mark.parametrize("name", sorted(ABLATIONS))
def test_gradients_are_finite_even_without_modulus(name: str) -> None:
    start = noisy()
    start[..., 10:20, 5:15] = 0
    start[:, 1, 25:, :] = 0
    for lit in (everywhere(start), lit_pixels(start, 1e-3), torch.zeros_like(everywhere(start))):
        carriers = start.clone().requires_grad_()
        _, observation = judged(start, lit)
        modulus = start.abs().requires_grad_()
        loss = total_loss(
            RefinedPhase(carriers, modulus, torch.ones_like(modulus)), observation, PERIODS, ABLATIONS[name]
        )
        loss.total.backward()
        assert loss.total.isfinite()
        assert carriers.grad is not None
        assert torch.view_as_real(carriers.grad).isfinite().all()
        assert modulus.grad is None or bool(modulus.grad.isfinite().all())
    assert loss.total == 0  # nothing lit, nothing learned


@pytest.mark.parametrize("name", sorted(ABLATIONS))
def test_the_background_teaches_nothing(name: str) -> None:
    lit = torch.zeros(1, 1, 32, 40, dtype=torch.bool)
    lit[..., 6:26, 8:33] = True
    lit[..., 12:15, 12:17] = False
    values = []
    for seed in (1, 2):
        generator = torch.Generator().manual_seed(seed)
        strange = torch.randn(1, 2, 32, 40, dtype=torch.complex64, generator=generator)
        carriers = torch.where(lit, noisy(), strange).requires_grad_()
        refined, seen = judged(carriers, lit)
        observation = Observation(
            torch.where(lit, seen.image, strange.real[:, :1]), torch.where(lit, seen.texture, strange.imag[:, :1]), lit
        )
        loss = total_loss(refined, observation, PERIODS, ABLATIONS[name])
        loss.total.backward()
        assert carriers.grad is not None
        assert (carriers.grad.abs() * ~lit).max() == 0
        assert carriers.grad.abs().max() > 0
        values.append(loss.total.item())
    assert values[0] == values[1]


def test_lit_needs_both_carriers() -> None:
    carriers = torch.full((1, 2, 1, 3), 0.1 + 0j, dtype=torch.complex64)
    carriers[0, 0, 0, 0] = 1e-4
    carriers[0, 1, 0, 1] = 1e-4j
    assert lit_pixels(carriers, 1e-3).flatten().tolist() == [False, False, True]


def test_ablations_add_terms_one_after_the_other() -> None:
    refined, observation = judged(noisy())
    computed = {name: total_loss(refined, observation, PERIODS, c) for name, c in ABLATIONS.items()}
    assert [tuple(computed[f"A{n}"].terms) for n in range(4)] == [TERMS[:3], TERMS[:4], TERMS[:5], TERMS]
    for name, loss in computed.items():
        expected = sum(getattr(ABLATIONS[name], term) * value for term, value in loss.terms.items())
        assert loss.total == pytest.approx(float(expected), rel=1e-5)
    assert computed["A3-central"].terms["scale"] != computed["A3"].terms["scale"]


def test_descending_the_losses_smooths_the_phases() -> None:
    start = noisy()
    _, observation = judged(start)
    carriers = start.clone().requires_grad_()
    optimiser = torch.optim.Adam([carriers], lr=2e-3)
    exact = plane(8.3, size=(32, 40))
    for _ in range(60):
        optimiser.zero_grad()
        total_loss(RefinedPhase.of(carriers), observation, PERIODS, FULL).total.backward()
        optimiser.step()
    errors = [(z * exact.conj()).angle().abs().mean().item() for z in (start, carriers.detach())]
    assert errors[1] < 0.6 * errors[0]


def test_configuration_survives_json_and_refuses_nonsense() -> None:
    for configuration in ABLATIONS.values():
        assert LossConfiguration.model_validate_json(configuration.to_json()) == configuration
    for nonsense in ({"scale": -1}, {"tv_epsilon": 0}, {"unknown": 1}, {"schema": "refiner-losses/0"}):
        with pytest.raises(ValidationError):
            LossConfiguration.model_validate(nonsense)


def test_observation_of_other_shapes_is_refused() -> None:
    image = torch.zeros(1, 1, 4, 5)
    with pytest.raises(RefinerError, match="must all be"):
        Observation(image, image, torch.ones(1, 1, 4, 4, dtype=torch.bool))
    with pytest.raises(RefinerError, match="must all be"):
        Observation(image, image, image)
