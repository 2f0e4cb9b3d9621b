"""RobotStates from one controller of a robot: the newest one, and whether it can be trusted."""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.messages import RobotMode
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotModel, StateMotion
from hri_predict.robots.states.agreement import RobotPlace
from hri_predict.robots.states.plausibility import StateCheck


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """The newest accepted RobotState of a controller.

    Attributes:
        q, qd: (N,) rad, m and per second, the base's first.
        mode: mode of the controller.
        received_ns: time of receipt, node's clock.
        tool: number of the confirmed tool; ``None``: none.
    """

    q: Floats
    qd: Floats
    mode: RobotMode
    received_ns: int
    tool: int | None


class Line:
    """The states of one controller.

    Args:
        model: the robot.
        check: comparison of its states with each other.

    Attributes:
        check: as given.
        counter: counter of the newest state; ``None`` before the first.
        state: the newest accepted state.
        refused: why the newest state was refused; ``None`` if it was accepted.
        heard_ns: time when the newest state arrived.
    """

    def __init__(self, model: RobotModel, check: StateCheck) -> None:
        self._model = model
        self.check = check
        self.counter: int | None = None
        self.state: Received | None = None
        self.refused: Reason | None = None
        self.heard_ns = 0

    def is_fresh(self, now_ns: int, stale_s: float) -> bool:
        """Return whether there is an accepted state that is not stale."""
        return self.state is not None and now_ns - self.state.received_ns <= stale_s * 1e9

    def is_frozen(self, now_ns: int, stale_s: float) -> bool:
        """Return whether the controller repeats an old position in states that appear fresh."""
        frozen = self.check.frozen
        if frozen is None or not self.is_fresh(now_ns, stale_s):
            return False
        return frozen.is_frozen(now_ns, stale_s)

    def reasons(self, now_ns: int, stale_s: float) -> list[Reason]:
        """Return the reasons for not trusting its states."""
        is_refused = self.refused is not None and now_ns - self.heard_ns <= stale_s * 1e9
        found = (self.refused if is_refused else None, self.check.reason(now_ns))
        return [reason for reason in found if reason is not None]

    def place(self, now_ns: int, motion: StateMotion) -> RobotPlace:
        """Return the position at ``now_ns``, extrapolated from the newest state up to limits."""
        state, model = self.state, self._model
        assert state is not None  # the caller has seen it
        age_s = max((now_ns - state.received_ns) * 1e-9, 0.0)
        ahead_s: float | Floats = min(age_s, motion.stale_s) + motion.delay_s
        longest_s = float(ahead_s)
        held_s = None if self.check.frozen is None else self.check.frozen.ages_s(now_ns)
        if held_s is not None and not self.is_frozen(now_ns, motion.stale_s):
            ahead_s = np.maximum(held_s, 0.0) + motion.delay_s
            longest_s = float(ahead_s.max())
        lowest = np.minimum(model.position_min, state.q)
        highest = np.maximum(model.position_max, state.q)
        q = np.minimum(np.maximum(state.q + state.qd * ahead_s, lowest), highest)
        return RobotPlace(q, state.qd, longest_s, self.check.jitter_s + motion.delay_s / 2)
