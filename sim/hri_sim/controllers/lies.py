"""Scheduled behaviour of a simulated controller: lies, and modes that an operator requests."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Settings
from hri_predict.protocol.messages import OperatingMode, RobotMode


class _Timed(Settings):
    """Temporary behaviour of a simulated controller."""

    start_s: float = Field(0.0, ge=0, description="after the controller's first cycle")
    duration_s: float | None = Field(None, gt=0, description="default: to the end")

    def active(self, since_s: float) -> bool:
        """Return whether the behaviour is active ``since_s`` seconds after the controller's first
        cycle.
        """
        end_s = float("inf") if self.duration_s is None else self.start_s + self.duration_s
        return self.start_s <= since_s < end_s


class LieSettings(_Timed):
    """One entry of ``lies`` in a link's ``simulate:`` block."""

    kind: Literal[
        "flip",
        "zero",
        "degrees",
        "jump",
        "hold",
        "freeze",
        "stand",
        "runs",
        "brakes_late",
        "acknowledges",
    ] = Field(
        description="velocities in RobotState: flip, zero, degrees; positions: jump, hold (the "
        "first are repeated, velocities are true); both: freeze (the first are "
        "repeated), stand (the first positions are repeated, velocities are 0); "
        "robot motion: runs (at full speed, at any permitted speed above 0), "
        "brakes_late; acknowledges: acknowledges on its own, like a button that is "
        "held down"
    )
    jump_rad: float = Field(1.0, description="for jump: added to the first joint")
    factor: float = Field(
        3.0, ge=1, le=100, description="for brakes_late: factor by which the stopping time grows"
    )
    period_s: float = Field(
        1.0, gt=0, le=60, description="for acknowledges: interval between two Acknowledges"
    )
    ids: int = Field(
        255,
        ge=1,
        le=65_535,
        description="for acknowledges: number of different ids that it uses, in turn",
    )
    names: Literal["shown", "first", "nothing"] = Field(
        "shown",
        description="for acknowledges: the latch id shown now, the first ever shown, or 0",
    )


class Lies:
    """All lies of one controller.

    Args:
        settings: see ``LieSettings``.
    """

    def __init__(self, settings: Sequence[LieSettings]) -> None:
        self._settings = settings
        self._start_ns: int | None = None
        self._first: dict[int, tuple[Floats, Floats]] = {}  # joints when a lie began

    def told(self, q: Floats, qd: Floats, now_ns: int) -> tuple[Floats, Floats]:
        """Return the joints (N,), rad and rad/s, that RobotState reports at ``now_ns``."""
        for lie in self._now(now_ns):
            first_q, first_qd = self._first.setdefault(id(lie), (q, qd))
            if lie.kind in ("hold", "freeze", "stand"):
                q = first_q
            if lie.kind == "freeze":
                qd = first_qd
            elif lie.kind == "stand":
                qd = np.zeros_like(qd)
            elif lie.kind == "flip":
                qd = -qd
            elif lie.kind == "zero":
                qd = np.zeros_like(qd)
            elif lie.kind == "degrees":
                qd = np.rad2deg(qd)
            elif lie.kind == "jump":
                q = q.copy()
                q[0] += lie.jump_rad
        return q, qd

    def permitted(self, limit_m_s: float, full_m_s: float, now_ns: int) -> float:
        """Return the speed that the arm treats as permitted."""
        runs = any(lie.kind == "runs" for lie in self._now(now_ns))
        return full_m_s if runs and limit_m_s > 0 else limit_m_s

    @property
    def brakes_slower(self) -> float:
        """Factor by which the stopping time of the arm grows."""
        return max((lie.factor for lie in self._settings if lie.kind == "brakes_late"), default=1.0)

    def _now(self, now_ns: int) -> list[LieSettings]:
        if self._start_ns is None:
            self._start_ns = now_ns
        since_s = (now_ns - self._start_ns) * 1e-9
        return [lie for lie in self._settings if lie.active(since_s)]


# -- requests of the operator at a simulated controller: operating modes, at set times -------------


class RequestSettings(_Timed):
    """One entry of ``requests`` in a link's ``simulate:`` block."""

    request: Literal["teach", "recovery", "muted"] = Field(description="requested operating mode")
    enabling: bool = Field(True, description="whether the enabling device is held during this time")
    manual: bool | None = Field(
        None, description="whether the controller is in manual mode; default: for teach"
    )


@dataclass(frozen=True, slots=True)
class Said:
    """Content of RobotState besides the joints."""

    mode: RobotMode = RobotMode.AUTOMATIC
    request: OperatingMode = OperatingMode.AUTOMATIC
    enabling: bool = False


AUTOMATIC = Said()


class Requests:
    """All requests of one controller; if several are active, the first in the list applies.

    Args:
        settings: see ``RequestSettings``.
    """

    def __init__(self, settings: Sequence[RequestSettings]) -> None:
        self._settings = settings
        self._start_ns: int | None = None

    def said(self, now_ns: int) -> Said:
        """Return the content of RobotState at ``now_ns``."""
        if self._start_ns is None:
            self._start_ns = now_ns
        since_s = (now_ns - self._start_ns) * 1e-9
        for each in self._settings:
            if each.active(since_s):
                manual = each.request == "teach" if each.manual is None else each.manual
                mode = RobotMode.MANUAL if manual else RobotMode.AUTOMATIC
                return Said(mode, OperatingMode[each.request.upper()], each.enabling)
        return AUTOMATIC
