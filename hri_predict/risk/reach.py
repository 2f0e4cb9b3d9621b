"""What bodies can do: the bounds that no zone needs to exceed, and the cut to them.

Three bounds, each a ball around each joint during each interval: its highest speed from where it
was; its velocity at capture and what that can change by (as the reachable sets of SaRA, S. Pereira,
M. Althoff, "Overapproximative human arm occupancy prediction for collision avoidance", 2018); and
the bones, outwards from the pelvis: a joint is within its bone's length of wherever its parent is.
``HumanLimits`` says where the figures come from.
"""

import numpy as np
from numpy.typing import NDArray

from hri_predict.risk.balls import cut
from hri_predict.risk.settings import HumanLimits
from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import Skeleton

VELOCITY_STEPS = 2
"""Steps of history over which the velocity at capture is taken."""
BONE_FACTOR, BONE_MARGIN_M = 1.1, 0.02
"""A bone may be so much longer than it was seen at capture: joints slip on the body."""


class BodyReach:
    """The bounds for one skeleton.

    Args:
        limits: see ``HumanLimits``.
        skeleton: its joints, tree and parts.
        rate_hz: steps per second of the history.
    """

    def __init__(self, limits: HumanLimits, skeleton: Skeleton, rate_hz: float) -> None:
        part = np.full(len(skeleton.joints), "trunk", dtype=object)
        for kind in ("arm", "leg"):
            for side in ("left", "right"):
                part[list(skeleton.parts.get(f"{side}_{kind}", ()))] = kind
        own = [limits.reach[p] for p in part]
        self._speed = np.array([r.speed_m_s for r in own])
        self._burst = np.array([r.burst_m_s for r in own])
        self._sustained = np.array([r.sustained_m_s2 for r in own])
        self._rate_hz = rate_hz
        self._parents = np.array(skeleton.parents)
        self._bone = np.array(
            [skeleton.reach[j, p] if p >= 0 else np.inf for j, p in enumerate(skeleton.parents)]
        )
        self._generations = _generations(skeleton.parents)

    def velocity(self, history: Floats, observed: Bools) -> tuple[Floats, Bools]:
        """(P, J, 3) velocity at capture, and (P, J) whether both its steps were observed."""
        if history.shape[1] <= VELOCITY_STEPS:
            shape = (len(history), history.shape[2])
            return np.zeros((*shape, 3)), np.zeros(shape, dtype=bool)
        known = observed[:, -1] & observed[:, -1 - VELOCITY_STEPS]
        moved = history[:, -1] - history[:, -1 - VELOCITY_STEPS]
        return np.where(known[..., None], moved, 0.0) * (self._rate_hz / VELOCITY_STEPS), known

    def cut_by_motion(
        self,
        mid: Floats,
        around: Floats,
        last: Floats,
        velocity: tuple[Floats, Bools],
        since: Floats,
        until: Floats,
        joint_age: Floats | None = None,
    ) -> tuple[Floats, Floats]:
        """Cut balls to what speed and acceleration allow.

        Args:
            mid, around: (P, K, J, 3) and (P, K, J), each holding a joint during an interval.
            last: (P, J, 3) where it was last seen.
            velocity: see ``velocity``.
            since, until: (P, K) begin and end of the intervals, seconds after the capture.
            joint_age: (P, J) seconds from when it was seen to the capture; ``None``: in it.
        """
        t = until[..., None]  # (P, K, 1)
        by_speed = self._speed * (t if joint_age is None else t + joint_age[:, None])
        v, known = velocity
        middle = 0.5 * (since + until)[..., None, None]
        half = 0.5 * (until - since)[..., None]
        change = (self._burst + 0.5 * self._sustained * t) * t
        speed = np.sqrt((v**2).sum(-1))[:, None]
        by_velocity = np.where(known[:, None], change + speed * half, np.inf)
        ahead = last[:, None] + v[:, None] * middle
        # Where a ball lies inside both bounds there is nothing to cut, and mostly it does.
        if not _inside(mid, around, last[:, None], by_speed).all():
            mid, around = cut(mid, around, last[:, None], by_speed)
        if not _inside(mid, around, ahead, by_velocity).all():
            mid, around = cut(mid, around, ahead, by_velocity)
        return mid, around

    def cut_by_bones(
        self, mid: Floats, around: Floats, last: Floats, seen: Bools, all_joints: bool = False
    ) -> tuple[Floats, Floats]:
        """Cut balls, from the root outwards, to within a bone's length of the parent's ball.

        Args:
            mid, around: (P, K, J, 3) and (P, K, J).
            last: (P, J, 3) where each joint was at the capture.
            seen: (P, J) whether it was seen in that capture; a bone is as long as seen then, or as
                the longest of anybody.
            all_joints: cut joints that were not seen as well.
        """
        parents = self._parents
        length = np.sqrt(((last - last[:, parents]) ** 2).sum(-1)) * BONE_FACTOR + BONE_MARGIN_M
        both = seen & seen[:, parents]
        longest = np.where(seen | all_joints, self._bone, np.inf)
        bone = np.where(both, length, longest)  # (P, J)
        mid, around = mid.copy(), around.copy()
        for children in self._generations:
            of = parents[children]
            bound = around[:, :, of] + bone[:, None, children]
            if _inside(mid[:, :, children], around[:, :, children], mid[:, :, of], bound).all():
                continue
            mid[:, :, children], around[:, :, children] = cut(
                mid[:, :, children], around[:, :, children], mid[:, :, of], bound
            )
        return mid, around


def _inside(mid: Floats, around: Floats, centre: Floats, radius: Floats) -> Bools:
    """Whether balls lie in other balls."""
    apart = mid - centre
    room = radius - around
    square = apart[..., 0] ** 2 + apart[..., 1] ** 2 + apart[..., 2] ** 2
    result: Bools = (room >= 0) & (square <= room * room)
    return result


def _generations(parents: tuple[int, ...]) -> list[NDArray[np.intp]]:
    """Joints by their distance from the root, the root's children first."""
    depth = [0] * len(parents)
    for j, parent in enumerate(parents):  # parents come before their children, or are found again
        at, steps = parent, 0
        while at >= 0:
            at, steps = parents[at], steps + 1
        depth[j] = steps
    return [
        np.array([j for j, d in enumerate(depth) if d == level], dtype=np.intp)
        for level in range(1, max(depth, default=0) + 1)
    ]
