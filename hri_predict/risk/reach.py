"""What bodies can do: the bounds that no zone needs to exceed, and the cut to them.

Three bounds, each a ball around each joint during each interval: its highest speed from where it
was; its velocity at capture and what that can change by (as the reachable sets of SaRA, S. Pereira,
M. Althoff, "Overapproximative human arm occupancy prediction for collision avoidance", 2018); and
the bones, outwards from the pelvis: a joint is within its bone's length of wherever its parent is.
``HumanLimits`` says where the figures come from.
"""

import numpy as np
from numpy.typing import NDArray

from hri_predict.risk.balls import along, cut
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
        mid, around = _cut_outside(mid, around, last[:, None], by_speed)
        return _cut_outside(mid, around, ahead, by_velocity)

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
        # Coordinates and joints first: a generation is then long rows of numbers.
        centre = mid.transpose(3, 2, 0, 1).copy()  # (3, J, P, K)
        radius = around.transpose(2, 0, 1).copy()
        bones = bone.T[..., None]
        for children in self._generations:
            of = parents[children]
            own, bound = radius[children], radius[of] + bones[children]
            apart = centre[:, of] - centre[:, children]
            square = np.einsum("i...,i...->...", apart, apart)
            if _inside(square, own, bound).all():
                continue
            part, radius[children] = along(np.sqrt(square), own, bound)
            apart *= part
            centre[:, children] += apart
        return centre.transpose(2, 3, 1, 0), radius.transpose(1, 2, 0)


def _inside(square: Floats, radius: Floats, bound: Floats) -> Bools:
    """Whether balls lie in other balls, of that squared distance of the centres."""
    room = bound - radius
    result: Bools = (room >= 0) & (square <= room * room)
    return result


def _cut_outside(
    mid: Floats, around: Floats, centre: Floats, radius: Floats
) -> tuple[Floats, Floats]:
    """``cut`` where a ball does not lie in the other anyway, which mostly it does."""
    apart = mid - centre
    outside = ~_inside(np.einsum("...i,...i->...", apart, apart), around, radius)
    some = np.nonzero(outside)
    if not len(some[0]):
        return mid, around
    mid, around = mid.copy(), around.copy()
    other, bound = np.broadcast_to(centre, mid.shape)[some], np.broadcast_to(radius, around.shape)
    mid[some], around[some] = cut(mid[some], around[some], other, bound[some])
    return mid, around


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
