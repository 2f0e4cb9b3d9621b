"""Forces at the joints by a reduced-order model of the body: KD-Former, Eqs. 1 to 5.

Every joint is a point mass; its mass is its bone's share of the length of all bones (Eq. 1). The
body is split into parts, and each part is a separate chain: forces add up from the ends of a part
to its beginning and no further, so the number of parts (Table 4) matters. As in the paper, ground
reaction is left out. For given masses everything is linear in the positions, so it is computed as
two matrix products: over time (differences and low-pass) and over joints (the recursion).

Forces are in units of an average joint's weight, M g / J, and so of order one for any skeleton.
"""

import math
from typing import Literal

import torch
from torch import Tensor, nn

from hri_predict.base.skeleton import Skeleton

GRAVITY = 9.81  # m/s^2
Up = Literal["y", "z"]
PartCount = Literal[3, 5, 7]


class Dynamics(nn.Module):
    """Computes joint forces from windows of positions. It has no learnt parameters.

    Args:
        skeleton: gives the tree and the parts.
        steps: T, the length of the windows.
        rate_hz: true steps per second; they set the scale of gravity.
        parts: 3 (trunk with arms, two legs), 5 (the skeleton's own: torso, arms, legs) or 7 (also
            each hand, from where the arm branches).
        up: the axis that points up.
        cutoff_hz: cutoff of the low-pass (6 Hz in the paper, section 4.1); there is no low-pass if
            it is at or above half the rate.
    """

    time: Tensor
    carried: Tensor
    up: Tensor

    def __init__(
        self,
        *,
        skeleton: Skeleton,
        steps: int,
        rate_hz: float,
        parts: PartCount = 5,
        up: Up = "z",
        cutoff_hz: float = 6.0,
    ) -> None:
        super().__init__()
        smooth = low_pass(steps, rate_hz, cutoff_hz)
        time = smooth @ acceleration(steps) * rate_hz**2
        self.register_buffer("time", time.float(), persistent=False)
        carried = carried_by(skeleton, body_parts(skeleton, parts))
        self.register_buffer("carried", carried, persistent=False)
        axis = torch.tensor([float(up == name) for name in "xyz"])
        self.register_buffer("up", axis, persistent=False)

    def forward(self, positions: Tensor, lengths: Tensor) -> Tensor:
        """Forces (B, T, J, 3) in units of M g / J.

        Args:
            positions: (B, T, J, 3) metres, filled.
            lengths: (B, J) metres of the bone that leads to each joint, 0 at the root.
        """
        masses = lengths / lengths.sum(1, keepdim=True).clamp(min=1e-6)  # Eq. 1, their sum is 1
        moved = torch.einsum("st,btjc->bsjc", self.time, positions)  # Eq. 2, filtered
        # Eqs. 3 to 5: f_j = m_j (a_j - g) + the forces of its children. Gravity is constant, so
        # the low-pass does not change it.
        needed = masses[:, None, :, None] * (moved / GRAVITY + self.up)
        joints = positions.shape[2]
        return torch.einsum("ij,btjc->btic", self.carried, needed) * joints

    def of_root(self, root: Tensor) -> Tensor:
        """Return the force (B, T, 3) that moves the whole body as one mass, in units of M g.

        It is paired with the token of the root's travel (not in the paper), as a joint's force is
        paired with its rotation. The root's row of ``forward`` is not this force: the root begins
        the torso's chain, so its row sums only the joints of that part (with three parts, the arms
        as well), in units of M g / J.

        Args:
            root: (B, T, 3) metres.
        """
        return torch.einsum("st,btc->bsc", self.time, root) / GRAVITY + self.up


def acceleration(steps: int) -> Tensor:
    """(T, T) second difference, Eq. 2: central inside, backward at the window's end.

    Eq. 2 reads one step ahead; at the newest step that would be the future. The oldest step uses
    the forward difference. Windows of one or two steps have no second difference.
    """
    table = torch.zeros(steps, steps, dtype=torch.float64)
    if steps < 3:
        return table
    for t in range(steps):
        middle = min(max(t, 1), steps - 2)
        table[t, middle - 1 : middle + 2] = torch.tensor([1.0, -2.0, 1.0], dtype=torch.float64)
    return table


def low_pass(steps: int, rate_hz: float, cutoff_hz: float) -> Tensor:
    """(T, T) Butterworth low-pass of second order, forward and backward over the window alone.

    The forward and the backward pass cancel each other's delay (as usual in gait analysis). Both
    start from rest at their first value, so a constant passes unchanged. Nothing past the window's
    end is used.
    """
    if cutoff_hz >= rate_hz / 2:
        return torch.eye(steps, dtype=torch.float64)
    # the filter's coefficients by the bilinear transform
    k = math.tan(math.pi * cutoff_hz / rate_hz)
    a0 = 1 + math.sqrt(2) * k + k * k
    b = [k * k / a0, 2 * k * k / a0, k * k / a0]
    a1, a2 = 2 * (k * k - 1) / a0, (1 - math.sqrt(2) * k + k * k) / a0
    impulse = [0.0, 0.0]  # the impulse response, after two zero steps
    for t in range(steps):
        push = b[t] if t < 3 else 0.0
        impulse.append(push - a1 * impulse[-1] - a2 * impulse[-2])
    response = torch.tensor(impulse[2:], dtype=torch.float64)
    once = torch.zeros(steps, steps, dtype=torch.float64)
    for t in range(steps):
        once[t, : t + 1] = response[: t + 1].flip(0)
    once[:, 0] += 1 - once.sum(1)  # start from rest at the first value
    back = once.flip(0, 1)
    return back @ once


def body_parts(skeleton: Skeleton, count: PartCount) -> list[int]:
    """Part number of each joint; each joint outside all parts forms its own part."""
    part = [-1] * len(skeleton.joints)
    for i, members in enumerate(skeleton.parts.values()):
        for joint in members:
            part[joint] = i
    names = list(skeleton.parts)
    if count == 3:
        trunk = {i for i, name in enumerate(names) if "leg" not in name}
        return [min(trunk) if p in trunk else p for p in part]
    if count == 7:
        for i, name in enumerate(names):
            if "arm" in name:
                for joint in _below_branch(skeleton, part, i):
                    part[joint] = len(names) + i
    return part


def _below_branch(skeleton: Skeleton, part: list[int], arm: int) -> list[int]:
    """Joints of an arm beyond the one where it branches into fingers; empty without a branch."""
    inside = [j for j, p in enumerate(part) if p == arm]
    children = {j: [c for c in inside if skeleton.parents[c] == j] for j in inside}
    hand: list[int] = []
    queue = [c for j in inside if len(children[j]) > 1 for c in children[j]]
    while queue:
        joint = queue.pop()
        if joint not in hand:
            hand.append(joint)
            queue += children[joint]
    return hand


def carried_by(skeleton: Skeleton, part: list[int]) -> Tensor:
    """(J, J) 1 where the row's joint is the column's, or its ancestor in the same part.

    Unrolls the recursion of Eqs. 3 to 5 from the ends of a part to where it begins.
    """
    table = torch.eye(len(part))
    for j in range(len(part)):
        i = skeleton.parents[j]
        while i >= 0 and part[i] == part[j]:
            table[i, j] = 1.0
            i = skeleton.parents[i]
    return table
