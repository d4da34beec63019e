"""Weights and thresholds of the label-free losses, and the paper's ablations of them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Weight = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


class LossConfiguration(BaseModel):
    """The paper states none of these numbers; they are to be chosen on the validation split.

    reconstruction .. edges: weight of each term of the total; a term of weight 0 is not computed. ssim: lambda_SSIM of
    eq:loss_rec. gradient: how phases are differentiated, "argument" as arg(z(x+1) conj z(x)), "central" as
    eq:phase_grad_from_sincos_hat with central differences, which reads sin(g) for a slope g, to compare with.
    tv_epsilon: of eq:charbonnier_tv. ratio_epsilon: share of full scale, of eq:loss_mod_sigma_ratio and of
    the logarithm in eq:soft_edge_maps. noise_level: share of full scale, for ``lit_pixels``.
    phase_threshold (rad/px^2), modulus_threshold (1/px), texture_threshold (share of full scale per px): tau of
    eq:soft_edge_maps. edge_sharpness: alpha * tau, common to the three maps, so that all agree where nothing varies.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)

    schema_: Literal["refiner-losses/1"] = Field(default="refiner-losses/1", alias="schema")
    reconstruction: Weight = 10.0
    ssim: Weight = 0.1
    scale: Weight = 1.0
    direction: Weight = 1.0
    continuity: Weight = 0.2
    ratio: Weight = 0.05
    edges: Weight = 0.05
    gradient: Literal["argument", "central"] = "argument"
    tv_epsilon: Positive = 1e-3
    ratio_epsilon: Positive = 1e-3
    noise_level: Weight = 1e-3
    phase_threshold: Positive = 0.1
    modulus_threshold: Positive = 0.1
    texture_threshold: Positive = 0.02
    edge_sharpness: Positive = 4.0

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


_FULL = LossConfiguration()

ABLATIONS: Mapping[str, LossConfiguration] = MappingProxyType(
    {
        "A0": _FULL.model_copy(update={"continuity": 0.0, "ratio": 0.0, "edges": 0.0}),
        "A1": _FULL.model_copy(update={"ratio": 0.0, "edges": 0.0}),
        "A2": _FULL.model_copy(update={"edges": 0.0}),
        "A3": _FULL,
        "A3-central": _FULL.model_copy(update={"gradient": "central"}),
    }
)
"""tab:ablation_study, terms added one after the other, and the full loss with the printed phase gradient."""
