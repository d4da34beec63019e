"""The ridge of a wavelet transform: at each pixel the atom that answers most, and what lies between the atoms."""

from __future__ import annotations

import torch


def ridge(coefficients: torch.Tensor) -> torch.Tensor:
    """Coefficient at the ridge, complex64 (..., H, W), of coefficients (..., R, T, H, W) over two parameters.

    The largest modulus is looked for among the atoms, and along each parameter of at least three atoms its
    peak by a parabola through three neighbours, which then interpolates the coefficient itself.
    """
    count = coefficients.shape[-4:-2]
    atoms = coefficients.flatten(-4, -3)
    modulus = atoms.abs()
    best = modulus.max(dim=-3, keepdim=True).indices
    place = (best // count[1], best % count[1])
    peak = torch.gather(atoms, -3, best)
    total = peak
    for axis, step in ((0, count[1]), (1, 1)):
        if count[axis] < 3:
            continue
        middle = place[axis].clamp(1, count[axis] - 2)
        index = best + (middle - place[axis]) * step
        before, here, after = (torch.gather(atoms, -3, index + step * k) for k in (-1, 0, 1))
        offset = _peak(before.abs(), here.abs(), after.abs(), place[axis] - middle)
        slope, bend = 0.5 * (after - before), 0.5 * (after + before) - here
        total = total + (here + offset * slope + offset**2 * bend - peak)
    return total.squeeze(-3)


def _peak(before: torch.Tensor, here: torch.Tensor, after: torch.Tensor, largest: torch.Tensor) -> torch.Tensor:
    """Where the parabola through values at -1, 0 and 1 peaks, within that; without a peak, where the largest is."""
    bend = before + after - 2 * here
    inside = (0.5 * (before - after) / bend.clamp(max=-1e-20)).clamp(-1, 1)
    return torch.where(bend < 0, inside, largest.to(here.dtype))
