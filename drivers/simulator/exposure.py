"""How well a simulated view was exposed: shares of saturated and under-exposed pixels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict

from models.capture import Image
from models.geometry.rig import Side

UNDER_EXPOSED_BELOW = 10 / 255
"""Less light than this under full white, as a share of the white level, leaves fringes to the noise."""
_WORTH_A_WARNING_PERCENT = 2.0


class ExposureShares(BaseModel):
    """Percentages of a view's lit pixels: at the white level in any image, and too dark for fringes."""

    model_config = ConfigDict(frozen=True)

    saturated_percent: float
    under_exposed_percent: float


def exposure_shares(images: Mapping[str, Image], white: npt.NDArray[np.float32], white_level: int) -> ExposureShares:
    """Shares of one view.

    images: by pattern name. white: float32 (H, W), share of the white level that full projector white alone reads.
    """
    lit = white > 0
    count = max(1, int(np.count_nonzero(lit)))
    saturated = np.zeros_like(lit)
    for image in images.values():
        saturated |= image >= white_level
    dark = lit & (white < UNDER_EXPOSED_BELOW)
    return ExposureShares(
        saturated_percent=round(100 * int(np.count_nonzero(saturated & lit)) / count, 2),
        under_exposed_percent=round(100 * int(np.count_nonzero(dark)) / count, 2),
    )


def exposure_warnings(shares: Mapping[Side, ExposureShares]) -> tuple[str, ...]:
    """One line for each view and fault that concerns more than 2 % of the lit pixels."""
    lines = []
    for side, share in shares.items():
        if share.saturated_percent > _WORTH_A_WARNING_PERCENT:
            lines.append(f"{side}: {share.saturated_percent:.1f} % of the lit pixels are saturated")
        if share.under_exposed_percent > _WORTH_A_WARNING_PERCENT:
            lines.append(f"{side}: {share.under_exposed_percent:.1f} % of the lit pixels are under-exposed")
    return tuple(lines)
