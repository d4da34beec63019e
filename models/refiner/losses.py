"""The label-free losses (paper, Loss Function), each a pure function; they see lit pixels only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from models.refiner.differences import SMALLEST_MAGNITUDE, Gradient, forward_gradient, mean_over, phase_gradient
from models.refiner.errors import RefinerError
from models.refiner.fields import RefinedPhase
from models.refiner.loss_configuration import LossConfiguration
from models.refiner.similarity import structural_similarity


@dataclass(frozen=True, eq=False)
class Observation:
    """What a refined phase is judged by; nothing here is learned.

    image: float32 (B, 1, H, W), the composite as given to the refiner. texture: float32 (B, 1, H, W), coarse texture of
    the single-shot method on the same scale. lit: bool (B, 1, H, W), see ``lit_pixels``; taken from the input, so that
    no network can escape a loss by darkening. Raises RefinerError for other shapes.
    """

    image: torch.Tensor
    texture: torch.Tensor
    lit: torch.Tensor

    def __post_init__(self) -> None:
        shapes = {tuple(self.image.shape), tuple(self.texture.shape), tuple(self.lit.shape)}
        if len(shapes) != 1 or self.image.ndim != 4 or self.image.shape[1] != 1 or self.lit.dtype != torch.bool:
            raise RefinerError(
                f"losses: image, texture and lit (bool) must all be (batch, 1, height, width), got {sorted(shapes)}"
            )


@dataclass(frozen=True, eq=False)
class Loss:
    """total: scalar to minimise. terms: each computed term without its weight, by its name in ``LossConfiguration``."""

    total: torch.Tensor
    terms: Mapping[str, torch.Tensor]


def lit_pixels(carriers: torch.Tensor, noise_level: float) -> torch.Tensor:
    """Where both input carriers, complex64 (B, 2, H, W), modulate by more than ``noise_level``: bool (B, 1, H, W)."""
    return (carriers.detach().abs() > noise_level).all(dim=1, keepdim=True)


def reconstruction_loss(
    rebuilt: torch.Tensor, image: torch.Tensor, lit: torch.Tensor, ssim_weight: float
) -> torch.Tensor:
    """eq:loss_rec: mean |difference| + ssim_weight (1 - SSIM), images (B, 1, H, W), shares of full scale."""
    loss = mean_over((rebuilt - image).abs(), lit)
    if ssim_weight:
        loss = loss + ssim_weight * mean_over(1 - structural_similarity(rebuilt, image, lit), lit)
    return loss


def rebuilt_image(carriers: torch.Tensor, texture: torch.Tensor) -> torch.Tensor:
    """eq:image_reconstruction: texture plus the fringes, M cos(phase) = Re z, of both carriers; (B, 1, H, W)."""
    return texture + carriers.real.sum(dim=1, keepdim=True)


def scale_loss(gradient: Gradient, periods: tuple[float, float]) -> torch.Tensor:
    """eq:loss_scale with the factor low / high period on the low slope, 14/9 for ours.

    The paper prints the inverse. A phase's slope is 2 pi du/dx / period, so slope times period is the same for
    both carriers and only this factor makes the loss vanish on a plane. periods: (high, low) carrier, columns.
    """
    magnitude = gradient.magnitude()
    high, low = magnitude[:, :1], magnitude[:, 1:]
    return mean_over((torch.log1p(high) - torch.log1p(periods[1] / periods[0] * low)).abs(), gradient.valid)


def direction_loss(gradient: Gradient) -> torch.Tensor:
    """eq:loss_dir: mean of 1 - cosine of the angle between the slopes of both carriers."""
    magnitude = gradient.magnitude()
    product = (gradient.x[:, :1] * gradient.x[:, 1:]) + (gradient.y[:, :1] * gradient.y[:, 1:])
    return mean_over(1 - product / (magnitude[:, :1] * magnitude[:, 1:]), gradient.valid)


def total_variation(values: torch.Tensor, valid: torch.Tensor, epsilon: float) -> torch.Tensor:
    """eq:charbonnier_tv less its value on a constant, which is thereby 0; summed over channels, mean over places."""
    gradient = forward_gradient(values, valid)
    rough = (gradient.x.square() + epsilon**2).sqrt() + (gradient.y.square() + epsilon**2).sqrt() - 2 * epsilon
    return mean_over(rough, gradient.valid) * values.shape[1]


def continuity_loss(gradient: Gradient, epsilon: float) -> torch.Tensor:
    """eq:loss_cont: total variation of both slopes' magnitudes."""
    return total_variation(gradient.magnitude(), gradient.valid, epsilon)


