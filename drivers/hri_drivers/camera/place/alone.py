"""Locates a person with one camera, from the landmarks in metres and their pixels."""

import math
from dataclasses import dataclass

import numpy as np

from hri_drivers.camera.place.bones import ADULT_ERROR, ADULT_M, bones_of
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.place.placed import (
    FARTHEST_M,
    MIN_VISIBILITY,
    NEAREST_M,
    SIGMAS_99,
    Placed,
    Unplaced,
)
from hri_drivers.camera.seen import Seen
from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError

MIN_HEIGHT_M, MAX_HEIGHT_M = 1.2, 2.2
WHOLE_ERROR, PART_ERROR = 0.18, 0.45
"""99 % bounds of the scale error if the person's height is known: for a whole body in the image,
and for a body without shoulders or ankles, whose size the network cannot see."""
WHOLE_FROM_M = 2.0, 2.5
"""At shorter distances the image cannot contain a whole body, even if the network reports one."""
BODY_ERROR_M = 0.4
"""99 % bound of the error that does not grow with distance, from joints and nearby bodies."""
MAX_REACH_M = 3.0
"""Maximum distance of a landmark from the hips along one axis."""
MIN_JOINTS = 6
MIN_COSINE = 0.1
"""Cosine of 84 degrees, the maximum angle between a joint and the middle of the body."""
MAX_MISFIT_M = 0.12
"""Maximum root mean square of the landmarks' distances from their rays."""
MAX_ERROR_M = 3.0
HUBER = 1.345  # 95 % as good as least squares if all errors are normal
LEAST_MISFIT_M = 0.005
_ROUNDS = 5


def place_alone(seen: Seen, camera: Camera, height_m: float | None = None) -> Placed | Unplaced:
    """Place a person by the pixels and the metric landmarks of one image.

    A network receives a crop of the image without its position. Its metric landmarks therefore have
    the axes of a camera that looks straight at the person, so they are first rotated according to
    the ray to the middle of the hips. With the rotation known, the position t follows from linear
    least squares: a landmark (X, Y, Z) that is seen along the ray (x, y, 1) has X + tx = x (Z + tz)
    and Y + ty = y (Z + tz). Errors of the landmarks in metres are on the left, where least squares
    expect them. Outliers are down-weighted (P. Huber, "Robust Statistics", 1981).

    In one image a tall person far away looks like a short person nearby. The network draws every
    person as an adult of common size, so the landmarks are scaled to the person's stature if the
    stature is known. docs/measured/camera-place.md describes how the errors were measured.

    Args:
        seen: the person.
        camera: camera for images of this size (``Camera.of_size``).
        height_m: stature of all people in the image, in shoes; None: adults.

    Raises:
        ConfigError: the network gives no landmarks in metres, or no person is so tall.
    """
    check_height(height_m)
    if seen.world is None:
        raise ConfigError(
            "this network finds joints in the image only, which does not give the distance to a "
            "person: use one with landmarks in metres, a depth camera, or two cameras"
        )
    used = (
        (seen.visibility >= MIN_VISIBILITY)
        & camera.inside(seen.pixels)
        & (np.abs(seen.world) <= MAX_REACH_M).all(axis=1)  # never where it is NaN
    )
    rays = camera.rays(seen.pixels)
    used &= np.isfinite(rays).all(axis=1)
    world = np.where(used[:, None], seen.world, np.nan)
    if np.count_nonzero(used) < MIN_JOINTS:
        return Unplaced("too few visible joints")
    bones = bones_of(seen.layout)
    scale = 1.0 if height_m is None else height_m / ADULT_M
    whole = used[list(bones.shoulders)].any() and used[list(bones.ankles)].any()
    other = math.hypot(ADULT_ERROR if height_m is None else 0.0, camera.focal_error)
    turned = _toward(_middle(rays, used, bones.hips))
    place = _fitted(world * scale, rays, used, turned)
    if isinstance(place, Unplaced):
        return place
    error_m = _stated(place, is_whole=bool(whole), other=other)
    if error_m > MAX_ERROR_M:
        return Unplaced("place too uncertain")
    return Placed(np.where(used[:, None], place.points, np.nan), used, error_m)


