"""The Euler angle error of exponential maps, as KD-Former counts it on CMU.

Each joint's map is turned into a quaternion (Dai et al., Eq. 27) and that into the angles of turns
about x, then y, then z (fixed axes); the error of a frame is the length of the difference of all
its angles, the root's included, its translation dropped: 114 columns of 38 joints. Angles are not
unwrapped, so a joint near half a turn may differ by a whole one; the protocol prescribes it.
"""

import numpy as np

from hri_predict.base.arrays import Floats


def euler_error(predicted: Floats, true: Floats) -> Floats:
    """Error of each predicted frame, radians.

    Args:
        predicted: (N, H, J, 3) exponential maps as stored in the benchmark's files, radians.
        true: (N, H, J, 3) the true future.

    Returns:
        (N, H).
    """
    difference = euler_angles(predicted) - euler_angles(true)
    error: Floats = np.sqrt(np.square(difference).sum((-2, -1)))
    return error


def euler_angles(expmaps: Floats) -> Floats:
    """Angles (..., 3) about x, y and z, R = Rz Ry Rx, of exponential maps (..., 3), radians."""
    e = np.asarray(expmaps, dtype=np.float64)
    half = np.linalg.norm(e, axis=-1, keepdims=True) / 2
    w = np.cos(half[..., 0])
    x, y, z = np.moveaxis(np.sinc(half / np.pi) / 2 * e, -1, 0)  # sin(half) / (2 half) e
    about_x = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    about_y = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    about_z = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([about_x, about_y, about_z], -1)
