"""The network: identity before training, any size, its determinism, and what it costs."""

from __future__ import annotations

import time

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from planes import plane
from pydantic import ValidationError
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils.flop_counter import FlopCounterMode

from models.refiner import Refiner, RefinerConfiguration, RefinerError, RefinerInput
from models.refiner.attention import CrossAttention, positional_encoding
from models.refiner.budget import floating_point_operations, parameter_count
from models.refiner.padding import padded

SMALL = RefinerConfiguration(image_widths=(8, 8, 16), guidance_widths=(4, 8, 8), head_widths=(8, 8), attention_heads=2)
BOTH = SMALL.model_copy(update={"skips": "image+guidance"})


def observed(size: tuple[int, int], batch: int = 1, seed: int = 0) -> RefinerInput:
    generator = torch.Generator().manual_seed(seed)
    carriers = 0.1 * torch.randn(batch, 2, *size, dtype=torch.complex64, generator=generator)
    carriers[..., : size[0] // 3, : size[1] // 3] = 0  # black background
    return RefinerInput(torch.rand(batch, 1, *size, generator=generator), carriers)


def trained(configuration: RefinerConfiguration = SMALL, seed: int = 0) -> Refiner:
    """A refiner that changes something: its heads' last layers are not zero."""
    refiner = Refiner(configuration, seed)
    generator = torch.Generator().manual_seed(seed)
    for head in (refiner.high_head, refiner.low_head, refiner.modulus_head):
        torch.nn.init.normal_(head.last.weight, std=0.05, generator=generator)
    return refiner.eval()


@pytest.mark.parametrize("size", [(48, 64), (33, 47), (1, 1), (2, 3), (17, 5), (16, 31)])
@pytest.mark.parametrize("configuration", [SMALL, BOTH, SMALL.model_copy(update={"block": 1})])
def test_untrained_it_returns_its_input(size: tuple[int, int], configuration: RefinerConfiguration) -> None:
    given_view = observed(size, batch=2)
    with torch.inference_mode():
        refined = Refiner(configuration)(given_view)
    assert refined.carriers.shape == given_view.carriers.shape
    assert (refined.carriers - given_view.carriers).abs().max() < 1e-5
    assert (refined.modulus - given_view.carriers.abs()).abs().max() < 1e-5


def test_the_default_returns_its_input_at_an_odd_size() -> None:
    given_view = observed((75, 101))
    with torch.inference_mode():
        refined = Refiner()(given_view)
    assert (refined.carriers - given_view.carriers).abs().max() < 1e-5


def test_carriers_are_unit_phasors_times_the_modulus() -> None:
    given_view = RefinerInput(torch.rand(1, 1, 40, 48), plane(8.0))
    with torch.inference_mode():
        refined = trained()(given_view)
    assert (refined.carriers - given_view.carriers).abs().max() > 1e-2
    ratio = refined.carriers.abs() / refined.modulus
    assert ratio.max() <= 1 + 1e-5
    assert ratio.median() > 0.999


def test_a_modulus_changes_by_a_bounded_factor() -> None:
    refiner = trained()
    torch.nn.init.constant_(refiner.modulus_head.last.bias, 1e6)
    given_view = RefinerInput(torch.rand(1, 1, 40, 48), plane(8.0))
    with torch.inference_mode():
        grown = refiner(given_view).modulus / given_view.carriers.abs()
    assert grown.max() == pytest.approx(torch.tensor(SMALL.largest_log_change).exp().item(), rel=1e-3)


@pytest.mark.parametrize("configuration", [SMALL, BOTH])
def test_views_of_a_batch_do_not_see_each_other(configuration: RefinerConfiguration) -> None:
    refiner, batch = trained(configuration), observed((37, 50), batch=3)
    with torch.inference_mode():
        together = refiner(batch).carriers
        alone = [refiner(RefinerInput(batch.image[i : i + 1], batch.carriers[i : i + 1])).carriers for i in range(3)]
        turned = refiner(RefinerInput(batch.image.flip(0), batch.carriers.flip(0))).carriers.flip(0)
    assert (together - torch.cat(alone)).abs().max() < 1e-5
    assert (together - turned).abs().max() < 1e-5


def test_the_seed_decides_and_nothing_else() -> None:
    state = torch.random.get_rng_state()
    first = trained(seed=3)
    assert torch.equal(torch.random.get_rng_state(), state)
    torch.rand(5)
    same, other = trained(seed=3).state_dict(), trained(seed=4).state_dict()
    assert all(torch.equal(value, same[name]) for name, value in first.state_dict().items())
    assert any(not torch.equal(value, other[name]) for name, value in first.state_dict().items())
    view = observed((40, 40))
    with torch.inference_mode():
        assert torch.equal(first(view).carriers, first(view).carriers)


@pytest.mark.parametrize("configuration", [SMALL, BOTH])
def test_every_weight_learns_and_no_gradient_is_infinite(configuration: RefinerConfiguration) -> None:
    refiner = trained(configuration).train()
    refined = refiner(observed((35, 44)))
    (torch.view_as_real(refined.carriers).square().sum() + refined.modulus.sum()).backward()
    for name, parameter in refiner.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name
        assert name.endswith("key.bias") or parameter.grad.abs().max() > 0, name  # softmax ignores a key's bias


@settings(max_examples=25, deadline=None)
@given(height=st.integers(1, 9), width=st.integers(1, 9), multiple=st.sampled_from([1, 4, 16]))
def test_padding_reflects_at_the_last_pixel(height: int, width: int, multiple: int) -> None:
    image = torch.arange(height * width, dtype=torch.float32).reshape(1, 1, height, width)
    grown = padded(image, multiple)
    assert grown.shape[-2] % multiple == 0
    assert grown.shape[-1] % multiple == 0
    assert grown.shape[-1] - width < multiple
    assert torch.equal(grown[..., :height, :width], image)
    for place in range(min(width - 1, grown.shape[-1] - width)):
        assert torch.equal(grown[..., :height, width + place], image[..., width - 2 - place])


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (8, 2)])
def test_attention_takes_any_grid(shape: tuple[int, int]) -> None:
    height, width = shape
    torch.manual_seed(0)
    attention = CrossAttention(16, 2, 0.5).eval()
    image, guidance = torch.randn(2, 16, height, width), torch.randn(2, 16, height, width)
    assert attention(image, guidance).shape == image.shape


