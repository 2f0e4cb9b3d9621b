"""Rotations of a body: exponential maps and quaternions, and joint rotations from positions.

A quaternion is (w, x, y, z). An exponential map is axis times angle, radians. Positions carry no
twist: the rotation of a joint found from positions is the *swing*, the shortest turn that takes
its bone from its direction in the rest pose (seen from its parent) to its present direction. Only
the root's rotation is fully known, if the body has hips and a spine.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor

from hri_predict.base.errors import PredictorError
from hri_predict.base.skeleton import Skeleton, generations

_TINY = 1e-8


def quaternion(expmap: Tensor) -> Tensor:
    """Quaternions (..., 4) of exponential maps (..., 3): KD-Former, Eq. 27.

    The limit at no rotation, where the equation divides by zero, is exact and differentiable.
    """
    angle = (expmap.square().sum(-1, keepdim=True) + 1e-16).sqrt()
    half = angle / 2
    return torch.cat([half.cos(), half.sin() / angle * expmap], -1)


def expmap(q: Tensor) -> Tensor:
    """Exponential maps (..., 3) of unit quaternions (..., 4); over half a turn where w < 0."""
    w, v = q[..., :1], q[..., 1:]
    sine = v.norm(dim=-1, keepdim=True)
    angle = 2 * torch.atan2(sine, w)
    # As sine -> 0 at w = 1, the limit is 2. At w = -1 (a whole turn) there is no axis: give none.
    return v * torch.where(sine > 1e-6, angle / sine.clamp(min=1e-6), 2.0)


def continuous(q: Tensor, dim: int = 1) -> Tensor:
    """Choose between q and -q (the same rotation) so that the last has w >= 0 and no step jumps.

    Exponential maps wrap by 2 pi. Among the maps of the result, the last one is the shortest and
    the earlier ones follow it without a jump, up to three quarters of a turn. Beyond that the
    shortest is taken, because a map near a whole turn has no well-defined axis.

    Args:
        q: unit quaternions (..., 4) with time along ``dim``.
    """
    q = q.movedim(dim, 0)
    turns = torch.cat([(q[:-1] * q[1:]).sum(-1) < 0, q[-1:, ..., 0] < 0])
    odd = turns.long().flip(0).cumsum(0).flip(0) % 2
    sign = 1 - 2 * odd.to(q.dtype)
    sign = torch.where(sign * q[..., 0] < -math.sqrt(0.5), -sign, sign)
    return (q * sign[..., None]).movedim(0, dim)


def shortest(e: Tensor, dim: int = 1) -> Tensor:
    """The same rotations (..., 3) without wraps along ``dim``; the last is at most half a turn."""
    return expmap(continuous(quaternion(e), dim))


def multiply(a: Tensor, b: Tensor) -> Tensor:
    """Hamilton product (..., 4): first ``b``, then ``a``."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - (av * bv).sum(-1, keepdim=True)
    return torch.cat([w, aw * bv + bw * av + _cross(av, bv)], -1)


def conjugate(q: Tensor) -> Tensor:
    """The inverse of unit quaternions (..., 4)."""
    return q * q.new_tensor([1.0, -1.0, -1.0, -1.0])


def rotate(q: Tensor, x: Tensor) -> Tensor:
    """Vectors (..., 3) turned by unit quaternions (..., 4)."""
    v = q[..., 1:]
    half = _cross(v, x)
    return x + 2 * (q[..., :1] * half + _cross(v, half))


