"""Data on the way from the room into a network's window and back, and the constants used."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats

Singles = NDArray[np.float32]
Indices = NDArray[np.int64]


class Tables(NamedTuple):
    """Constants: how the K joints of a skeleton are the 28 of ``BODY``, and its pose.

    Attributes:
        given: (28,) which joint of the skeleton each of the body's is, or -1.
        taken: (K, 2) the body's joints in whose middle each joint moves; its own twice.
        carried: (K,) the body lacks it: it keeps its place relative to ``taken``.
        rest: (28, 3) the rest pose in the body frame, m.
        nearest: (28, 28) as ``neighbour_table`` gives it.
    """

    given: Indices
    taken: Indices
    carried: Bools
    rest: Floats
    nearest: Indices


class Histories(NamedTuple):
    """Positions (P, T, K, 3) in the room, m, and which were observed (P, T, K)."""

    positions: Floats
    observed: Bools


class Entered(NamedTuple):
    """People in their own frames.

    Attributes:
        window: (P, T, 28, 3) m, filled everywhere.
        observed: (P, T, 28).
        frames: (P, 5) each frame's origin in the room, and the x and y of its y axis, which is
            level.
    """

    window: Singles
    observed: Bools
    frames: Floats
