"""The camera's sensor: electrons, noise, black level, saturation, quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from drivers.simulator.compiled import compiled
from models.capture import Image

Float32Array = npt.NDArray[np.float32]
REFERENCE_EXPOSURE_US = 8333.0


@dataclass(frozen=True)
class Sensor:
    """Settings of both cameras.

    exposure_us, gain_db: both scale the reading from the default exposure (8,333 us, 0 dB). bit_depth: 8 or 12; 12-bit
    images are stored in 16-bit PNGs with white level 4095. full_well: electrons that read as the white level at 0 dB.
    read_noise: rms electrons. black_level: reading without light, in 8-bit grey levels. noiseless: exact images but
    for quantisation.
    """

    exposure_us: float = REFERENCE_EXPOSURE_US
    gain_db: float = 0.0
    bit_depth: Literal[8, 12] = 8
    full_well: float = 10_000.0
    read_noise: float = 8.0
    black_level: float = 1.0
    noiseless: bool = False

    @property
    def white_level(self) -> int:
        return int(2**self.bit_depth - 1)

    @property
    def amplification(self) -> float:
        """Share of the white level that a light of 1 reads."""
        return self.exposure_us / REFERENCE_EXPOSURE_US * float(10 ** (self.gain_db / 20))

    def digitise(self, light: Float32Array, rng: np.random.Generator) -> Image:
        """Readings, uint8 or uint16, of light (H, W): 1 fills the well at the default exposure and reads white at 0 dB.

        Shot noise is drawn from the normal distribution of the same variance: where it would differ from Poisson's,
        below some 50 electrons, read noise hides the difference.
        """
        electrons_per_light = self.full_well * self.exposure_us / REFERENCE_EXPOSURE_US
        level_per_electron = 10 ** (self.gain_db / 20) * self.white_level / self.full_well
        black = self.black_level / 255 * self.white_level
        noise = np.zeros_like(light) if self.noiseless else rng.standard_normal(light.shape, dtype=np.float32)
        out = np.empty(light.shape, np.uint8 if self.bit_depth == 8 else np.uint16)
        _digitise(
            light.ravel(),
            noise.ravel(),
            np.float32(electrons_per_light),
            np.float32(self.full_well),
            np.float32(self.read_noise**2),
            np.float32(level_per_electron),
            np.float32(black),
            np.float32(self.white_level),
            out.ravel(),
        )
        return out


@compiled
def _digitise(
    light: Any, noise: Any, electrons_per_light: Any, well: Any, read_variance: Any, level: Any, black: Any,
    white: Any, out: Any,
) -> None:  # fmt: skip
    for i in range(len(light)):
        electrons = light[i] * electrons_per_light
        electrons = min(electrons + noise[i] * np.sqrt(electrons + read_variance), well)
        reading = black + electrons * level
        out[i] = int(min(max(reading, np.float32(0.0)), white) + np.float32(0.5))
