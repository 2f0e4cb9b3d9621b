"""Requests of the operator at a simulated controller: operating modes, at set times."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from hri_predict.base.settings import Settings
from hri_predict.protocol.messages import OperatingMode, RobotMode


class RequestSettings(Settings):
    """One entry of ``requests`` in a link's ``simulate:`` block."""

    request: Literal["teach", "recovery", "muted"] = Field(description="requested operating mode")
    start_s: float = Field(0.0, ge=0, description="after the controller's first cycle")
    duration_s: float | None = Field(None, gt=0, description="default: to the end")
    enabling: bool = Field(True, description="whether the enabling device is held meanwhile")
    manual: bool | None = Field(
        None, description="whether the controller is in manual mode; default: for teach"
    )


@dataclass(frozen=True, slots=True)
class Said:
    """Content of RobotState besides the joints."""

    mode: RobotMode = RobotMode.AUTOMATIC
    request: OperatingMode = OperatingMode.AUTOMATIC
    enabling: bool = False


class Requests:
    """All requests of one controller; of several at a time the first in the list counts.

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
            end_s = float("inf") if each.duration_s is None else each.start_s + each.duration_s
            if each.start_s <= since_s < end_s:
                manual = each.request == "teach" if each.manual is None else each.manual
                mode = RobotMode.MANUAL if manual else RobotMode.AUTOMATIC
                return Said(mode, OperatingMode[each.request.upper()], each.enabling)
        return Said()