def check_height(height_m: float | None) -> None:
    """Refuse a stature that is not a person's.

    Raises:
        ConfigError: the stature is too small or too large.
    """
    if height_m is not None and not MIN_HEIGHT_M <= height_m <= MAX_HEIGHT_M:
        raise ConfigError(
            f"height: must be {MIN_HEIGHT_M:g} to {MAX_HEIGHT_M:g} metres; got {height_m:g}"
        )


def _middle(rays: Floats, used: Bools, hips: tuple[int, int]) -> Floats:
    """Return (3,) the ray at which the network's cut-out is centred."""
    ends = rays[list(hips)]
    middle = ends.mean(axis=0) if np.isfinite(ends).all() else rays[used].mean(axis=0)
    return np.append(middle, 1.0)


def _toward(ray: Floats) -> Floats:
    """Return (3, 3) the smallest rotation that carries the z axis to ``ray``."""
    z = ray / np.linalg.norm(ray)
    axis = np.array([-z[1], z[0], 0.0])  # z axis x ray
    skew = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation: Floats = np.eye(3) + skew + skew @ skew / (1.0 + z[2])
    return rotation


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A body at the position that fits its pixels best.

    Attributes:
        points: (J, 3) metres, camera.
        spread_m: standard deviation of the place along the ray, by the misfit.
    """

    points: Floats
    distance: float
    spread_m: float


def _fitted(body: Floats, rays: Floats, used: Bools, turned: Floats) -> _Fit | Unplaced:
    """Fit the place of ``body`` (J, 3), metres around its hips, to the ``rays`` (J, 2).

    Args:
        used: (J,) which joints to use.
        turned: (3, 3) from the body's axes to the camera's.
    """
    seen_from = np.column_stack([rays, np.ones(len(rays))]) @ turned  # in the body's axes
    if not (seen_from[used, 2] > MIN_COSINE).all():
        return Unplaced("landmarks and pixels disagree")
    flat = seen_from[:, :2] / seen_from[:, 2:]
    place, spread, misfit = _least_squares(body[used], flat[used])
    distance = float(np.linalg.norm(place))
    depth = body[:, 2] + place[2]
    if not (misfit <= MAX_MISFIT_M and (depth[used] > 0).all()):
        return Unplaced("landmarks and pixels disagree")
    if not NEAREST_M <= distance <= FARTHEST_M:
        return Unplaced(f"not between {NEAREST_M:g} and {FARTHEST_M:g} m away")
    points = np.column_stack([flat * depth[:, None], depth]) @ turned.T
    return _Fit(points, distance, spread)


def _stated(fit: _Fit, *, is_whole: bool, other: float) -> float:
    """Return the 99 % bound in metres of a position error.

    Args:
        is_whole: shoulders and ankles were seen.
        other: 99 % bound of the scale error due to camera and stature.
    """
    whole = float(np.interp(fit.distance, WHOLE_FROM_M, (PART_ERROR, WHOLE_ERROR)))
    share = math.hypot(whole if is_whole else PART_ERROR, other)
    return math.hypot(fit.distance * share, SIGMAS_99 * fit.spread_m, BODY_ERROR_M)


def _least_squares(body: Floats, flat: Floats) -> tuple[Floats, float, float]:
    """Return the place (3,) of ``body`` (N, 3) seen at ``flat`` (N, 2), x / z and y / z.

    Also the standard deviation of the place along the ray, and the root mean square of the misfit
    per axis, both in metres.
    """
    n = len(body)
    a = np.zeros((2 * n, 3))
    a[:n, 0] = a[n:, 1] = 1.0
    a[:, 2] = -flat.T.ravel()
    b = (flat * body[:, 2:] - body[:, :2]).T.ravel()
    weights = np.ones(2 * n)
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        place, *_ = np.linalg.lstsq(a * root[:, None], b * root, rcond=None)
        off = np.abs(a @ place - b)
        knee = max(HUBER * 1.48 * float(np.median(off)), LEAST_MISFIT_M)
        weights = np.minimum(1.0, knee / np.maximum(off, 1e-9))
    misfit = math.sqrt(float(weights @ off**2) / max(2 * n - 3, 1))
    parts = np.split(flat.T.ravel(), 2), np.split(weights, 2)
    extent = sum(float(w @ (x - w @ x / w.sum()) ** 2) for x, w in zip(*parts, strict=True))
    spread = misfit / math.sqrt(extent) if extent > 0 else math.inf
    return np.asarray(place, np.float64), spread, misfit
