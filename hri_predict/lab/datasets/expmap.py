"""Joint positions from exponential maps, the form of poses in the benchmarks' files.

The stored vector of a joint is minus its rotation vector: R_j = Rodrigues(-e_j), columns taking the
joint's axes to its parent's (the published code writes the transpose, for row vectors).
"""

from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Floats


def rotation_matrices(vectors: Floats) -> Floats:
    """Rodrigues' formula: rotation vectors (..., 3), radians, to matrices (..., 3, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    cross = cross.reshape(*vectors.shape, 3)
    sine = np.sinc(angle / np.pi)  # sin(a) / a, 1 at 0
    cosine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2  # (1 - cos(a)) / a^2
    result: Floats = np.eye(3) + sine * cross + cosine * (cross @ cross)
    return result


def joint_positions(expmaps: Floats, parents: Sequence[int], offsets: Floats) -> Floats:
    """Positions in the frame of a root that neither turns nor moves.

    Args:
        expmaps: (F, J, 3) as stored, radians; the root's is ignored.
        parents: parent of each joint, which comes before it; -1 for the root.
        offsets: (J, 3) bone vectors; the result has their unit.

    Returns:
        (F, J, 3).
    """
    local = rotation_matrices(-np.asarray(expmaps, dtype=np.float64))
    turned = np.empty_like(local)
    positions = np.zeros(expmaps.shape)
    for joint, parent in enumerate(parents):
        if parent < 0:
            turned[:, joint] = np.eye(3)
            continue
        turned[:, joint] = turned[:, parent] @ local[:, joint]
        positions[:, joint] = positions[:, parent] + turned[:, parent] @ offsets[joint]
    return positions
