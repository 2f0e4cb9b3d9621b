"""Physical limits of bodies: bounds that no zone needs to exceed, and the cut to these bounds.

Three bounds give each joint a sphere during each interval: its maximum speed from its last
position; its velocity at capture and the possible change of it (like the reachable sets of SaRA: S.
Pereira, M. Althoff, "Overapproximative human arm occupancy prediction for collision avoidance",
2018); and the bones, outwards from the pelvis: a joint is within its bone's length of its parent.
``HumanLimits`` gives the sources of the figures.
"""

from typing import NamedTuple, Self

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.skeleton import Skeleton, generations
from hri_predict.zones.settings import HumanLimits
from hri_predict.zones.sphere_geometry import along, cut

VELOCITY_STEPS = 2
"""Number of history steps over which the velocity at capture is measured."""
BONE_FACTOR, BONE_MARGIN_M = 1.1, 0.02
"""Margin on a bone's length seen at capture, because joints slip on the body."""


class BodyReach(NamedTuple):
    """The bounds for one skeleton, see ``of``. J joints.

    Attributes:
        speed, burst, sustained: (J,) limits, see ``settings.Reach``.
        rate_hz: steps per second of the history.
        parents: (J,) parent of each joint; -1 for roots.
        bone: (J,) maximum distance to the parent, metres; infinite for roots.
        order: all joints but the roots, from the root outwards.
        depth: (J,) the number of bones between a joint and its root.
    """

    speed: Floats
    burst: Floats
    sustained: Floats
    rate_hz: float
    parents: Ints
    bone: Floats
    order: Ints
    depth: Ints

    @classmethod
    def of(cls, limits: HumanLimits, skeleton: Skeleton, rate_hz: float) -> Self:
        """Return the bounds for a skeleton's joints, tree and parts; history at ``rate_hz``."""
        part = np.full(len(skeleton.joints), "trunk", dtype=object)
        for kind in ("arm", "leg"):
            for side in ("left", "right"):
                part[list(skeleton.parts.get(f"{side}_{kind}", ()))] = kind
        own = [limits.reach[p] for p in part]
        levels = generations(skeleton.parents)
        depth = np.zeros(len(part), np.intp)
        for level, joints in enumerate(levels):
            depth[joints] = level
        bone = [skeleton.reach[j, p] if p >= 0 else np.inf for j, p in enumerate(skeleton.parents)]
        return cls(
            speed=np.array([r.speed_m_s for r in own], np.float64),
            burst=np.array([r.burst_m_s for r in own], np.float64),
            sustained=np.array([r.sustained_m_s2 for r in own], np.float64),
            rate_hz=float(rate_hz),
            parents=np.array(skeleton.parents, np.intp),
            bone=np.array(bone, np.float64),
            order=np.array([j for level in levels[1:] for j in level], np.intp),
            depth=depth,
        )

    def velocity(self, history: Floats, observed: Bools) -> tuple[Floats, Bools]:
        """Return (P, J, 3) velocity at capture, and (P, J) whether both its steps were observed."""
        if history.shape[1] <= VELOCITY_STEPS:
            shape = (len(history), history.shape[2])
            return np.zeros((*shape, 3)), np.zeros(shape, dtype=bool)
        known = observed[:, -1] & observed[:, -1 - VELOCITY_STEPS]
        moved = history[:, -1] - history[:, -1 - VELOCITY_STEPS]
        return np.where(known[..., None], moved, 0.0) * (self.rate_hz / VELOCITY_STEPS), known

    def cut_by_motion(
        self,
        mid: Floats,
        around: Floats,
        *,
        last: Floats,
        velocity: tuple[Floats, Bools],
        since: Floats,
        until: Floats,
        joint_age: Floats | None = None,
    ) -> tuple[Floats, Floats]:
        """Cut spheres to the limits of speed and acceleration.

        Args:
            mid, around: (P, K, J, 3) and (P, K, J), each holding a joint during an interval.
            last: (P, J, 3) last seen positions.
            velocity: velocities at capture, see ``velocity``.
            since, until: (P, K) start and end of the intervals, seconds after the capture.
            joint_age: (P, J) seconds from the last observation to the capture; ``None``: 0.
        """
        t = until[..., None]  # (P, K, 1)
        by_speed = self.speed * (t if joint_age is None else t + joint_age[:, None])
        v, known = velocity
        middle = 0.5 * (since + until)[..., None, None]
        half = 0.5 * (until - since)[..., None]
        change = (self.burst + 0.5 * self.sustained * t) * t
        speed = np.sqrt((v**2).sum(-1))[:, None]
        by_velocity = np.where(known[:, None], change + speed * half, np.inf)
        ahead = last[:, None] + v[:, None] * middle
        mid, around = _cut_outside(mid, around, last[:, None], by_speed)
        return _cut_outside(mid, around, ahead, by_velocity)

    def cut_by_bones(
        self,
        mid: Floats,
        around: Floats,
        *,
        last: Floats,
        seen: Bools,
        all_joints: bool = False,
        inferred: Floats | float = 0.0,
    ) -> tuple[Floats, Floats]:
        """Cut spheres, from the root outwards, to within a bone's length of the parent's sphere.

        Args:
            mid, around: (P, K, J, 3) and (P, K, J).
            last: (P, J, 3) joint positions at the capture.
            seen: (P, J) whether each joint was seen in that capture. A bone has the length seen
                then; otherwise that of the largest person.
            all_joints: whether to cut joints that were not seen as well.
            inferred: (P, J) maximum distance of a joint from its position in ``last``, metres.
        """
        parents = self.parents
        apart = np.sqrt(((last - last[:, parents]) ** 2).sum(-1))
        unsure = np.broadcast_to(inferred, apart.shape)
        length = (apart + unsure + unsure[:, parents]) * BONE_FACTOR + BONE_MARGIN_M
        both = seen & seen[:, parents]
        longest = np.where(seen | all_joints, self.bone, np.inf)
        bone = np.where(both, length, longest)  # (P, J)
        # Coordinates and joints first: a generation is then long rows of numbers.
        centre = mid.transpose(3, 2, 0, 1).copy()  # (3, J, P, K)
        radius = around.transpose(2, 0, 1).copy()
        bones = bone.T[..., None]
        for level in range(1, int(self.depth.max(initial=0)) + 1):
            children = np.flatnonzero(self.depth == level)
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
    """Return whether spheres are inside others, from the squared distance of the centres."""
    room = bound - radius
    result: Bools = (room >= 0) & (square <= room * room)
    return result


def _cut_outside(
    mid: Floats, around: Floats, centre: Floats, radius: Floats
) -> tuple[Floats, Floats]:
    """Apply ``cut`` only to the few spheres that are not already inside the other one."""
    apart = mid - centre
    outside = ~_inside(np.einsum("...i,...i->...", apart, apart), around, radius)
    some = np.nonzero(outside)
    if not len(some[0]):
        return mid, around
    mid, around = mid.copy(), around.copy()
    other, bound = np.broadcast_to(centre, mid.shape)[some], np.broadcast_to(radius, around.shape)
    mid[some], around[some] = cut(mid[some], around[some], other, bound[some])
    return mid, around
