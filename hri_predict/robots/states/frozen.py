"""Detect a controller that repeats an old position while its counter advances.

A counter and a CRC prove that a message is new, but not that its content is new. Two kinds of
content cannot be new:

- *A place that is held while a velocity is reported.* A coordinate that moves at ``MOVES`` or more
  passes ``DITHER`` within 50 ms. A coordinate that has not, although its velocities add up to
  ``TRAVEL``, was last measured when it reached that position. Its age starts at that time: the node
  extrapolates it with its velocity, as for a late RobotState, and rejects it at the age at which
  RobotState is stale. After that, its position must change: a velocity that falls to zero is not
  sufficient.
- *A stop that no robot can make.* From a speed v the fastest point needs at least v^2 / (2 a) and v
  / a to stop. A robot that appears to stop immediately, or within one cycle of its sender, is
  trusted only after its position has changed, because a frozen state can look like a robot at rest.

A robot at rest that reports the same position for minutes, with velocities of zero, is trusted. So
a state that freezes while the robot is at rest, or moves too slowly for these rules, is not
detected from this controller alone; ``still`` doubts it after the robot was free to move for a long
time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats

COUNTERS = 1 << 16
RESTART = 1000
"""Maximum step of a counter; after a larger step it is treated as restarted."""
PAUSE_S = 0.2
"""Maximum silence; after a longer one the comparison restarts."""
LAG_S = 0.03
"""Maximum time over which a controller filters its velocities."""
MOVES = 0.01
"""Minimum velocity of a moving coordinate, above the noise, rad/s or m/s (``plausibility``)."""
DITHER = 0.0005
"""Minimum change of position for motion: two steps of the wire format, rad, m."""
BASE_DITHER = 0.001
"""Minimum change of a moving base's position or heading, whose wire steps are larger."""
TRAVEL = 0.002
"""Expected travel, rad or m, after which an unchanged coordinate is considered held."""
BASE_HELD_S = 0.25
"""Time for which a base's position may be held, because localisation may be slower than RobotState.
"""
HARDEST = 2.0
"""Maximum deceleration of a stop, as a multiple of the robot's acceleration."""
CYCLE_S = 0.005
"""Maximum excess of one cycle of a sender over its average cycle."""
LEAST_WAY_M = 0.0005
"""Minimum stopping distance that is visible in the positions."""
STANDS_SHARE = 0.2
"""Minimum fraction of a velocity that a filtering controller still reports one state later."""


@dataclass(slots=True)
class _Place:
    """A coordinate's position, the time since it has not changed, its expected travel since then,
    and whether it was found to be frozen."""

    at: float
    since_ns: int
    travel: float = 0.0
    frozen: bool = False


@dataclass(frozen=True, slots=True)
class _State:
    counter: int
    received_ns: int
    q: tuple[float, ...]
    qd: tuple[float, ...]
    measured: int  # counter of the first state with this content


