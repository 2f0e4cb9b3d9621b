"""The tool of a simulated robot, and the controller's report of it."""

from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import Field

from hri_predict.base.settings import Settings
from hri_predict.robots.settings import MAX_TOOL


class ToolChange(Settings):
    """One entry of ``tools`` in a link's ``simulate:`` block: a change to this tool."""

    at_s: float = Field(0.0, ge=0, description="after the controller's first cycle")
    tool: int = Field(strict=True, ge=0, le=MAX_TOOL, description="number of the tool")
    confirmed_after_s: float | None = Field(
        0.0, ge=0, description="time until the controller has checked the tool; null: never"
    )


@dataclass(frozen=True, slots=True)
class Mounted:
    """A tool's number, and whether the controller has checked it; ``None``: not stated."""

    number: int | None = None
    confirmed: bool = False


NOTHING = Mounted()


class ToolChanger:
    """All tool changes of one controller.

    Args:
        changes: see ``ToolChange``; the latest change that is already due applies.
    """

    def __init__(self, changes: Sequence[ToolChange]) -> None:
        self._changes = sorted(changes, key=lambda change: change.at_s)
        self._start_ns: int | None = None

    def at(self, now_ns: int) -> Mounted:
        """Return the tool mounted at ``now_ns``; time starts with the first call."""
        if self._start_ns is None:
            self._start_ns = now_ns
        since_s = (now_ns - self._start_ns) * 1e-9
        begun = [change for change in self._changes if change.at_s <= since_s]
        if not begun:
            return NOTHING
        after_s = begun[-1].confirmed_after_s
        confirmed = after_s is not None and since_s >= begun[-1].at_s + after_s
        return Mounted(begun[-1].tool, confirmed)
