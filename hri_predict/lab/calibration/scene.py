"""Zones around a recorded person beside a robot at some moments, and the views for pictures.

The choice of windows does not depend on any forecast: of the windows with a known next second in
each action's longest recording, it is the middle one. Zones are built as the node builds them, from
the recording's first window on, so that the self-check has seen what came before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.calibration.coverage import Calibrated, forecast_of, run_zones, snapshot_of
from hri_predict.lab.calibration.scores import Scores
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.trajectory import load_trajectory
from hri_predict.zones.body_zones import ZoneBuilder
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import CoverageSettings, HumanLimits

SHOWN_MS = (0, 200, 400, 600, 1000)
BALL_M_S = 1.6
"""The standard's walking speed: the growth of the outline drawn for scale."""
ROBOT, TRAJECTORY, ROBOT_PHASE_S = "ur5e", "pick_and_place", 1.4
"""The robot beside the person, its trajectory, and its phase at the start, in mid-swing."""
_AHEAD_M, _LEFT_M, _TABLE_M = 0.4, 1.25, 0.75
"""Position of the robot, ahead and to the left of the person after 1 s, and its table's height."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ZoneScene:
    """One window and the zones that follow from it. K moments, J joints, S segments.

    Attributes:
        recording, action: origin of the window.
        time_s: after the recording's first capture.
        shown_ms: (K,) moments within the horizon.
        true, known: (K, J, 3) metres and (K, J), at the captures nearest to those moments.
        forecast: (K, J, 3) metres; at 0 ms the body as captured.
        zones: (K, S) capsules.
        widened: whether the self-check widened the zones, or physical limits replaced them.
    """

    recording: str
    action: str
    time_s: float
    shown_ms: tuple[int, ...]
    true: Floats
    known: Bools
    forecast: Floats
    zones: Capsules
    widened: bool


def middle_window(scores: Sequence[Scores], action: str) -> tuple[Scores, int] | None:
    """The middle window with a known next second in an action's longest recording.

    ``None`` without such a window.
    """
    found = [(s, _whole(s)) for s in scores if s.action == action]
    entry, windows = max(found, key=lambda pair: len(pair[1]), default=(None, np.zeros(0)))
    if entry is None or not len(windows):
        return None
    return entry, int(windows[len(windows) // 2])


def _whole(entry: Scores) -> Any:
    """Windows with a second of truth ahead."""
    ends = entry.truth.stamps_ns[-1]
    return np.flatnonzero(entry.origin_ns + SHOWN_MS[-1] * 1_000_000 <= ends)


def zone_scene(
    entry: Scores, window: int, calibrated: Calibrated, settings: CoverageSettings
) -> ZoneScene:
    """The zones of one window, as run."""
    predictor, calibration = calibrated
    _, trust = run_zones(entry.only(slice(window + 1)), calibrated, settings)[-1]
    steps, rate_hz = entry.forecast.shape[1], predictor.rate_hz
    radii = Radii(calibration, settings, predictor.skeleton, steps)
    builder = ZoneBuilder(
        skeleton=predictor.skeleton,
        absent_parts=(),
        limits=HumanLimits(),
        rate_hz=rate_hz,
        horizon_steps=steps,
        radii=radii,
        with_paths=False,
    )
    forecast = forecast_of(entry, window)
    snapshot = snapshot_of(entry, window, predictor.history_steps)
    body = builder.build(snapshot, forecast, trust=trust)
    capsules = body.zones.capsules
    shown = tuple(ms for ms in SHOWN_MS if round(ms * rate_hz / 1000) <= steps)
    at = [round(ms * rate_hz / 1000) for ms in shown]
    stamps = entry.truth.stamps_ns
    captures = [_nearest(stamps, int(entry.origin_ns[window]) + ms * 1_000_000) for ms in shown]
    path = np.concatenate([entry.truth.positions[captures[0]][None], entry.forecast[window]])
    return ZoneScene(
        recording=entry.name,
        action=entry.action,
        time_s=float(entry.origin_ns[window] - stamps[0]) * 1e-9,
        shown_ms=shown,
        true=entry.truth.positions[captures],
        known=entry.truth.observed[captures],
        forecast=path[at],
        zones=capsules[0, at],
        widened=bool(trust.widened.any() or trust.out_of_distribution.any()),
    )


def _nearest(stamps: Any, wanted_ns: int) -> int:
    return int(np.abs(stamps - wanted_ns).argmin())


# -- projection ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """A parallel projection along the third direction.

    Attributes:
        origin: (3,) metres, at (0, 0) of the picture.
        across, up: (3,) unit vectors, at a right angle: the picture's directions in the room.
    """

    origin: Floats
    across: Floats
    up: Floats

    def project(self, points: Floats) -> Floats:
        """(..., 3) metres in the room to (..., 2) metres in the picture."""
        moved = points - self.origin
        return np.stack([moved @ self.across, moved @ self.up], axis=-1)


def outside(points: Floats, view: Projection, capsules: Capsules) -> Floats:
    """Signed distance in the picture from the silhouette of capsules (S,): below 0 inside it.

    A ball's parallel projection is a disc, so a capsule's is a stadium: all points within its
    radius of the projected segment.

    Args:
        points: (..., 2) metres in the picture.
    """
    a, b = view.project(capsules.a), view.project(capsules.b)
    result = np.full(points.shape[:-1], np.inf)
    for start, end, radius in zip(a, b, capsules.radius, strict=True):
        along, to = end - start, points - start
        square = float(along @ along)
        part = np.clip(to @ along / square, 0.0, 1.0) if square > 0 else np.zeros(to.shape[:-1])
        gap = to - part[..., None] * along
        np.minimum(result, np.hypot(gap[..., 0], gap[..., 1]) - radius, out=result)
    return result


def views(scene: ZoneScene, skeleton: Skeleton) -> tuple[Projection, Projection]:
    """From the person's right, and from above: both with *ahead* to the right of the picture."""
    now, seen = scene.true[0], scene.known[0]
    sides = [
        np.array([n.startswith(prefix) for n in skeleton.joints]) & seen for prefix in ("l_", "r_")
    ]
    heading = 0.0
    if all(own.any() for own in sides):
        left = now[sides[0]].mean(0) - now[sides[1]].mean(0)
        heading = float(np.arctan2(-left[0], left[1]))
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    to_left = np.array([-np.sin(heading), np.cos(heading), 0.0])
    origin = now[seen].mean(0)
    feet = scene.known & np.array([n.endswith(("ankle", "foot")) for n in skeleton.joints])
    origin[2] = scene.true[feet][:, 2].min() if feet.any() else 0.0
    return Projection(origin, ahead, np.array([0.0, 0.0, 1.0])), Projection(origin, ahead, to_left)


def robot_beside(scene: ZoneScene, side: Projection, above: Projection) -> Capsules:
    """(K, C) capsules of a robot on its trajectory; the constants give robot and place."""
    known = scene.known[-1]
    there = scene.true[-1][known].mean(0) if known.any() else side.origin
    base = there + _AHEAD_M * side.across + _LEFT_M * above.up
    base[2] = side.origin[2] + _TABLE_M
    turn = np.arctan2(-above.up[1], -above.up[0])  # it works towards the person's way
    quaternion = [0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2))]
    pose = Pose(xyz=[float(v) for v in base], quaternion_xyzw=quaternion)
    settings = RobotSettings(name=ROBOT, model=ROBOT, room_from_robot=pose, max_speed_m_s=1.0)
    model = load_robot(settings, None)
    trajectory = load_trajectory(TRAJECTORY, model, None)
    q, _ = trajectory.at(ROBOT_PHASE_S + 1e-3 * np.asarray(scene.shown_ms))
    return model.capsules(q)
