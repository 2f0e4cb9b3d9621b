"""Check that a robot's reported velocities and positions are consistent.

RobotState carries a counter but no time stamp, so only arrival times are known. A state arrives
later than its sample by a delay that varies: jitter, cycles of both sides, bursts. Over a window
t_0 .. t_n, a joint's velocities give the travel sum(h_k v_k), with the time h_k between arrivals
and the mean v_k of two velocities. If the delays between sample and arrival differ by no more than
``jitter``, the error of this sum is at most

    jitter / 2 x (|v_0| + |v_n| + TV)        TV = sum |v_{k+1} - v_k|      (summation by parts)

A velocity filter with lag ``LAG_S`` adds LAG_S x TV; the unknown velocity between two samples adds
h |v_{k+1} - v_k| / 2. The jitter itself is measured: with evenly sampled states, it is the spread
of the arrivals about their counters, over ``MEMORY_S``. A sender with uneven sampling looks like
one with high jitter, so fewer errors are found and nothing is confirmed. Transmission alone cannot
cause a deviation above the sum of these tolerances.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.states.frozen import COUNTERS, LAG_S, PAUSE_S, RESTART, FrozenCheck

WINDOW_S = 0.3
"""Length of the window in which states are compared."""
LEAST_STATES = 4
"""Minimum number of states in the window for a result."""
LEAST_SPAN_S = 0.05
"""Minimum time between the first and the last state for a result."""
APART_S = 0.008
"""States that arrive closer together are merged, so that a fast sender costs no more time."""
MEMORY_S = 2.0
"""Time for which arrival times are kept to measure the jitter."""
LEARNT_S = 0.4
"""Minimum time span of arrivals for measuring the jitter; before, nothing is compared."""
JITTER_S = 0.01
"""Jitter of a sender's own cycle; the jitter of the arrivals is added."""
SHARE = 0.2
"""Permitted relative error of velocities, which are only estimated from encoders."""
NOISE = 0.004
"""Encoder noise and the wire's rounding (0.00025), rad or m of a prismatic joint."""
OFFSET_PER_S = 0.01
"""Cumulative noise and rounding (0.001) of a velocity, rad/s or m/s."""
JUMP_NOISE = 0.01
"""Minimum step of a position for a jump, rad or m."""
JUMP_JITTER_S = 0.1
"""Maximum time between the samples of two states that arrive together."""
SPEED_SHARE = 0.1
"""Momentary overshoot of a servo, as a fraction of the velocity limit."""
ONE_STEP = 0.7
"""Fraction of a deviation in one step above which the deviation is a position jump."""
HELD_S = 3.0
"""Time for which a finding is kept, because a robot that stops does not disprove it."""
RESTARTS, RESTARTS_S = 3, 2.0
"""Number of restarts, and time window, after which a counter is ignored as unusable."""


_COUNTER = {
    Reason.ROBOT_VELOCITY_WRONG: "velocity_wrong",
    Reason.ROBOT_STATE_JUMPED: "jumped",
    Reason.ROBOT_STATE_INVALID: "miscounted",
}


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    counter: int
    received_ns: int
    q: tuple[float, ...]
    qd: tuple[float, ...]


