"""Sizes of zones: volumes of the body's segments, by method.

Every method is applied to the same windows: calibrated zones as run, balls that grow at the
standard's speeds (1.6 and 2 m/s) from where the body was seen, and the limits of what bodies can
do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.calibration.coverage import Calibrated, run_zones
from hri_predict.lab.calibration.scores import Scores
from hri_predict.zones.reach import BodyReach
from hri_predict.zones.settings import CoverageSettings, HumanLimits

BALLS_M_S = (1.6, 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """Mean volumes in cubic metres. K horizons, B body parts.

    Attributes:
        parts: names of the body parts.
        steps: (K,) horizon steps.
        by_method: method -> (K, B) mean volume of a part's zones over all windows, summed over its
            segments.
        windows: number of windows.
    """

    parts: tuple[str, ...]
    steps: tuple[int, ...]
    by_method: Mapping[str, Floats]
    windows: int

    def relative(self, method: str, to: str) -> Floats:
        """(K, B + 1) a method's volume relative to another's, the whole body last; NaN if empty."""
        own, other = (_with_body(self.by_method[m]) for m in (method, to))
        return np.divide(own, other, out=np.full_like(own, np.nan), where=other > 0)


def _with_body(volumes: Floats) -> Floats:
    return np.concatenate([volumes, volumes.sum(1, keepdims=True)], axis=1)


def measure_sizes(
    scores: Sequence[Scores],
    methods: Mapping[str, tuple[Sequence[Scores], Calibrated]],
    settings: CoverageSettings,
    steps: Sequence[int],
) -> Sizes:
    """Volumes around the windows of ``scores``.

    Args:
        scores: give the windows; segments with an unseen joint do not count.
        methods: name -> a predictor's scores of the same recordings, and itself, calibrated.
        settings: level and question; with or without the self-check.
        steps: horizon steps.
    """
    (_, first), *_ = methods.values()
    skeleton, rate_hz = first.predictor.skeleton, first.predictor.rate_hz
    reach = BodyReach.of(HumanLimits(), skeleton, rate_hz)
    sums: dict[str, Floats] = {}
    counts = np.zeros(len(skeleton.segments))
    for index, entry in enumerate(scores):
        seen = _whole_segments(entry, skeleton)  # (W, S)
        counts += seen.sum(0)
        centre = np.repeat(entry.history[:, -1:], len(steps), axis=1)
        spheres = {}
        for speed in BALLS_M_S:
            grown = speed * np.asarray(steps)[:, None] / rate_hz
            spheres[f"{speed:g} m/s"] = centre, np.broadcast_to(grown, centre.shape[:3])
        spheres["physical reach"] = _reached(entry, reach, steps, rate_hz)
        for name, (own, calibrated) in methods.items():
            run = [ball for ball, _ in run_zones(own[index], calibrated, settings)]
            spheres[name] = (
                np.stack([ball.mid[0][list(steps)] for ball in run]),
                np.stack([ball.radius[0][list(steps)] for ball in run]),
            )
        for name, (mid, radius) in spheres.items():
            volumes = np.where(seen[:, None], _volumes(mid, radius, skeleton), 0.0)
            sums[name] = sums.get(name, 0.0) + volumes.sum(0)
    mean = {m: total / np.maximum(counts, 1) for m, total in sums.items()}
    parts = tuple(dict.fromkeys(s.part for s in skeleton.segments))
    of = np.array([parts.index(s.part) for s in skeleton.segments])
    by_part = {
        m: np.stack([v[:, of == b].sum(1) for b in range(len(parts))], axis=1)
        for m, v in mean.items()
    }
    return Sizes(parts, tuple(steps), by_part, sum(len(s.origin_ns) for s in scores))


def _reached(
    entry: Scores, reach: BodyReach, steps: Sequence[int], rate_hz: float
) -> tuple[Floats, Floats]:
    """The limits of what bodies can do by each step: unbounded spheres, cut."""
    last = entry.history[:, -1]
    until = np.repeat(np.asarray(steps, float)[None] / rate_hz, len(last), axis=0)
    shape = (len(last), len(steps), last.shape[1])
    mid = np.broadcast_to(last[:, None], (*shape, 3))
    velocity = reach.velocity(entry.history, entry.observed)
    mid, radius = reach.cut_by_motion(
        mid,
        np.full(shape, 1e6),
        last=last,
        velocity=velocity,
        since=until - 1 / rate_hz,
        until=until,
    )
    return reach.cut_by_bones(mid, radius, last=last, seen=entry.observed[:, -1])


def _whole_segments(entry: Scores, skeleton: Skeleton) -> Bools:
    """(W, S) whether both ends were seen."""
    now = entry.observed[:, -1]
    ends = np.array([(s.joint_a, s.joint_b) for s in skeleton.segments])
    result: Bools = now[:, ends[:, 0]] & now[:, ends[:, 1]]
    return result


def _volumes(centre: Floats, radius: Floats, skeleton: Skeleton) -> Floats:
    """(W, K, S) of every segment's capsule."""
    ends = np.array([(s.joint_a, s.joint_b) for s in skeleton.segments])
    own = np.array([s.radius for s in skeleton.segments])
    length = np.linalg.norm(centre[:, :, ends[:, 0]] - centre[:, :, ends[:, 1]], axis=-1)
    r = np.maximum(radius[:, :, ends[:, 0]], radius[:, :, ends[:, 1]]) + own
    return capsule_volume(length, r)


def capsule_volume(length: Floats, radius: Floats) -> Floats:
    """Volume of a capsule, pi r^2 l + 4/3 pi r^3, cubic metres."""
    result: Floats = np.pi * radius**2 * (length + 4.0 / 3.0 * radius)
    return result
