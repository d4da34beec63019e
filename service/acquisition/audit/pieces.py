"""Matrix products over pixels in pieces that BLAS computes in the calling thread.

A few million multiplications take a millisecond; waking a pool of threads for them takes a hundred on a busy machine.
Source of the limit: OpenBLAS, interface/gemm.c, 4 * 65536 multiplications.
"""

from __future__ import annotations

import numpy as np

from service.acquisition.audit.axes import FloatArray, IntArray

_IN_ONE_THREAD = 4 * 65536


def map_pixels(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """matrix (M, K) @ values (K, P)."""
    length = _length(matrix.size)
    out = np.empty((len(matrix), values.shape[1]), np.result_type(matrix, values))
    whole = values.shape[1] // length * length
    pieces = values[:, :whole].reshape(len(values), -1, length).transpose(1, 0, 2)
    out[:, :whole] = np.matmul(matrix, pieces).transpose(1, 0, 2).reshape(len(matrix), -1)
    out[:, whole:] = matrix @ values[:, whole:]
    return out


def map_pixels_transposed(values: FloatArray, matrix: FloatArray) -> FloatArray:
    """values (K, P) transposed @ matrix (K, M): (P, M), the layout in which a best column is found fast."""
    length = _length(matrix.size)
    out = np.empty((values.shape[1], matrix.shape[1]), np.result_type(matrix, values))
    whole = values.shape[1] // length * length
    pieces = values[:, :whole].reshape(len(values), -1, length).transpose(1, 2, 0)
    np.matmul(pieces, matrix, out=out[:whole].reshape(-1, length, matrix.shape[1]))
    out[whole:] = values[:, whole:].T @ matrix
    return out


def sum_pixels(first: FloatArray, second: FloatArray) -> tuple[FloatArray, IntArray]:
    """Partial sums of first (N, P) @ second (M, P) transposed: (pieces, N, M), and the pixel at which each begins.

    Fewer pixels than a piece at the end are left out.
    """
    length = min(_length(len(first) * len(second)), first.shape[1])
    count = first.shape[1] // length
    left, right = (a[:, : count * length].reshape(len(a), count, length).transpose(1, 0, 2) for a in (first, second))
    return np.matmul(left, right.transpose(0, 2, 1)), np.arange(count) * length


def _length(other: int) -> int:
    return max(16, _IN_ONE_THREAD // (other + 1))
