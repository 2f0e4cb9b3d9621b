"""Names of the array types used by all packages, and fast statistics of small arrays."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
"""Single precision: half the memory, and twice the numbers in each vector instruction."""
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]
"""Indices and counts."""
Stamps = NDArray[np.int64]
"""Nanoseconds."""


def plain_flags(flags: Bools) -> Bools:
    """Flags in the layout that compiled loops need: contiguous and writable."""
    return flags if flags.flags.carray else flags.copy()


def mean_of(values: Floats, axis: int = 0) -> Floats:
    """Mean over one axis, identical to ``numpy.mean`` bit for bit; three times as fast on small
    arrays.
    """
    mean: Floats = np.add.reduce(values, axis) / values.shape[axis]
    return mean


def median(values: Floats) -> float:
    """Median of (N,) numbers, none of them NaN; five times as fast as ``numpy.median``."""
    ordered, count = np.sort(values), len(values)
    return float((ordered[(count - 1) // 2] + ordered[count // 2]) / 2)


def known_median(rows: Floats) -> Floats:
    """Median of each row's numbers; on small arrays ten times as fast as ``numpy.nanmedian``.

    Args:
        rows: (N, M); NaN means unknown.

    Returns:
        (N,); NaN for a row without numbers.
    """
    if not rows.size:
        return np.full(len(rows), np.nan)
    ordered = np.sort(rows, axis=1)  # NaN goes last
    count = np.count_nonzero(~np.isnan(rows), axis=1)
    row = np.arange(len(rows))
    low, high = (
        ordered[row, np.maximum(count - 1, 0) // 2],
        ordered[row, count // 2],
    )
    middle: Floats = (low + high) / 2
    return middle