class FrozenCheck:
    """Compares the positions from one link with its velocities.

    Args:
        fastest_point: (q, qd) -> m/s, speed of the robot's fastest point.
        acceleration_m_s2: maximum acceleration of the fastest point in production.
        lead: number of a moving base's coordinates, which come first.

    Attributes:
        counter: number of detected freezes.
    """

    def __init__(
        self,
        fastest_point: Callable[[Floats, Floats], Floats],
        acceleration_m_s2: float,
        lead: int = 0,
    ) -> None:
        self._fastest_point = fastest_point
        self._acceleration = acceleration_m_s2
        self._lead = lead
        self._places: list[_Place] = []
        self._newest: _State | None = None
        self._stopped: tuple[float, ...] | None = None  # where it stopped impossibly
        self._is_held = False
        self.counter = 0

    def take(
        self,
        counter: int,
        q: tuple[float, ...],
        qd: tuple[float, ...],
        *,
        received_ns: int,
        period_s: float,
    ) -> None:
        """Process one state from this link, in the order of arrival.

        Args:
            counter: counter of the state.
            q, qd: (N,) rad and rad/s, or m and m/s.
            received_ns: node's clock.
            period_s: period of the sender; 0: not known yet.
        """
        before = self._newest
        measured = counter
        if before is not None and (q, qd) == (before.q, before.qd):
            measured = before.measured
        state = self._newest = _State(counter, received_ns, q, qd, measured)
        if before is None or (counter - before.counter) % COUNTERS > RESTART:
            self._begin(state)
            self._stopped = None
            return
        if received_ns - before.received_ns > PAUSE_S * 1e9:
            self._begin(state)
        else:
            self._follow(before, state)
        if self._stopped is not None and self._stopped != q:
            self._stopped = None
        if self._stopped is None and self._stops_impossibly(before, state, period_s):
            self._stopped = q
            self.counter += 1

    def ages_s(self, now_ns: int) -> list[float] | None:
        """(N,) seconds since each coordinate was measured where it is; ``None``: since the newest
        state came, all of them."""
        if not any(abs(place.travel) > TRAVEL for place in self._places):
            return None
        assert self._newest is not None  # or there were no places
        return [
            (now_ns - (p.since_ns if abs(p.travel) > TRAVEL else self._newest.received_ns)) * 1e-9
            for p in self._places
        ]

    def is_frozen(self, now_ns: int, stale_s: float) -> bool:
        """Return whether to reject the newest state at ``now_ns``; ``stale_s``: age of a stale
        RobotState."""
        of_base_s = max(stale_s, BASE_HELD_S)
        for j, place in enumerate(self._places):
            limit_s = of_base_s if j < self._lead else stale_s
            late = now_ns - place.since_ns > limit_s * 1e9
            place.frozen |= late and abs(place.travel) > TRAVEL
        is_held = any(place.frozen for place in self._places)
        self.counter += is_held and not self._is_held
        self._is_held = is_held
        return is_held or self._stopped is not None

    def _begin(self, state: _State) -> None:
        self._places = [_Place(place, state.received_ns) for place in state.q]

    def _follow(self, before: _State, state: _State) -> None:
        h = (state.received_ns - before.received_ns) * 1e-9
        for j, (place, q, v) in enumerate(zip(self._places, state.q, state.qd, strict=True)):
            dither = BASE_DITHER if j < self._lead else DITHER
            turned = v * place.travel < 0.0  # it may have gone there and back between two states
            may_be_there = not place.frozen and (turned or abs(v) <= MOVES)
            if may_be_there or abs(q - place.at) > dither:
                self._places[j] = _Place(q, state.received_ns)
            elif not place.frozen:
                place.travel += v * h

    def _moved(self, a: tuple[float, ...], b: tuple[float, ...]) -> bool:
        lead = self._lead
        return any(
            abs(p - q) > (BASE_DITHER if j < lead else DITHER)
            for j, (p, q) in enumerate(zip(a, b, strict=True))
        )

    def _stops_impossibly(self, before: _State, state: _State, period_s: float) -> bool:
        """Return whether this state is at rest though the previous one was too fast to stop."""
        if not self._acceleration:  # states without an error, which a waterfall assumes
            return False
        fastest = max(map(abs, before.qd))
        if fastest <= MOVES or max(map(abs, state.qd)) > min(MOVES, STANDS_SHARE * fastest):
            return False
        speed_m_s = float(self._fastest_point(np.array(before.q), np.array(before.qd)))
        hardest = HARDEST * self._acceleration
        # by the counters: arrivals come in bunches
        since_s = (state.counter - before.measured) % COUNTERS * period_s + CYCLE_S
        follows = since_s <= LAG_S
        if follows and period_s > 0 and speed_m_s > hardest * since_s:
            return True
        if self._moved(before.q, state.q):
            return False
        if not follows:  # its velocity may be filtered, and so be late
            speed_m_s = max(speed_m_s - self._acceleration * LAG_S, 0.0)
        return speed_m_s**2 / (2 * hardest) > LEAST_WAY_M
