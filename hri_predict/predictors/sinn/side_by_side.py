"""SINN's forecast for the engines: readings side by side, and each product computed once.

The plain network (``model``) reads a window for every few steps that it predicts, one window after
another. The windows overlap, and a window's reading can begin long before its last frames are
predicted. Here all readings go through the frames together: 45 steps instead of 125 for a history
and a horizon of 25. A frame's contribution to the gates is the same for all readings except the one
that begins there, so it is computed once. So is everything that the three directions share.

Sums are taken in another order, so results differ by rounding.
"""

from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from hri_predict.predictors.sinn.symplectic import REST_SPEED, Operator, momentum, velocity

_PER_JOINT = 6  # columns of a joint: magnitude, angle, mask, and its place in three coordinates


class SideBySide:
    """Rolls out an operator with fixed weights.

    Args:
        operator: one that ``fits`` accepts.
        history_steps: T.
        rate_hz: steps per second.
        root: the joint that poses are relative to; ``None``: they are not shifted.
    """

    def __init__(
        self, operator: Operator, history_steps: int, rate_hz: float, root: int | None
    ) -> None:
        self.operator = operator
        self.history_steps, self.rate_hz, self.root = history_steps, rate_hz, root
        self.gates = _Gates(operator)

    def __call__(
        self, positions: Tensor, observed: Tensor, first: Tensor | None, horizon_steps: int
    ) -> Tensor:
        """Predict (B, H, J, 3) metres.

        Args:
            positions: (B, T, J, 3) body frame, filled; the last step is where forecasts start.
            observed: (B, T, J).
            first: (B, 1, J, 3, 2) the momentum that the forecast continues; by default the last.
            horizon_steps: H.
        """
        steps, total = self.operator.steps, self.history_steps
        readings = -(-horizon_steps // steps)
        begins = _begins(0, total, steps, readings)
        seen = observed.to(positions.dtype)
        inputs, last = self._read(positions, seen[:, 1:] * seen[:, :-1])
        waiting = self._begun(positions[:, begins])
        newest, carried = positions[:, -1:], last if first is None else first
        parts: list[Tensor] = []
        hidden = waiting.pop(0)
        for frame in range(1, (readings - 1) * steps + total):
            hidden = self.gates.step(*inputs.pop(0), hidden)
            if frame % steps == 0 and frame // steps < readings:
                hidden = torch.cat([hidden, waiting.pop(0)])
            if frame != len(parts) * steps + total - 1:
                continue
            change = self._change(hidden[0])  # the oldest reading has seen its whole window
            ahead = velocity(carried * self.operator.carry + change)
            parts.append(newest + ahead.cumsum(1) / self.rate_hz)
            if len(parts) == readings:
                break
            hidden = hidden[1:]
            both = seen[:, -1:] if len(parts) == 1 else torch.ones_like(seen[:, -1:])
            both = torch.cat([both] + [torch.ones_like(both)] * (steps - 1), 1)
            more, carried = self._read(torch.cat([newest, parts[-1]], 1), both)
            inputs += more
            begins = _begins(frame + 1, frame + 1 + steps, steps, readings)
            if begins:
                waiting += self._begun(parts[-1][:, [b - frame - 1 for b in begins]])
            newest = parts[-1][:, -1:]
        return torch.cat(parts, 1)[:, :horizon_steps]

    def _read(self, positions: Tensor, both: Tensor) -> tuple[list[tuple[Tensor, Tensor]], Tensor]:
        """Return the later frames' contributions to the gates, and the last frame's momentum."""
        zeta = momentum((positions[:, 1:] - positions[:, :-1]) * self.rate_hz)
        pose = self._pose(positions[:, 1:])
        alike = torch.cat([zeta[..., :1, 0], both[..., None], pose], -1)
        opening, new = self.gates.of_frames(alike, zeta[..., 1])
        return list(zip(opening.split(1), new.split(1), strict=True)), zeta[:, -1:]

    def _begun(self, positions: Tensor) -> list[Tensor]:
        """States (1, 3, B, hidden) after a first frame, without known motion or state."""
        return list(self.gates.begun(self._pose(positions)).split(1))

    def _pose(self, positions: Tensor) -> Tensor:
        if self.root is None:
            return positions
        return positions - positions[:, :, self.root : self.root + 1]

    def _change(self, hidden: Tensor) -> Tensor:
        """The head's output (B, t, J, 3, 2) of states (3, B, hidden)."""
        out = self.operator.heads[0](hidden)
        out = out.view(3, -1, self.operator.steps, self.operator.joints, 2)
        return out.permute(1, 2, 3, 0, 4)


def fits(operator: Operator, kind: str, history_steps: int) -> bool:
    """Whether ``SideBySide`` can roll this operator out."""
    return (
        kind == "symplectic"
        and operator.splitting == "direction"
        and operator.pose == "all"
        and len(operator.grus) == 1
        and operator.steps < history_steps  # so that there is always a reading under way
    )


class _Gates:
    """The GRU's products, split into the contributions of frames, directions and states."""

    def __init__(self, operator: Operator) -> None:
        gru = operator.grus[0]
        assert isinstance(gru, nn.GRU)
        joints, self.hidden = operator.joints, gru.hidden_size
        weights, added = cast(Tensor, gru.weight_ih_l0), cast(Tensor, gru.bias_ih_l0)
        of_state, added_to_state = cast(Tensor, gru.weight_hh_l0), cast(Tensor, gru.bias_hh_l0)
        columns = weights[:, : joints * _PER_JOINT].view(-1, joints, _PER_JOINT)
        alike = torch.cat([columns[..., :1], columns[..., 2:]], -1)
        self.alike = alike.flatten(1).t().contiguous()  # magnitude, mask, place
        self.angle = columns[..., 1].t().contiguous()
        self.place = columns[..., 3:].flatten(1).t().contiguous()
        label = weights[:, joints * _PER_JOINT :].t()[:, None]  # (3, 1, gates)
        known, inside = added_to_state.split([2 * self.hidden, self.hidden])
        self.bias = label + added + F.pad(known, (0, self.hidden))
        self.at_rest = self.bias + columns[..., 0].sum(1) * REST_SPEED
        self.inside = inside  # the new state's part that the reset gate scales
        opening, new = of_state.split([2 * self.hidden, self.hidden])
        self.opening, self.new = opening.t().contiguous(), new.t().contiguous()

    def of_frames(self, alike: Tensor, angles: Tensor) -> tuple[Tensor, Tensor]:
        """(T, 3, B, 2 hidden) and (T, 3, B, hidden) of (B, T, J, 5) and of angles (B, T, J, 3)."""
        shared = alike.flatten(2).transpose(0, 1) @ self.alike
        added = shared[:, None] + (angles.permute(1, 3, 0, 2) @ self.angle + self.bias)
        opening, new = added.split([2 * self.hidden, self.hidden], -1)
        return opening, new

    def begun(self, pose: Tensor) -> Tensor:
        """(N, 3, B, hidden) states after one frame of poses (B, N, J, 3), from zero states."""
        added = (pose.flatten(2).transpose(0, 1) @ self.place)[:, None] + self.at_rest
        opening, new = added.split([2 * self.hidden, self.hidden], -1)
        reset, keep = opening.sigmoid().split(self.hidden, -1)
        state = (new + reset * self.inside).tanh()
        return state - keep * state

    def step(self, before: Tensor, fresh: Tensor, state: Tensor) -> Tensor:
        """The next states (R, 3, B, hidden) of R readings, given a frame's contribution."""
        opening = (before + state @ self.opening).sigmoid()
        reset, keep = opening.split(self.hidden, -1)
        new = (fresh + reset * (state @ self.new + self.inside)).tanh()
        return new + keep * (state - new)


def _begins(start: int, end: int, steps: int, readings: int) -> list[int]:
    """Frames in ``start`` to ``end`` - 1 at which a reading begins."""
    return [f for f in range(start, end) if f % steps == 0 and f // steps < readings]
