"""Positions of unseen joints, from the seen ones: a distribution of human postures.

All joints of a body in its own heading frame (z up; y from the right shoulder and hip to the left;
the origin on the floor below the seen trunk) have one multivariate t distribution, with a mean and
a scale matrix. From any set of seen joints, the mean of the others follows by conditioning: C.
Bishop, "Pattern Recognition and Machine Learning" (2006), eq. 2.81 and 2.82. Their scale grows with
the squared Mahalanobis distance d of the M seen coordinates, by (TAIL + d) / (TAIL + M): P. Ding,
"On the conditional distribution of the multivariate t distribution", The American Statistician 70
(2016) 293. The joints of a bending or jumping body are thus less certain than those of a standing
body. The position of the body on the floor is not assumed: the origin has a wide prior.

Postures do not follow a t distribution exactly, so this is only a scale: ``factor`` times the scale
held ``lab.calibration.body_model.HELD`` of the true joints in recordings that were not used for
fitting. A body with seen joints unlike any recorded posture (lying, climbing) is not completed.
"""

import json
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import package_path, read_text
from hri_predict.base.skeleton import JOINTS

FILE = package_path("people", "body", "body_model.json")
NOISE_M = 0.02
"""Standard deviation of each coordinate of a seen joint."""
ORIGIN_M, FLOOR_M = 1.0, 0.03
"""Standard deviations of the origin over the floor, and of the floor's height."""
LEAST_JOINTS = 4
"""Minimum number of seen joints; with fewer, a body is bounded only by its reach."""
TAIL = 8.0
"""Degrees of freedom."""
LEAST_GROWTH = 0.7
"""Minimum growth of the scale: even a posture very near the mean is not more certain than this."""
LEAST_WIDTH_M = 0.1
"""Minimum horizontal distance between both shoulders or hips from which the heading is known."""
_PAIRS = tuple((JOINTS.index(f"l_{n}"), JOINTS.index(f"r_{n}")) for n in ("shoulder", "hip"))
_TRUNK = tuple(
    JOINTS.index(n)
    for n in ("waist", "torso", "neck", "head", "l_shoulder", "r_shoulder", "l_hip", "r_hip")
)
_MOST_KEPT = 256
"""Number of sets of seen joints for which the solution is cached."""


class Completed(NamedTuple):
    """N bodies: positions (N, J, 3) of all joints, their maximum errors (N, J) in metres, and (N,)
    whether the body could be completed."""

    positions: Floats
    within_m: Floats
    usable: Bools


class _Given(NamedTuple):
    """The solution for one set of seen joints, M coordinates."""

    gain: Floats  # (3 J, M)
    within_m: Floats  # (J,) at a growth of 1
    inverse: Floats  # (M, M) of the seen coordinates' covariance


@dataclass(frozen=True, slots=True, eq=False)
class HeadingFrame:
    """Positions and headings of N bodies.

    Attributes:
        origin: (N, 3) on the floor, z 0.
        turn: (N, 3, 3) rotation from the room to the frame.
        exists: (N,) whether a body has a frame.
    """

    origin: Floats
    turn: Floats
    exists: Bools

    @classmethod
    def of(cls, positions: Floats, seen: Bools) -> "HeadingFrame":
        """Return the frames of bodies.

        Args:
            positions: (N, J, 3) metres, finite.
            seen: (N, J) the joints to use.
        """
        across = np.zeros((len(positions), 2))
        for left, right in _PAIRS:
            span = positions[:, left, :2] - positions[:, right, :2]
            width = np.hypot(span[:, 0], span[:, 1])
            there = seen[:, left] & seen[:, right] & (width > LEAST_WIDTH_M)
            across += np.where(there[:, None], span / np.maximum(width, LEAST_WIDTH_M)[:, None], 0)
        size = np.hypot(across[:, 0], across[:, 1])
        weight = seen[:, _TRUNK].astype(np.float64)
        exists = (size > 0.5) & (weight.sum(1) > 0)
        sine, cosine = np.where(exists, across.T / np.maximum(size, 0.5), [[0.0], [1.0]])
        turn = np.zeros((len(positions), 3, 3))  # y is (sine, cosine)
        turn[:, 0, 0] = turn[:, 1, 1] = cosine
        turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = -sine, sine, 1.0
        total = np.einsum("nj,nji->ni", weight, positions[:, _TRUNK])
        origin = total / np.maximum(weight.sum(1), 1.0)[:, None]
        origin[:, 2] = 0.0
        return cls(origin, turn, np.asarray(exists))

    def into(self, positions: Floats) -> Floats:
        """Transform (N, J, 3) from the room to the frames."""
        found: Floats = np.einsum("nik,njk->nji", self.turn, positions - self.origin[:, None])
        return found

    def back(self, positions: Floats) -> Floats:
        """Transform (N, J, 3) from the frames to the room."""
        found: Floats = np.einsum("nki,njk->nji", self.turn, positions) + self.origin[:, None]
        return found


