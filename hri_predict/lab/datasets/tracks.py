"""Recordings as arrays on the trained predictors' skeleton, at the rate they were recorded."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.joint_map import JointMap
from hri_predict.predictors.neural.body import BODY, CMU38, from_canonical
from hri_predict.recording.one_clock import timed
from hri_predict.recording.opening import opened
from hri_predict.recording.recording import Recording

_MAX_GAP_S = 0.1
_CMU_ORDER = ("cmu38", "cmu38_asf")  # maps of the same joints in the same order


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Track:
    """One person of one recording.

    Attributes:
        name: the recording's file name without its ending.
        action: action of the person, see ``Recording.action``.
        stamps_ns: (F,) capture times, strictly increasing; see ``timed``.
        positions: (F, 28, 3) metres, z up, ``BODY`` joints; 0 where not observed.
        observed: (F, 28).
        rate_hz: nominal captures per second.
    """

    name: str
    action: str
    stamps_ns: NDArray[np.int64]
    positions: Floats
    observed: Bools
    rate_hz: float

    @property
    def max_gap_s(self) -> float:
        """Longest time between captures that is bridged, as in the node's ring buffers."""
        return max(_MAX_GAP_S, 2.5 / self.rate_hz)

    @property
    def max_gap_ns(self) -> int:
        """``max_gap_s`` in nanoseconds."""
        return round(1e9 * self.max_gap_s)

    @property
    def period_ns(self) -> int:
        """Nominal time between captures."""
        return round(1e9 / self.rate_hz)

    def only(self, captures: NDArray[np.intp] | slice) -> "Track":
        """Return a track with only these captures."""
        return replace(
            self,
            stamps_ns=self.stamps_ns[captures],
            positions=self.positions[captures],
            observed=self.observed[captures],
        )


def read_tracks(path: Path, joint_map: JointMap | None = None) -> tuple[Track, ...]:
    """Read every person of a recording.

    Joints of a CMU skeleton are taken directly. Joints of any other source go through the canonical
    skeleton, and joints that it lacks are unobserved. ``joint_map`` is the user's own; by default
    it is found by the joints' names.

    Raises:
        RecordingError: the file cannot be read, or its bodies cannot be human.
    """
    return tracks_of(opened(path, joint_map))


def tracks_of(recording: Recording) -> tuple[Track, ...]:
    """Return every person of a recording in memory; see ``read_tracks``."""
    people: dict[int, list[tuple[int, Floats, Bools]]] = {}
    for time_ns, scene in timed(recording):
        for person in scene.people:
            samples = people.setdefault(person.id, [])
            if not samples or time_ns > samples[-1][0]:
                samples.append((time_ns, person.positions, person.observed))
    return tuple(_track(recording, samples) for samples in people.values())


def _track(recording: Recording, samples: list[tuple[int, Floats, Bools]]) -> Track:
    stamps = np.array([s[0] for s in samples], dtype=np.int64)
    positions = np.stack([s[1] for s in samples])
    observed = np.stack([s[2] for s in samples])
    if recording.joint_map.name in _CMU_ORDER:
        body, seen = positions[:, CMU38], observed[:, CMU38]
    else:
        mapped = [recording.joint_map.map(p, o) for p, o in zip(positions, observed, strict=True)]
        body, seen = from_canonical(
            np.stack([m[0] for m in mapped]), np.stack([m[1] for m in mapped])
        )
    seen = seen & np.isfinite(body).all(-1)
    body = np.where(seen[..., None], body, 0.0)
    return Track(
        name=recording.path.stem,
        action=recording.action,
        stamps_ns=stamps,
        positions=body,
        observed=seen,
        rate_hz=recording.rate_hz,
    )


def nearest(stamps: NDArray[np.int64], times: NDArray[np.int64]) -> NDArray[np.intp]:
    """Index of the capture nearest to each time; the earlier of two."""
    after = np.minimum(stamps.searchsorted(times), len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(stamps[after] - times < times - stamps[before], after, before)


@lru_cache(maxsize=1)
def mirrored_joints() -> NDArray[np.intp]:
    """(28,) each joint's counterpart on the other side of the body, or the joint itself."""
    order = np.arange(len(BODY.joints))
    for left, right in BODY.left_right_pairs:
        order[left], order[right] = right, left
    return order
