"""Where the image decides which parts of the single-shot estimate to believe: cross-attention at the bottleneck."""

from __future__ import annotations

import torch
from torch import nn


def positional_encoding(height: int, width: int, channels: int, device: torch.device) -> torch.Tensor:
    """Sines and cosines of row and column, float32 (height * width, channels), channels a multiple of 4.

    Positions are counted in tokens, so that a place looks the same in an image of any size.
    """
    quarter = channels // 4
    frequency = 1000.0 ** (-torch.arange(quarter, device=device, dtype=torch.float32) / quarter)
    rows = torch.arange(height, device=device, dtype=torch.float32)[:, None, None] * frequency
    columns = torch.arange(width, device=device, dtype=torch.float32)[None, :, None] * frequency
    parts = [part.expand(height, width, quarter) for part in (rows.sin(), rows.cos(), columns.sin(), columns.cos())]
    return torch.cat(parts, dim=-1).reshape(height * width, channels)


class CrossAttention(nn.Module):
    """Fuses one guidance with the image (eq:attn_query to eq:attention_fusion): the image asks, the guidance answers.

    Query, key and value are layer-normalised; lambda times the positional encoding is added to query and key, not to
    the value. What was attended to is added to both features, which therefore pass on even where attention is even.
    """

    def __init__(self, channels: int, heads: int, position_strength: float) -> None:
        super().__init__()
        self.heads = heads
        self.position_strength = position_strength
        self.query_norm = nn.LayerNorm(channels)
        self.guidance_norm = nn.LayerNorm(channels)
        self.query = nn.Linear(channels, channels)
        self.key = nn.Linear(channels, channels)
        self.value = nn.Linear(channels, channels)
        self.output = nn.Linear(channels, channels)

    def forward(self, image: torch.Tensor, guidance: torch.Tensor) -> torch.Tensor:
        """image, guidance and the result: (B, channels, h, w)."""
        batch, channels, height, width = image.shape
        position = self.position_strength * positional_encoding(height, width, channels, image.device)
        answers = self.guidance_norm(guidance.flatten(2).transpose(1, 2))
        query = self._split(self.query(self.query_norm(image.flatten(2).transpose(1, 2)) + position))
        key = self._split(self.key(answers + position))
        attended = nn.functional.scaled_dot_product_attention(query, key, self._split(self.value(answers)))
        fused: torch.Tensor = self.output(attended.transpose(1, 2).reshape(batch, height * width, channels))
        return image + guidance + fused.transpose(1, 2).reshape(batch, channels, height, width)

    def _split(self, tokens: torch.Tensor) -> torch.Tensor:
        batch, count, channels = tokens.shape
        return tokens.view(batch, count, self.heads, channels // self.heads).transpose(1, 2)
