"""Converts readings to RobotState: units, maximum age, and whether the state is new."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from hri_drivers.links.polled.settings import BASE, BASE_VELOCITY, StateAt
from hri_predict.protocol.messages import BaseMotion, RobotMode, RobotState
from hri_predict.protocol.reception import ReceiveCounters

COUNTERS = 1 << 16
MOST, LEAST = 1e9, 1e-20
"""A robot reports no values beyond these limits; they mean that the bytes or words of a float are
swapped. The maximum is that of a value in rad or m: nanoradians in 32 bits are larger. Only a
velocity may be arbitrarily close to zero, because a filter may let it decay."""
RATES = ("velocity", *BASE_VELOCITY)
LONGEST_STEP_S = 0.06
"""Maximum time between two positions from which a velocity is derived. Such a velocity is half this
time old; a controller may filter its velocities for 0.03 s (``robots.states.frozen``)."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading.

    Attributes:
        values: values of ``StateAt.places``, in that order; ``None``: the server has no number.
        span_s: time from the previous request to this reply: a value that has changed in between is
            at most this old. ``None`` for the first reading of a connection.
        why: why a value is ``None``; one line, or "".
    """

    values: tuple[float | None, ...]
    span_s: float | None
    why: str = ""


def scales(state: StateAt[Any]) -> dict[str, float]:
    """Factors to rad, m, rad/s or m/s, by the names of the values that have a unit."""
    found = {}
    for number, joint in enumerate(state.joints, start=1):
        found[f"joint {number} position"] = joint.scale or state.scale
        found[f"joint {number} velocity"] = joint.scale or state.velocity_scale or state.scale
    if (base := state.base) is not None:
        found |= dict.fromkeys(("base x", "base y", "base vx", "base vy"), base.scale_m)
        found |= dict.fromkeys(("base yaw", "base yaw_rate"), base.scale_rad)
    return found


class StateReader:
    """Makes RobotStates of one robot; its counter advances when the heartbeat has changed.

    An impossible value is passed on as NaN, so that the node immediately treats the state as
    invalid. Dropping the state instead would leave the previous one in force.

    Args:
        state: addresses of the robot's state.
        max_age_s: a state that may be older is refused.
        controller_delay_s: age of the newest state when the server shows it.
        counters: counts what is received and what is refused.

    Attributes:
        robot: index of the robot.
        refused: why the last refused reading was refused; "" if none was.
    """

    def __init__(
        self,
        state: StateAt[Any],
        max_age_s: float,
        controller_delay_s: float,
        counters: ReceiveCounters,
    ) -> None:
        self.robot = 0
        self.refused = ""
        self._state = state
        self._names = [name for name, _ in state.places]
        self._scales = scales(state)
        self._max_age_s, self._controller_delay_s = max_age_s, controller_delay_s
        self._counters = counters
        self._beat: float | None = None
        self._counter = 0
        self._newest: RobotState | None = None
        self._before: tuple[float, tuple[float, ...]] | None = None  # heartbeat, coordinates

    def restart(self) -> None:
        """Discard everything, also after a gap: the next state may be as old as the gap."""
        self._beat = self._newest = self._before = None

    def read(self, sample: Sample) -> RobotState | None:
        """Return the state; it repeats the newest one while the heartbeat is unchanged.

        ``None``: no state, which is counted except for the first reading of a connection.
        """
        if len(sample.values) != len(self._names):
            self._refuse("not the requested values")
            self.restart()
            return None
        beat = sample.values[0]
        if beat is None or not math.isfinite(beat):
            self._refuse(sample.why or "heartbeat: not a number")
            self.restart()
            return None
        if beat == self._beat:
            return self._newest
        first, self._beat = self._beat is None, beat
        values = {
            name: self._sound(name, value, sample.why)
            for name, value in zip(self._names[1:], sample.values[1:], strict=True)
        }
        coordinates, velocities = self._coordinates(values), self._velocities(values)
        before, self._before = self._before, (beat, coordinates)
        if first or sample.span_s is None:
            return None  # may have been written long ago
        age_s = sample.span_s + self._controller_delay_s
        if velocities is None:
            velocities, step_s = self._derived(beat, coordinates, before)
            if velocities is None:
                return None
            age_s += step_s / 2  # a mean velocity is that of half a step ago
        if age_s > self._max_age_s:
            self._refuse(
                f"a state that can be {age_s:.3f} s old, more than {self._max_age_s:g}: the server "
                f"answers late, or is polled too rarely"
            )
            return None
        self._counter = (self._counter + 1) % COUNTERS
        self._counters.received += 1
        self._newest = self._robot_state(values, coordinates, velocities)
        return self._newest

    def _refuse(self, why: str) -> None:
        """Count a reading as refused, and record the cause."""
        self.refused = why
        self._counters.malformed += 1

    def _sound(self, name: str, value: float | None, why: str) -> float:
        """Return the number, or NaN for a value that no robot reports, which is counted."""
        if value is None:
            self._refuse(why or f"{name}: not a number")
            return math.nan
        scale = self._scales.get(name)
        if scale is None:  # a mode may be any number
            sound = math.isfinite(value)
        else:
            least = 0.0 if name.endswith(RATES) else LEAST
            sound = value == 0 or (least <= abs(value) and abs(value) * scale <= MOST)
        if sound:
            return float(value)
        self._refuse(
            f"{name} is {value:g}, which no robot reports; correct its address, or the type, "
            "byte_order, word_order or scale"
        )
        return math.nan

    def _coordinates(self, values: dict[str, float]) -> tuple[float, ...]:
        """Positions of all joints in rad or m, then x, y and yaw of a base."""
        found = [
            joint.sign * self._scaled(values, f"joint {number} position") + joint.offset_rad
            for number, joint in enumerate(self._state.joints, start=1)
        ]
        if self._state.base is not None:
            found += [self._scaled(values, f"base {name}") for name in BASE]
        return tuple(found)

    def _velocities(self, values: dict[str, float]) -> tuple[float, ...] | None:
        """Velocities in the order of ``_coordinates``; ``None`` if they must be derived."""
        if self._state.derives:
            return None
        found = [
            joint.sign * self._scaled(values, f"joint {number} velocity")
            for number, joint in enumerate(self._state.joints, start=1)
        ]
        if self._state.base is not None:
            found += [self._scaled(values, f"base {name}") for name in BASE_VELOCITY]
        return tuple(found)

    def _scaled(self, values: dict[str, float], name: str) -> float:
        return values[name] * self._scales[name]

    def _derived(
        self,
        beat: float,
        coordinates: Sequence[float],
        before: tuple[float, tuple[float, ...]] | None,
    ) -> tuple[tuple[float, ...] | None, float]:
        """Velocities from the change since the last reading (``None``: unknown), and the step."""
        assert self._state.tick_s is not None
        if before is None:
            return None, 0.0
        step_s = (beat - before[0]) * self._state.tick_s
        if step_s <= 0:  # the counter wrapped, or the controller was restarted
            self._counters.incomplete += 1
            return None, 0.0
        if step_s > LONGEST_STEP_S:
            self._refuse(
                f"{step_s:.3g} s between two readings is too long to derive velocities; read more "
                f"often, correct tick_s, or give the addresses of the velocities"
            )
            return None, 0.0
        moved = [b - a for a, b in zip(before[1], coordinates, strict=True)]
        if self._state.base is not None:
            moved[-1] = math.remainder(moved[-1], math.tau)
        return tuple(each / step_s for each in moved), step_s

    def _robot_state(
        self, values: dict[str, float], at: tuple[float, ...], moving: tuple[float, ...]
    ) -> RobotState:
        state = self._state
        is_automatic = state.automatic
        if state.mode is not None:
            is_automatic = values["mode"] in state.automatic_values
        joints = len(state.joints)
        found = RobotState(
            robot=self.robot,
            mode=RobotMode.AUTOMATIC if is_automatic else RobotMode.UNKNOWN,
            counter=self._counter,
            positions=at[:joints],
            velocities=moving[:joints],
        )
        if state.base is None:
            return found
        x_m, y_m, yaw_rad = at[joints:]
        vx_m_s, vy_m_s, yaw_rate_rad_s = moving[joints:]
        base = BaseMotion(
            x_m=x_m,
            y_m=y_m,
            yaw_rad=yaw_rad,
            vx_m_s=vx_m_s,
            vy_m_s=vy_m_s,
            yaw_rate_rad_s=yaw_rate_rad_s,
        )
        return replace(found, base=base)
