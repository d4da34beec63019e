"""The absolute column is right or absent: blur, noise, flipped bits and mixed pixels never give another fringe."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from ideal_camera import fringe_steps, gray_planes, shown

from models.phase.absolute_column import absolute_column
from models.phase.gray_code import decode_gray
from models.phase.phase_shift import demodulate

WIDTH = 912.0
STEPS = (9, 14)
PERIODS = (9.0, 14.0)


class Scan:
    """Reference exposures at projector columns (1, n), as recorded, to be decoded after whatever befalls them."""

    def __init__(
        self,
        column: np.ndarray,
        *,
        noise: float = 0.0,
        blur: float = 0.0,
        periods: tuple[float, ...] = PERIODS,
        steps: tuple[int, ...] = STEPS,
        gray: tuple[int, float] = (7, 9.0),
        seed: int = 0,
    ) -> None:
        self.periods, self.steps, self.gray_period = periods, steps, gray[1]
        self.fringes = [fringe_steps(n, p) for n, p in zip(steps, periods, strict=True)]
        rng = np.random.default_rng(seed)

        def see(patterns: list, blurred: float = blur) -> torch.Tensor:  # type: ignore[type-arg]
            clean = shown(patterns, column, 0.6, 0.05, blurred)
            return clean + torch.from_numpy(rng.normal(0, noise, clean.shape).astype(np.float32))

        self.stacks = [see(fringe) for fringe in self.fringes]
        self.planes = see(gray_planes(*gray))
        self.white, self.black = torch.full(column.shape, 0.65), torch.full(column.shape, 0.05)

    def decode(self) -> np.ndarray:
        carriers = torch.stack([demodulate(s, f) for s, f in zip(self.stacks, self.fringes, strict=True)])
        code = decode_gray(self.planes, white=self.white, black=self.black)
        return absolute_column(carriers, self.periods, self.steps, code, self.gray_period).numpy()


@given(
    start=st.floats(0.0, WIDTH - 42),
    noise=st.floats(0.0, 0.02),
    blur=st.floats(0.0, 1.4),
    seed=st.integers(0, 1000),
)
def test_columns_are_right_or_absent(start: float, noise: float, blur: float, seed: int) -> None:
    column = start + np.linspace(0, 40, 161)[None]
    found = Scan(column, noise=noise, blur=blur, seed=seed).decode()
    settled = np.isfinite(found)
    assert np.abs(found - column)[settled].max() < 0.05 + 12 * noise
    assert settled.mean() > 0.9


def test_every_column_of_a_clean_scan_is_found() -> None:
    column = np.linspace(0.0, WIDTH - 1, 20_000)[None]
    assert np.abs(Scan(column, blur=0.7).decode() - column).max() < 2e-3


def test_fusing_the_low_carrier_lowers_the_noise() -> None:
    column = np.linspace(20, 900, 30_000)[None]
    both = Scan(column, noise=0.01)
    high_only = Scan(column, noise=0.01, periods=PERIODS[:1], steps=STEPS[:1])
    errors = [np.nanstd(scan.decode() - column) for scan in (both, high_only)]
    # variances of the columns are (period / modulation)^2 / steps, so fusing divides by 1 + (14 / 9) (9 / 14)^2
    assert errors[0] / errors[1] == pytest.approx((1 + (14 / 9) * (9 / 14) ** 2) ** -0.5, rel=0.03)


@pytest.mark.parametrize("bit", range(7))
def test_a_flipped_plane_is_refused(bit: int) -> None:
    """Only where the columns differ by a common period of both carriers (126) can the phases not tell."""
    column = np.linspace(5, 905, 3001)[None]
    scan = Scan(column, blur=0.7)
    scan.planes[bit] = 0.70 - scan.planes[bit]
    found = scan.decode()
    off = np.abs(found - column)
    wrong = off > 1
    assert np.isfinite(found).mean() < 0.15
    assert wrong.mean() < 0.04
    assert (np.abs(off - 126 * np.round(off / 126))[wrong] < 0.1).all()
    if bit > 3:  # such a bit moves the word by less than 14 fringes
        assert not wrong.any()


def test_mixed_pixels_are_refused() -> None:
    """A pixel that sees two surfaces adds their light; the fraction is swept, the columns lie far apart."""
    rng = np.random.default_rng(1)
    near, far = rng.uniform(20, 880, (2, 1, 4000))
    far = np.where(np.abs(near - far) < 12, near + 40, far)
    share = rng.uniform(0.3, 0.7, near.shape).astype(np.float32)
    scan, other = Scan(near, blur=0.7), Scan(far, blur=0.7)
    weight = torch.from_numpy(share)
    scan.stacks = [weight * a + (1 - weight) * b for a, b in zip(scan.stacks, other.stacks, strict=True)]
    scan.planes = weight * scan.planes + (1 - weight) * other.planes
    found = scan.decode()
    off = np.minimum(np.abs(found - near), np.abs(found - far))
    assert np.isfinite(found).mean() < 0.25
    assert (off > 4.5).mean() < 0.01  # another fringe than either surface shows


@given(start=st.floats(0.0, 980.0), noise=st.floats(0.0, 0.01), blur=st.floats(0.0, 2.0), seed=st.integers(0, 1000))
def test_words_of_half_a_fringe_settle_a_single_carrier(start: float, noise: float, blur: float, seed: int) -> None:
    """The complementary bit: Gray words one bit finer than the fringe, no second carrier."""
    column = start + np.linspace(0, 40, 161)[None]
    scan = Scan(column, noise=noise, blur=blur, periods=(32.0,), steps=(4,), gray=(6, 16.0), seed=seed)
    found = scan.decode()
    settled = np.isfinite(found)
    assert np.abs(found - column)[settled].max() < 0.2 + 60 * noise
    assert settled.mean() > 0.9


def test_one_carrier_with_words_of_a_whole_fringe_leaves_edges_open() -> None:
    column = np.linspace(5, 905, 9001)[None]
    found = Scan(column, blur=0.7, periods=(9.0,), steps=(9,)).decode()
    settled = np.isfinite(found)
    assert np.abs(found - column)[settled].max() < 0.05
    assert 0.6 < settled.mean() < 1.0


def test_unlit_pixels_have_no_column() -> None:
    scan = Scan(np.full((1, 50), 100.0))
    scan.planes[:] = 0.05
    scan.white = scan.black
    assert np.isnan(scan.decode()).all()