def test_attention_sees_place_only_through_its_encoding() -> None:
    torch.manual_seed(0)
    image, guidance = torch.randn(1, 16, 4, 6), torch.randn(1, 16, 4, 6)
    for strength, alike in ((0.0, True), (1.0, False)):
        attention = CrossAttention(16, 2, strength).eval()
        with torch.inference_mode():
            moved = attention(image.flip(-1), guidance.flip(-1)).flip(-1)
            assert torch.allclose(moved, attention(image, guidance), atol=1e-5) == alike


def test_a_place_has_the_same_encoding_in_images_of_any_size() -> None:
    small = positional_encoding(3, 4, 16, torch.device("cpu")).reshape(3, 4, 16)
    large = positional_encoding(9, 11, 16, torch.device("cpu")).reshape(9, 11, 16)
    assert torch.equal(small, large[:3, :4])
    assert len({tuple(row) for row in large.reshape(-1, 16).tolist()}) == 99


@pytest.mark.parametrize("configuration", [SMALL, BOTH, RefinerConfiguration()])
def test_operations_are_those_torch_counts(configuration: RefinerConfiguration) -> None:
    refiner = Refiner(configuration).eval()
    # The counter knows attention only as the matrix products of its plain form.
    with sdpa_kernel(SDPBackend.MATH), FlopCounterMode(display=False) as counter, torch.inference_mode():
        refiner(observed((64, 96)))
    assert floating_point_operations(refiner, (96, 64)) == counter.get_total_flops()


def test_the_default_is_within_its_budget() -> None:
    refiner = Refiner()
    assert 4 * parameter_count(refiner) <= 8_000_000
    assert refiner.configuration.stride == 16
    assert floating_point_operations(refiner, (640, 480)) <= 100_000 * 640 * 480
    pair = observed((480, 640), batch=2)
    seconds = []
    with torch.inference_mode():
        for _ in range(2):
            start = time.perf_counter()
            refiner(pair)
            seconds.append(time.perf_counter() - start)
    assert min(seconds) < 10  # a second on two idle cores; the machine may be busy


def test_configuration_survives_json() -> None:
    for configuration in (RefinerConfiguration(), SMALL, BOTH):
        assert RefinerConfiguration.model_validate_json(configuration.to_json()) == configuration


@pytest.mark.parametrize(
    "nonsense",
    [
        {"schema": "refiner/2"},
        {"image_widths": (32, 48)},
        {"image_widths": (32, 48, 80, 130)},
        {"image_widths": (32, 48, 80, 10**6)},
        {"block": 3},
        {"width": 3},
    ],
)
def test_impossible_configurations_are_refused(nonsense: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        RefinerConfiguration.model_validate(nonsense)


def test_inputs_of_other_shape_or_type_are_refused() -> None:
    good = observed((8, 9))
    with pytest.raises(RefinerError, match="image must be float32"):
        RefinerInput((255 * good.image).to(torch.uint8), good.carriers)
    with pytest.raises(RefinerError, match="carriers must be complex64"):
        RefinerInput(good.image, good.carriers[:, :1])
    with pytest.raises(RefinerError, match="carriers must be complex64"):
        RefinerInput(good.image, good.carriers.to(torch.complex128))