class StateCheck:
    """Compares successive RobotStates of one link.

    Args:
        velocity_max: (N,) rad/s, m/s, the joints' limits.
        noise: (N,) additional error of each position, rad, m; default 0.

    Attributes:
        confirmed: whether motion within the window proves the direction of the velocities. False
            for the first states, and while the robot is at rest.
        unreported: (N,) amount, rad/s, m/s, by which the reported velocities are too low according
            to the positions, but too small for a finding; ``None`` if there is none. The true
            velocity may be higher by this amount.
        counters: numbers of the findings ``velocity_wrong``, ``jumped`` and ``miscounted``.
        frozen: detector for repeated old positions, set by the owner; ``None``: not used.
    """

    def __init__(self, velocity_max: Floats, noise: Floats | float = 0.0) -> None:
        self._fastest = [v * (1 + SPEED_SHARE) for v in velocity_max.tolist()]
        extra = np.zeros(len(velocity_max)) + noise
        self._noise = NOISE + extra
        self._steps = (JUMP_NOISE + extra).tolist()
        self._window: deque[_State] = deque()
        self._arrivals: deque[tuple[int, int]] = deque()  # received_ns, counter without wrapping
        self._newest: _State | None = None
        self._compared_ns = 0
        self._held_until_ns = 0
        self._found: Reason | None = None
        self.confirmed = False
        self.unreported: Floats | None = None
        self._restarts_ns: deque[int] = deque(maxlen=RESTARTS)
        self.counters = {"velocity_wrong": 0, "jumped": 0, "miscounted": 0}
        self.frozen: FrozenCheck | None = None

    def take(
        self, counter: int, q: tuple[float, ...], qd: tuple[float, ...], received_ns: int
    ) -> None:
        """Process one state from this link, in the order of arrival; ``q``, ``qd``: N rad and
        rad/s, or m and m/s."""
        state = _State(counter, received_ns, q, qd)
        before, self._newest = self._newest, state
        found = None
        if before is not None:
            self._follow(before, state)
            if self._miscounts(state):
                found = Reason.ROBOT_STATE_INVALID
            elif self._jumps(before, state):
                found = Reason.ROBOT_STATE_JUMPED
        self._keep(state)
        if found is None and received_ns - self._compared_ns >= APART_S * 1e9:
            self._compared_ns = received_ns
            self.confirmed, self.unreported = False, None
            found = self._compare()
        self._conclude(found, received_ns)
        if self.frozen is not None:
            self.frozen.take(counter, q, qd, received_ns=received_ns, period_s=self.period_s)

    def reason(self, now_ns: int) -> Reason | None:
        """Return the fault at ``now_ns``; ``None`` if none was found recently."""
        return self._found if now_ns < self._held_until_ns else None

    @property
    def period_s(self) -> float:
        """Average cycle of the sender; 0: not known yet."""
        first, last = (self._arrivals[0], self._arrivals[-1]) if self._arrivals else ((0, 0),) * 2
        known = last[0] - first[0] >= LEARNT_S * 1e9 and last[1] > first[1]
        return (last[0] - first[0]) * 1e-9 / (last[1] - first[1]) if known else 0.0

    @property
    def jitter_s(self) -> float:
        """Spread of the arrival delays."""
        return self._spread_s() if self._arrivals else 0.0

    def _follow(self, before: _State, state: _State) -> None:
        """Restart if the states are not consecutive."""
        steps = (state.counter - before.counter) % COUNTERS
        if steps > RESTART:
            self._arrivals.clear()
            self._restarts_ns.append(state.received_ns)
        if steps > RESTART or state.received_ns - before.received_ns > PAUSE_S * 1e9:
            self._window.clear()
            self.confirmed, self.unreported = False, None

    def _miscounts(self, state: _State) -> bool:
        """Return whether the counter restarts repeatedly."""
        restarts = self._restarts_ns
        return len(restarts) == RESTARTS and state.received_ns - restarts[0] <= RESTARTS_S * 1e9

    def _keep(self, state: _State) -> None:
        """Store the state and its arrival time; of several close together, only the last."""
        window, arrivals, now_ns = self._window, self._arrivals, state.received_ns
        if len(window) > 1 and now_ns - window[-2].received_ns < APART_S * 1e9:
            window.pop()
        window.append(state)
        while now_ns - window[0].received_ns > WINDOW_S * 1e9:
            window.popleft()
        count = state.counter
        if arrivals:
            count = arrivals[-1][1] + (state.counter - arrivals[-1][1]) % COUNTERS
        if not arrivals or now_ns - arrivals[-1][0] >= APART_S * 1e9:
            arrivals.append((now_ns, count))
        while now_ns - arrivals[0][0] > MEMORY_S * 1e9:
            arrivals.popleft()

    def _conclude(self, found: Reason | None, now_ns: int) -> None:
        if found is None:
            return
        self._found = found
        self.counters[_COUNTER[found]] += 1
        self._held_until_ns = now_ns + round(HELD_S * 1e9)
        self.confirmed, self.unreported = False, None
        newest = self._window[-1]
        self._window.clear()  # so that one jump is found once
        self._window.append(newest)

    def _jumps(self, before: _State, state: _State) -> bool:
        """Return whether a joint moved farther than possible between two states."""
        elapsed_s = (state.received_ns - before.received_ns) * 1e-9 + JUMP_JITTER_S
        return any(
            abs(b - a) > most * elapsed_s + step
            for a, b, most, step in zip(before.q, state.q, self._fastest, self._steps, strict=True)
        )

    def _compare(self) -> Reason | None:
        """Compare the window's positions with its velocities."""
        window = self._window
        span_s = (window[-1].received_ns - window[0].received_ns) * 1e-9
        learnt_s = (self._arrivals[-1][0] - self._arrivals[0][0]) * 1e-9
        if len(window) < LEAST_STATES or span_s < LEAST_SPAN_S or learnt_s < LEARNT_S:
            return None
        jitter_s = JITTER_S + self._spread_s()
        values = np.array([state.q + state.qd for state in window])
        joints = len(self._noise)
        q, qd = values[:, :joints], values[:, joints:]
        received = np.array([state.received_ns for state in window])
        h = (received[1:] - received[:-1]) * 1e-9  # np.diff takes five times as long
        size, steps, twice = np.abs(qd), np.abs(qd[1:] - qd[:-1]), qd[1:] + qd[:-1]
        moved = q[-1] - q[0]
        by_wire = (
            self._noise
            + OFFSET_PER_S * span_s
            + jitter_s / 2 * (size[0] + size[-1])
            + (jitter_s / 2 + LAG_S + h / 2) @ steps
        )
        tolerance = by_wire + SHARE / 2 * (h @ (size[1:] + size[:-1]))
        missing = moved - h @ twice / 2
        off = np.abs(missing)
        worst = int((off - tolerance).argmax())
        if off[worst] <= tolerance[worst]:
            self.confirmed = bool((np.abs(moved) > tolerance).any())
            if (off > by_wire).any():
                self.unreported = np.sign(missing) * np.maximum(off - by_wire, 0.0) / span_s
            return None
        by_step = q[1:, worst] - q[:-1, worst] - h * twice[:, worst] / 2
        if np.abs(by_step).max() >= ONE_STEP * off[worst]:
            return Reason.ROBOT_STATE_JUMPED
        return Reason.ROBOT_VELOCITY_WRONG

    def _spread_s(self) -> float:
        """Return the spread of the arrival delays, assuming evenly sampled states."""
        (first_ns, first), (last_ns, last) = self._arrivals[0], self._arrivals[-1]
        period_ns = (last_ns - first_ns) / max(last - first, 1)
        # plain numbers: an array of these pairs takes longer than all that is done with it
        off = [at_ns - first_ns - (k - first) * period_ns for at_ns, k in self._arrivals]
        return (max(off) - min(off)) * 1e-9