def ratio_loss(modulus: torch.Tensor, lit: torch.Tensor, ratio_epsilon: float, tv_epsilon: float) -> torch.Tensor:
    """eq:loss_mod_sigma_ratio: total variation of high over low modulus; modulus (B, 2, H, W), share of full scale."""
    safe = torch.where(lit, modulus, 0.0)
    return total_variation(safe[:, :1] / (safe[:, 1:] + ratio_epsilon), lit, tv_epsilon)


def edge_loss(
    gradient: Gradient, modulus: torch.Tensor, observation: Observation, configuration: LossConfiguration
) -> torch.Tensor:
    """eq:loss_edge: soft edges of phase and modulus (eq:soft_edge_maps) should be where those of the texture are."""
    sharp, lit = configuration.edge_sharpness, observation.lit
    bend = forward_gradient(gradient.magnitude(), gradient.valid)
    logarithm = torch.where(lit, modulus, 0.0).add(configuration.ratio_epsilon).log()
    fade = forward_gradient(logarithm, lit)
    texture = forward_gradient(observation.texture, lit)
    phase_edge = _soft_edge(bend, configuration.phase_threshold, sharp)
    modulus_edge = _soft_edge(fade, configuration.modulus_threshold, sharp)
    texture_edge = _soft_edge(texture, configuration.texture_threshold, sharp)
    apart = (phase_edge - texture_edge).abs() + (modulus_edge - texture_edge).abs()
    return mean_over(apart, bend.valid & fade.valid)  # over two carriers: the sum's half


def _soft_edge(gradient: Gradient, threshold: float, sharpness: float) -> torch.Tensor:
    """sigmoid(alpha (|gradient| - tau)) with alpha = sharpness / tau."""
    return torch.sigmoid(sharpness * ((gradient.magnitude() - SMALLEST_MAGNITUDE) / threshold - 1))


def total_loss(
    refined: RefinedPhase, observation: Observation, periods: tuple[float, float], configuration: LossConfiguration
) -> Loss:
    """Weighted sum of the terms whose weight is not 0, and these terms.

    periods: of the high and the low carrier, projector columns. Dark pixels change neither value nor gradient.
    """
    lit = observation.lit
    gradient = phase_gradient(refined.carriers, lit, configuration.gradient)
    epsilon = configuration.tv_epsilon
    terms: dict[str, torch.Tensor] = {}
    if configuration.reconstruction:
        rebuilt = rebuilt_image(refined.carriers, observation.texture)
        terms["reconstruction"] = reconstruction_loss(rebuilt, observation.image, lit, configuration.ssim)
    if configuration.scale:
        terms["scale"] = scale_loss(gradient, periods)
    if configuration.direction:
        terms["direction"] = direction_loss(gradient)
    if configuration.continuity:
        terms["continuity"] = continuity_loss(gradient, epsilon)
    if configuration.ratio:
        terms["ratio"] = ratio_loss(refined.modulus, lit, configuration.ratio_epsilon, epsilon)
    if configuration.edges:
        terms["edges"] = edge_loss(gradient, refined.modulus, observation, configuration)
    weighted = [getattr(configuration, name) * term for name, term in terms.items()]
    total = torch.stack(weighted).sum() if weighted else refined.modulus.sum() * 0
    return Loss(total, terms)
