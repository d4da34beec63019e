"""Width and depth of the refiner, as it is stored beside its weights."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Width = Annotated[int, Field(ge=4, le=256)]


class RefinerConfiguration(BaseModel):
    """What decides the shape of the network; frozen, and read back from JSON unchanged.

    block: side in pixels of the cells whose pixels become channels (space to depth) before the first convolution.
    image_widths, guidance_widths: channels of the image encoder and of each of the two guidance encoders (unit phases,
    moduli), finest level first; each level after the first halves the resolution. head_widths: channels of the
    three decoders at all levels but the coarsest. attention_heads: must divide the coarsest image width.
    position_strength: lambda of eq:attn_query and eq:attn_key_value. skips: what decoders see at each level:
    features of the image (the paper), or those of their guidance as well. largest_log_change: bound of |dM|:
    the modulus changes by at most a factor of exp(largest_log_change).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)

    schema_: Literal["refiner/1"] = Field(default="refiner/1", alias="schema")
    block: Literal[1, 2, 4] = 2
    image_widths: Annotated[tuple[Width, ...], Field(min_length=2, max_length=5)] = (32, 48, 80, 128)
    guidance_widths: Annotated[tuple[Width, ...], Field(min_length=2, max_length=5)] = (16, 32, 48, 96)
    head_widths: Annotated[tuple[Width, ...], Field(min_length=1, max_length=4)] = (32, 48, 64)
    attention_heads: Annotated[int, Field(ge=1, le=16)] = 4
    position_strength: Annotated[float, Field(ge=0, le=10)] = 0.1
    skips: Literal["image", "image+guidance"] = "image+guidance"
    largest_log_change: Annotated[float, Field(gt=0, le=10)] = 4.0

    @model_validator(mode="after")
    def _consistent(self) -> RefinerConfiguration:
        levels = len(self.image_widths)
        if len(self.guidance_widths) != levels or len(self.head_widths) != levels - 1:
            raise ValueError(
                f"{levels} image widths need {levels} guidance widths and {levels - 1} head widths, "
                f"got {len(self.guidance_widths)} and {len(self.head_widths)}"
            )
        if self.image_widths[-1] % (4 * self.attention_heads):
            raise ValueError(
                f"the coarsest image width {self.image_widths[-1]} must be a multiple of 4 * attention_heads "
                f"({4 * self.attention_heads})"
            )
        return self

    @property
    def stride(self) -> int:
        """Pixels a side of one token of the bottleneck."""
        return int(self.block) << (len(self.image_widths) - 1)

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"
