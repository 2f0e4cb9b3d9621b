"""Maximum error of the computed ends of a capsule, along a stretch of a path.

Let x be an end of a capsule's axis and h half the stretch. x deviates from the chord between the
stretch's ends by at most max|x''| h^2 / 2, and the chord from its own midpoint by half its length;
so |x(u) - (x_{k-1} + x_k) / 2| <= |x_k - x_{k-1}| / 2 + max|x''| h^2 / 2. Likewise x is at most h
max|x'| from that midpoint; the smaller bound is used. The path's first derivative must be
continuous; the second may jump.

The end is a sum of rigid pieces and of the displacements of prismatic joints between them
(``Chain.arms``). Write W_i for the sum over revolute j <= i of max|q_j'|: it bounds |omega_i|, the
turn rate of the link after joint i.

Piece i is fixed to that link, so |piece_i'| <= length_i W_i and |piece_i''| <= length_i (W_i^2 +
|omega_i'|). Here omega_i' = sum over revolute j <= i of q_j'' axis_j + q_j' omega_{j-1} x axis_j is
at most the sum of |q_j''| + |q_j'| W_{j-1} = sum of |q_j''| + (W_i^2 - sum of q_j'^2) / 2. Write
D_i for W_i^2 plus that.

A prismatic joint i adds q_i a_i, with a unit vector a_i that turns with the link before it, at most
at W_i, because joint i itself does not turn. So its first derivative is at most |q_i'| + |q_i| W_i.
Its second is q_i'' a_i + 2 q_i' a_i' + q_i a_i'', at most |q_i''| + 2 |q_i'| W_i + |q_i| D_i.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import norm


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Lever arms of C capsules about each of N joints.

    Attributes:
        arms: (C, N) lengths of the rigid pieces after each joint, up to the capsule's farther end.
        slides: (N,) which joints are prismatic.
        behind: (C, N) 1.0 where the capsule is after that prismatic joint, otherwise 0.
        extent: (N,) maximum absolute position of each prismatic joint within its limits, m;
            otherwise 0.
        beyond: (C, N) maximum distance of a capsule's end from each joint's axis within the limits;
            1 for prismatic joints, because an end moves one metre per metre.
    """

    arms: Floats
    slides: Bools
    behind: Floats
    extent: Floats
    beyond: Floats

    @classmethod
    def of(cls, arms: Floats, slides: Bools, links: Ints, extent: Floats) -> "Pieces":
        """Compute the pieces of capsules on ``links`` (C,)."""
        behind = (slides & (np.arange(arms.shape[1]) < links[:, None])).astype(np.float64)
        beyond = np.cumsum((arms + behind * extent)[:, ::-1], axis=1)[:, ::-1]
        beyond = np.where(slides, behind, beyond)
        return cls(np.ascontiguousarray(arms), slides, behind, extent, beyond)

    def departure(
        self,
        ends: Floats,
        before: Floats,
        *,
        q: Floats,
        dq: Floats,
        ddq: Floats,
        half: Floats,
    ) -> Floats:
        """Return (..., K, C) maximum distance of an axis from the mean of its positions at both
        ends.

        Args:
            ends, before: (2, ..., K, C, 3) both ends of the axes at the stretch's end and start.
            q: (..., K, N) at the stretch's end.
            dq, ddq: (..., K, N) or (N,) bounds of the absolute derivatives of the path.
            half: (..., K) h of each stretch.
        """
        reach_a, reach_b = 0.5 * norm(ends - before)
        h = half[..., None]
        if not self.slides.any():
            turning = np.cumsum(dq, axis=-1)
            bend = (1.5 * turning**2) @ self.arms.T + (ddq - dq**2 / 2) @ self.beyond.T
            first = dq @ self.beyond.T
        else:
            first, bend = self._derivatives(q, dq, ddq, h)
        grow = np.maximum(reach_a, reach_b) + bend * (h * h / 2)
        return np.minimum(grow, first * h)

    def _derivatives(self, q: Floats, dq: Floats, ddq: Floats, h: Floats) -> tuple[Floats, Floats]:
        """Return bounds (..., K, C) of |x'| and |x''| along each stretch."""
        dq, ddq = np.broadcast_to(dq, q.shape), np.broadcast_to(ddq, q.shape)
        before = np.concatenate([q[..., :1, :], q[..., :-1, :]], axis=-2)
        # no place of a stretch is farther than half of it from one of its ends
        extent = np.maximum(np.abs(q), np.abs(before)) + dq * h
        turn, turn_rise = np.where(self.slides, 0.0, dq), np.where(self.slides, 0.0, ddq)
        turning = np.cumsum(turn, axis=-1)  # W
        double = 1.5 * turning**2 + np.cumsum(turn_rise - turn**2 / 2, axis=-1)  # D
        first = turning @ self.arms.T + (dq + extent * turning) @ self.behind.T
        bend = double @ self.arms.T
        bend = bend + (ddq + 2 * dq * turning + extent * double) @ self.behind.T
        return first, bend