def matrix(e: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of exponential maps (..., 3)."""
    q = quaternion(e)[..., None, :]
    eye = torch.eye(3, dtype=e.dtype, device=e.device)
    return rotate(q, eye).transpose(-1, -2)  # columns: the turned axes


def between(a: Tensor, b: Tensor, axis: Tensor | None = None) -> Tensor:
    """Shortest rotation (..., 4) taking unit vectors ``a`` (..., 3) to ``b``.

    Args:
        axis: (..., 3) axis of the half turn where the two are opposite; without it, any axis
            perpendicular to ``a``.
    """
    cosine = (a * b).sum(-1, keepdim=True)
    q = torch.cat([1 + cosine, _cross(a, b)], -1)
    opposite = cosine < -1 + 1e-6
    # Hardly ever; an exported copy has one path, which serves both.
    if torch.jit.is_tracing() or bool(opposite.any()):
        if axis is None:
            axis = _unit(_cross(a, _least(a)))
        half_turn = torch.nn.functional.pad(axis, (1, 0))
        q = torch.where(opposite, half_turn, q)
    return q / q.norm(dim=-1, keepdim=True).clamp(min=_TINY)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product with broadcasting."""
    if torch.jit.is_tracing():  # the exporter writes a quarter of the nodes for this
        next_one, one_after = torch.tensor([1, 2, 0]), torch.tensor([2, 0, 1])
        ahead = a.index_select(-1, next_one) * b.index_select(-1, one_after)
        return ahead - a.index_select(-1, one_after) * b.index_select(-1, next_one)
    return torch.linalg.cross(*torch.broadcast_tensors(a, b))


def _least(a: Tensor) -> Tensor:
    """The coordinate axis (..., 3) along which each vector has its smallest component."""
    return (torch.arange(3, device=a.device) == a.abs().argmin(-1, keepdim=True)).to(a.dtype)


def _unit(x: Tensor) -> Tensor:
    """Unit vectors; straight up where there is no direction."""
    length = x.norm(dim=-1, keepdim=True)
    up = x.new_tensor([0.0, 0.0, 1.0])
    return torch.where(length > _TINY, x / length.clamp(min=_TINY), up)


class KinematicTree:
    """A skeleton's tree, level by level: rotations from positions and positions from rotations.

    The rotation of joint j turns the bone from its parent to it, seen from its parent:
    ``G_j = G_parent R_j``, ``p_j = p_parent + length_j G_j u_j`` with u_j the bone's direction in
    the rest pose. The root's rotation is the body's orientation.

    Raises:
        PredictorError: the skeleton is not one tree.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.parents = list(skeleton.parents)
        if self.parents.count(-1) != 1:
            raise PredictorError(
                f"skeleton {skeleton.name} has {self.parents.count(-1)} roots; rotations need one "
                "tree with one root"
            )
        self.root = self.parents.index(-1)
        levels = generations(self.parents)
        self._sizes = [len(level) for level in levels]
        # joints level by level; each one's place there, and its parent's in the level before
        self._order = torch.tensor([j for level in levels for j in level])
        self._place = self._order.argsort()
        self._above = [
            torch.tensor([before.index(self.parents[j]) for j in level])
            for before, level in pairwise(levels)
        ]
        self._parents = torch.tensor([j if p < 0 else p for j, p in enumerate(self.parents)])
        self._jumps = _jumps(self.parents)
        self.ancestors = ancestor_matrix(self.parents)
        self._axes = _root_axes(skeleton)

    def bones(self, positions: Tensor) -> Tensor:
        """(..., J, 3) vectors from each joint's parent to the joint; zero at the root."""
        return positions - _taken(positions, self._parents)

    def lengths(self, positions: Tensor, observed: Tensor) -> Tensor:
        """(B, J) metres: the median of each bone over the steps where both its ends were observed.

        A bone that was never observed has its filled-in length at the last step.
        """
        length = self.bones(positions).norm(dim=-1)
        both = observed & observed.index_select(-1, self._parents.to(observed.device))
        ordered = torch.where(both, length, torch.inf).sort(1).values
        count = both.sum(1, keepdim=True)
        median = ordered.gather(1, (count - 1).clamp(min=0) // 2)[:, 0]
        return torch.where(count[:, 0] == 0, length[:, -1], median)

    def known(self, observed: Tensor) -> Tensor:
        """(B, T, J) true where the joint, all its ancestors and the root's axes are observed."""
        lost = (~observed).float() @ self.ancestors.to(observed.device)
        axes = observed[..., list(self._axes or ())].all(-1, keepdim=True)
        return (lost < 0.5) & axes

    @torch.no_grad()
    def rotations(self, positions: Tensor, rest: Tensor) -> Tensor:
        """Joint rotations (B, T, J, 3) of positions (B, T, J, 3), continuous in time.

        Those of the last step are the shortest.

        Args:
            rest: (J, 3) the rest pose in the same axes, anywhere.
        """
        toward = _taken(_unit(self.bones(positions)), self._order).split(self._sizes, -2)
        before = _taken(_unit(self.bones(rest)), self._order).split(self._sizes, -2)
        turned = self._orientation(positions, rest)[:, :, None]  # of the level above
        swings = [turned]
        for above, a, b in zip(self._above, before[1:], toward[1:], strict=True):
            parent = _taken(turned, above)
            swing = between(a, rotate(conjugate(parent), b))
            turned = multiply(parent, swing)
            swings.append(swing)
        return expmap(continuous(_taken(torch.cat(swings, 2), self._place)))

    def positions(self, rotations: Tensor, rest: Tensor, lengths: Tensor, root: Tensor) -> Tensor:
        """Forward kinematics: (B, H, J, 3) metres.

        Args:
            rotations: (B, H, J, 3) exponential maps, as ``rotations`` gives them.
            rest: (J, 3) the rest pose.
            lengths: (B, J) metres, the person's own bones.
            root: (B, H, 3) metres, positions of the root.
        """
        world = self._world(quaternion(rotations))
        bones = rotate(world, _unit(self.bones(rest))) * lengths[:, None, :, None]
        return self._summed(bones) + root[:, :, None]

    def offsets_positions(self, rotations: Tensor, offsets: Tensor) -> Tensor:
        """Forward kinematics of a motion-capture file: (B, T, J, 3), the root at the origin.

        ``G_j = G_parent R_j``, ``p_j = p_parent + G_parent offset_j``: a joint's rotation turns the
        bones that leave it, not the one that leads to it.

        Args:
            rotations: (B, T, J, 3) exponential maps.
            offsets: (J, 3) from each parent to its joint, unturned, metres.
        """
        parent = _taken(self._world(quaternion(rotations)), self._parents)
        return self._summed(rotate(parent, offsets))

    def _world(self, local: Tensor) -> Tensor:
        """Orientations (B, T, J, 4) from joint rotations ``local``, relative to the parents.

        Each round extends every joint's chain of rotations by the equally long chain above it, so a
        few products over all joints cover the whole depth of the tree.
        """
        identity = local.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(*local.shape[:2], 1, 4)
        turned = local
        for above in self._jumps:
            turned = multiply(_taken(torch.cat([turned, identity], 2), above), turned)
        return turned

    def _summed(self, bones: Tensor) -> Tensor:
        """Bones (..., J, 3) added up from the root to each joint; the root's own is not counted."""
        ancestors = self.ancestors.to(bones).clone()
        ancestors[self.root] = 0.0
        return torch.einsum("btac,aj->btjc", bones, ancestors)

    def _orientation(self, positions: Tensor, rest: Tensor) -> Tensor:
        """(B, T, 4) the root's orientation: the line through the hips, then the spine about it."""
        if self._axes is None:
            identity = positions.new_tensor([1.0, 0.0, 0.0, 0.0])
            return identity.expand(*positions.shape[:2], 4)
        left, right, top = self._axes
        across = _unit(positions[:, :, left] - positions[:, :, right])
        rest_across = _unit(rest[left] - rest[right])
        swing = between(rest_across, across)
        middle = (positions[:, :, left] + positions[:, :, right]) / 2
        up = positions[:, :, top] - middle
        rest_up = rotate(swing, rest[top] - (rest[left] + rest[right]) / 2)
        twist = between(_square(rest_up, across), _square(up, across), across)
        return multiply(twist, swing)


def _taken(x: Tensor, joints: Tensor) -> Tensor:
    """Select joints of (..., J, C) by their numbers; cheaper than indexing with a list."""
    return x.index_select(-2, joints.to(x.device))


def _square(x: Tensor, axis: Tensor) -> Tensor:
    """Unit vectors along the part of ``x`` that is perpendicular to the unit vectors ``axis``."""
    return _unit(x - (x * axis).sum(-1, keepdim=True) * axis)


def _jumps(parents: Sequence[int]) -> list[Tensor]:
    """Each joint's ancestors 1, 2, 4, ... levels up; J beyond the root."""
    count = len(parents)
    above = [count if p < 0 else p for p in parents]
    found = []
    while any(j < count for j in above):
        found.append(torch.tensor(above))
        above = [count if j == count else above[j] for j in above]
    return found


def ancestor_matrix(parents: Sequence[int]) -> Tensor:
    """(J, J) 1 where the row's joint is the column's, or its ancestor."""
    table = torch.zeros(len(parents), len(parents))
    for j in range(len(parents)):
        i = j
        while i >= 0:
            table[i, j] = 1.0
            i = parents[i]
    return table


def _root_axes(skeleton: Skeleton) -> tuple[int, int, int] | None:
    """Left, right and upper joint that define the root's orientation; None without them."""
    for pair in ("hip", "shoulder"):
        for top in ("torso", "neck", "chest", "head"):
            names = (f"l_{pair}", f"r_{pair}", top)
            if all(name in skeleton.joints for name in names):
                left, right, upper = (skeleton.joints.index(name) for name in names)
                return left, right, upper
    return None
