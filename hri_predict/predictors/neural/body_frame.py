"""A person's own frame, and filling of unobserved joints: the input of every trained predictor.

The frame's origin is the middle of the hips at the last step that observed both. Without such a
step it is the last observed place of the pelvis joint, or else the centroid of the joints' last
observed places. As in REP-103, the z axis points up and the x axis points where the person faces:
level with the floor, perpendicular to the line through the hips, or else the shoulders. Without
either pair the frame is not turned. Nothing later than the window's end is used.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from hri_predict.base.skeleton import Skeleton, neighbours
from hri_predict.predictors.neural.body import EXTRAPOLATED_STEPS, LEVEL_M


@dataclass(frozen=True, slots=True)
class BodyFrame:
    """Origin (B, 3) in the room and rotation (B, 3, 3) from the room's axes to the body's."""

    origin: Tensor
    rotation: Tensor

    def enter(self, positions: Tensor) -> Tensor:
        """Room to body: (B, T, J, 3)."""
        return torch.einsum("bij,btkj->btki", self.rotation, positions - self.origin[:, None, None])

    def leave(self, positions: Tensor) -> Tensor:
        """Body to room: (B, T, J, 3)."""
        turned = torch.einsum("bij,btki->btkj", self.rotation, positions)
        return turned + self.origin[:, None, None]


def body_frame(positions: Tensor, observed: Tensor, skeleton: Skeleton) -> BodyFrame:
    """The frame of each person at the end of its window.

    Args:
        positions: (B, T, J, 3) metres, room frame, finite; any value where not observed.
        observed: (B, T, J) bool.
        skeleton: names the joints; those it lacks are never observed.
    """
    hips = _pair(positions, observed, skeleton, "hip")
    shoulders = _pair(positions, observed, skeleton, "shoulder")
    pelvis = _newest(positions, observed, skeleton, "pelvis")
    last, ever = _last(positions, observed)
    count = ever.sum(1, keepdim=True).clamp(min=1)
    centroid = (last * ever[..., None]).sum(1) / count
    origin = torch.where(pelvis.seen[:, None], pelvis.place, centroid)
    origin = torch.where(hips.seen[:, None], hips.place, origin)
    across = torch.where(hips.seen[:, None], hips.across, shoulders.across)
    turned = hips.seen | shoulders.seen
    level = across[:, :2]
    length = level.norm(dim=1)
    turned &= length > LEVEL_M
    y = torch.where(
        turned[:, None], level / length.clamp(min=1e-6)[:, None], level.new_tensor([0, 1])
    )
    rotation = positions.new_zeros(len(positions), 3, 3)
    rotation[:, 0, 0], rotation[:, 0, 1] = y[:, 1], -y[:, 0]  # x: a quarter turn right of y
    rotation[:, 1, 0], rotation[:, 1, 1] = y[:, 0], y[:, 1]
    rotation[:, 2, 2] = 1.0
    return BodyFrame(origin, rotation)


def no_frame(positions: Tensor) -> BodyFrame:
    """The identity frame."""
    eye = torch.eye(3, dtype=positions.dtype).expand(len(positions), 3, 3)
    return BodyFrame(positions.new_zeros(len(positions), 3), eye)


@dataclass(frozen=True, slots=True)
class _Mark:
    place: Tensor  # (B, 3)
    across: Tensor  # (B, 3) from right to left
    seen: Tensor  # (B,)


def _pair(positions: Tensor, observed: Tensor, skeleton: Skeleton, name: str) -> _Mark:
    """The newest step in which both joints of a left-right pair were observed."""
    if f"l_{name}" not in skeleton.joints or f"r_{name}" not in skeleton.joints:
        return _nothing(positions)
    left, right = skeleton.joints.index(f"l_{name}"), skeleton.joints.index(f"r_{name}")
    both = observed[..., left] & observed[..., right]
    step, seen = _newest_step(both)
    batch = torch.arange(len(positions))
    a, b = positions[batch, step, left], positions[batch, step, right]
    return _Mark((a + b) / 2, a - b, seen)


def _newest(positions: Tensor, observed: Tensor, skeleton: Skeleton, joint: str) -> _Mark:
    if joint not in skeleton.joints:
        return _nothing(positions)
    index = skeleton.joints.index(joint)
    step, seen = _newest_step(observed[..., index])
    place = positions[torch.arange(len(positions)), step, index]
    return _Mark(place, torch.zeros_like(place), seen)


def _nothing(positions: Tensor) -> _Mark:
    zero = positions.new_zeros(len(positions), 3)
    return _Mark(zero, zero, torch.zeros(len(positions), dtype=torch.bool))


def _newest_step(seen: Tensor) -> tuple[Tensor, Tensor]:
    """(B,) newest true step of (B, T, ...), and whether there is one."""
    order = torch.arange(1, seen.shape[1] + 1).view(-1, *[1] * (seen.dim() - 2))
    newest = (seen * order).amax(1)
    return (newest - 1).clamp(min=0), newest > 0


def _last(positions: Tensor, observed: Tensor) -> tuple[Tensor, Tensor]:
    """(B, J, 3) where each joint was last observed, and (B, J) whether it ever was."""
    step, ever = _newest_step(observed)
    index = step[:, None, :, None].expand(-1, 1, -1, 3)
    return positions.gather(1, index)[:, 0], ever


def fill(positions: Tensor, observed: Tensor, rest: Tensor, nearest: Tensor) -> Tensor:
    """Fill unobserved positions with plausible ones; observed values stay unchanged.

    Between two observations a joint moves along a line. Before its first observation it stays at
    that place. After its last observation it keeps its last velocity for at most 3 steps and then
    stays. A joint that was never observed keeps the rest pose's offset from the nearest observed
    joint in the tree. A person without observed joints stands in the rest pose.

    Args:
        positions: (B, T, J, 3) body frame, finite; any value where not observed.
        observed: (B, T, J).
        rest: (J, 3) a mean pose in the body frame.
        nearest: (J, J) as ``neighbour_table`` gives it.
    """
    if bool(observed.all()):
        return positions
    steps = observed.shape[1]
    order = torch.arange(steps).view(1, -1, 1)
    before = torch.where(observed, order, -1).cummax(1).values
    after = torch.where(observed, order, steps).flip(1).cummin(1).values.flip(1)
    previous = before.gather(1, (before - 1).clamp(min=0))  # the observation before that one
    previous = torch.where(before > 0, previous, -1)
    inside, beyond = after < steps, before >= 0
    a = torch.where(beyond, before, torch.where(inside, after, 0))
    b = torch.where(inside & beyond, after, torch.where(beyond & (previous >= 0), previous, a))
    start, end = _at(positions, a), _at(positions, b)
    run = (order - a).clamp(max=EXTRAPOLATED_STEPS)
    run = torch.where(inside & beyond, order - a, run)
    weight = torch.where(a == b, 0.0, run / torch.where(a == b, 1, b - a)).to(positions.dtype)
    filled = start + weight[..., None] * (end - start)
    filled = torch.where(observed[..., None], positions, filled)
    return _fill_never_seen(filled, observed.any(1), rest, nearest)


def _fill_never_seen(filled: Tensor, ever: Tensor, rest: Tensor, nearest: Tensor) -> Tensor:
    if bool(ever.all()):
        return filled
    order = ever[:, nearest].to(torch.uint8).argmax(2)  # (B, J) place in the row of `nearest`
    source = nearest[torch.arange(nearest.shape[0]), order]  # (B, J)
    offset = rest - rest[source]
    index = source[:, None, :, None].expand_as(filled)
    moved = filled.gather(2, index) + offset[:, None]
    moved = torch.where(ever[:, None, :, None], filled, moved)
    nobody = ~ever.any(1)
    return torch.where(nobody[:, None, None, None], rest.expand_as(filled), moved)


def _at(positions: Tensor, step: Tensor) -> Tensor:
    return positions.gather(1, step[..., None].expand_as(positions))


def neighbour_table(skeleton: Skeleton) -> Tensor:
    """(J, J) for each joint, all joints by increasing distance in the tree, itself first."""
    return torch.from_numpy(np.ascontiguousarray(neighbours(skeleton.parents)))