class BodyModel:
    """The distribution of postures.

    Args:
        mean: (J, 3) metres, in the heading frame.
        covariance: (3 J, 3 J) square metres, positive definite.
        factor: (J,) number of scales within which the true joint is.
        most_odd: maximum squared Mahalanobis distance of seen joints from the mean, per coordinate.
    """

    def __init__(
        self, mean: Floats, covariance: Floats, factor: Floats, most_odd: float = np.inf
    ) -> None:
        self.mean, self.factor, self.most_odd = mean, factor, most_odd
        self.covariance = covariance
        self._wide = covariance.copy()
        for axis, deviation in enumerate((ORIGIN_M, ORIGIN_M, FLOOR_M)):
            shift = np.zeros(len(covariance))
            shift[axis::3] = deviation
            self._wide += np.outer(shift, shift)
        self._kept: dict[bytes, _Given] = {}

    def complete(self, positions: Floats, seen: Bools) -> Completed:
        """Return the positions of all joints, computed from the seen ones.

        Args:
            positions: (N, J, 3) metres, finite, in the room: z up, the floor at 0.
            seen: (N, J).
        """
        frame = HeadingFrame.of(positions, seen)
        usable = frame.exists & (seen.sum(1) >= LEAST_JOINTS)
        own = frame.into(positions).reshape(len(positions), -1)
        place = np.broadcast_to(self.mean.reshape(-1), own.shape).copy()
        within = np.zeros(seen.shape)
        rows = np.flatnonzero(usable)
        while rows.size:
            mask = seen[rows[0]]
            alike = (seen[rows] == mask).all(1)
            some, rows = rows[alike], rows[~alike]
            given, of = self._given(mask), np.repeat(mask, 3)
            off = own[some][:, of] - self.mean.reshape(-1)[of]
            size = off.shape[1]
            odd = np.einsum("ni,ij,nj->n", off, given.inverse, off) / size
            usable[some] = odd <= self.most_odd
            growth = np.sqrt((TAIL + odd * size) / (TAIL + size))
            place[some] += off @ given.gain.T
            within[some] = np.maximum(growth, LEAST_GROWTH)[:, None] * given.within_m
        return Completed(frame.back(place.reshape(positions.shape)), within, usable)

    def oddness(self, positions: Floats, seen: Bools) -> Floats:
        """Return (N,) squared Mahalanobis distance per coordinate; NaN where there is no frame."""
        frame = HeadingFrame.of(positions, seen)
        own = frame.into(positions).reshape(len(positions), -1) - self.mean.reshape(-1)
        found = np.full(len(positions), np.nan)
        for row in np.flatnonzero(frame.exists & (seen.sum(1) >= LEAST_JOINTS)):
            of = np.repeat(seen[row], 3)
            off = own[row, of]
            found[row] = off @ self._given(seen[row]).inverse @ off / len(off)
        return found

    def _given(self, mask: Bools) -> _Given:
        key = mask.tobytes()
        found = self._kept.get(key)
        if found is None:
            of = np.repeat(mask, 3)
            across = self._wide[:, of]
            seen = self._wide[np.ix_(of, of)] + NOISE_M**2 * np.eye(int(of.sum()))
            inverse = np.linalg.inv(seen).astype(np.float64)
            gain = across @ inverse
            left = np.diag(self._wide) - np.einsum("im,im->i", gain, across)
            deviation = np.sqrt(np.maximum(left, 0.0).reshape(-1, 3).sum(1))
            found = _Given(gain, deviation * self.factor, inverse)
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            self._kept[key] = found
        return found

    def to_json(self) -> dict[str, Any]:
        """Return lists of numbers; the lower triangle for the covariance."""
        rows = [[float(f"{v:.5g}") for v in row[: i + 1]] for i, row in enumerate(self.covariance)]
        return {
            "joints": list(JOINTS),
            "mean_m": np.round(self.mean, 4).tolist(),
            "covariance_m2": rows,
            "factor": np.round(self.factor, 3).tolist(),
            "most_odd": round(self.most_odd, 3),
        }


@cache
def body_model() -> BodyModel:
    """Return the shipped, fitted model.

    Raises:
        ConfigError: its file is damaged.
    """
    try:
        return _of_json(json.loads(read_text(FILE, "body model")))
    except (ValueError, KeyError, TypeError, IndexError):
        raise ConfigError(f"{FILE}: is damaged; install hri-predict again") from None


def _of_json(data: Any) -> BodyModel:
    size = 3 * len(JOINTS)
    lower = np.zeros((size, size))
    for i, row in enumerate(data["covariance_m2"]):
        lower[i, : i + 1] = row
    mean, factor = np.array(data["mean_m"], np.float64), np.array(data["factor"], np.float64)
    most_odd, covariance = float(data["most_odd"]), lower + np.tril(lower, -1).T
    numbers = np.concatenate([mean.ravel(), factor, covariance.ravel(), [most_odd]])
    if data["joints"] != list(JOINTS) or len(data["covariance_m2"]) != size:
        raise ValueError("made for another skeleton")
    if mean.shape != (len(JOINTS), 3) or factor.shape != (len(JOINTS),) or most_odd <= 0:
        raise ValueError("an array has the wrong shape")
    if not np.isfinite(numbers).all() or (factor <= 0).any():
        raise ValueError("not finite, or a factor that is not above 0")
    np.linalg.cholesky(covariance)  # raises where it is no covariance
    return BodyModel(mean, covariance, factor, most_odd)
