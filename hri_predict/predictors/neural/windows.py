"""Data passed from the room to a network's window and back, and its constants."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats

Singles = NDArray[np.float32]
Indices = NDArray[np.int64]


class Tables(NamedTuple):
    """Constants that map the K joints of a skeleton to the 28 of ``BODY``, and the rest pose.

    Attributes:
        given: (28,) the skeleton's joint for each joint of ``BODY``, or -1.
        taken: (K, 2) the pair of ``BODY``'s joints whose midpoint each joint follows; its own joint
            twice if ``BODY`` has it.
        carried: (K,) true where ``BODY`` lacks the joint: it keeps its place relative to ``taken``.
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
        frames: (P, 5) each frame's origin in the room, and x and y of its y axis, which is
            horizontal.
    """

    window: Singles
    observed: Bools
    frames: Floats
