"""The refiner (paper, Network Architecture): residual phases and moduli from one image and a first estimate."""

from __future__ import annotations

import torch
from torch import nn

from models.refiner.attention import CrossAttention
from models.refiner.blocks import SLOPE, Decoder, Encoder
from models.refiner.configuration import RefinerConfiguration
from models.refiner.fields import RefinedPhase, RefinerInput
from models.refiner.local_contrast import locally_normalised
from models.refiner.padding import padded

MODULUS_EPSILON = 1e-12
"""Of eq:modulus_decomposition: a floor of 1e-6 of full scale under the modulus."""
UNIT_EPSILON = 1e-6
"""Of eq:unit_projection; larger, because its root bounds the gradient where the phase is undefined."""
_MODULUS_GAIN = 4.0  # the composite modulates by 0.25 of full scale at most


class Refiner(nn.Module):
    """Refines carriers by what the image says; untrained it returns its input.

    configuration: shape of the network. seed: of the initial weights, which do not touch torch's global generator.
    Takes any image size. A view's result does not depend on the others of its batch.
    """

    def __init__(self, configuration: RefinerConfiguration | None = None, seed: int = 0) -> None:
        super().__init__()
        self.configuration = chosen = configuration or RefinerConfiguration()
        cell = chosen.block**2
        bottleneck = chosen.image_widths[-1]
        skips = chosen.image_widths[:-1]
        if chosen.skips == "image+guidance":
            skips = tuple(a + b for a, b in zip(skips, chosen.guidance_widths[:-1], strict=True))
        with torch.random.fork_rng(devices=[]):
            self.image_encoder = Encoder(2 * cell, chosen.image_widths)
            self.phase_encoder = Encoder(4 * cell, chosen.guidance_widths)
            self.modulus_encoder = Encoder(2 * cell, chosen.guidance_widths)
            self.phase_projection = nn.Conv2d(chosen.guidance_widths[-1], bottleneck, 1)
            self.modulus_projection = nn.Conv2d(chosen.guidance_widths[-1], bottleneck, 1)
            self.phase_attention = CrossAttention(bottleneck, chosen.attention_heads, chosen.position_strength)
            self.modulus_attention = CrossAttention(bottleneck, chosen.attention_heads, chosen.position_strength)
            self.high_head = Decoder(bottleneck, skips, chosen.head_widths, 2 * cell)
            self.low_head = Decoder(bottleneck, skips, chosen.head_widths, 2 * cell)
            self.modulus_head = Decoder(bottleneck, skips, chosen.head_widths, 2 * cell)
        self._initialise(seed)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, observed: RefinerInput) -> RefinedPhase:
        height, width = observed.image.shape[-2:]
        modulus = (observed.carriers.real**2 + observed.carriers.imag**2 + MODULUS_EPSILON).sqrt()
        unit = torch.view_as_real(observed.carriers / modulus).movedim(-1, 2)  # (B, 2 carriers, cos and sin, H, W)
        phase_change, modulus_change = self._changes(observed.image, unit.flatten(1, 2), modulus)
        moved = unit + phase_change[..., :height, :width].reshape(unit.shape)
        length = (moved.square().sum(dim=2, keepdim=True) + UNIT_EPSILON).sqrt()
        unit = moved / length
        # Not eq:modulus_update, whose sigmoid changes a modulus that needs no change.
        bound = self.configuration.largest_log_change
        modulus = modulus * (bound * torch.tanh(modulus_change[..., :height, :width] / bound)).exp()
        return RefinedPhase(torch.complex(modulus * unit[:, :, 0], modulus * unit[:, :, 1]), modulus, length[:, :, 0])

    def _changes(
        self, image: torch.Tensor, phases: torch.Tensor, moduli: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """dP (B, 4, ...) and dM (B, 2, ...) on the padded grid."""
        seen = self.image_encoder(self._cells(torch.cat([image, locally_normalised(image)], dim=1)))
        phase = self.phase_encoder(self._cells(phases))
        modulus = self.modulus_encoder(self._cells(_MODULUS_GAIN * moduli))
        fused_phase = self.phase_attention(seen[-1], self.phase_projection(phase[-1]))
        fused_modulus = self.modulus_attention(seen[-1], self.modulus_projection(modulus[-1]))
        phase_skips, modulus_skips = self._skips(seen, phase), self._skips(seen, modulus)
        heads = [
            self.high_head(fused_phase, phase_skips),
            self.low_head(fused_phase, phase_skips),
            self.modulus_head(fused_modulus, modulus_skips),
        ]
        pixels = [nn.functional.pixel_shuffle(head, self.configuration.block) for head in heads]
        return torch.cat(pixels[:2], dim=1), pixels[2]

    def _cells(self, values: torch.Tensor) -> torch.Tensor:
        cells = nn.functional.pixel_unshuffle(padded(values, self.configuration.stride), self.configuration.block)
        return cells.contiguous(memory_format=torch.channels_last)

    def _skips(self, image: list[torch.Tensor], guidance: list[torch.Tensor]) -> list[torch.Tensor]:
        if self.configuration.skips == "image":
            return image[:-1]
        return [torch.cat(pair, dim=1) for pair in zip(image[:-1], guidance[:-1], strict=True)]

    def _initialise(self, seed: int) -> None:
        generator = torch.Generator().manual_seed(seed)
        for module in self.modules():
            if isinstance(module, nn.Conv2d | nn.Linear):
                nn.init.kaiming_normal_(module.weight, a=SLOPE, nonlinearity="leaky_relu", generator=generator)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        for head in (self.high_head, self.low_head, self.modulus_head):
            nn.init.zeros_(head.last.weight)
