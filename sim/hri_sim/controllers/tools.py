"""The tool that a simulated robot carries, and what its controller says of it."""

from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import Field

from hri_predict.base.settings import Settings
from hri_predict.robots.settings import MAX_TOOL


class ToolChange(Settings):
    """One entry of ``tools`` in a link's ``simulate:`` block: from then on it carries this tool."""

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
        changes: see ``ToolChange``; of those that have begun, the last one in time counts.
    """

    def __init__(self, changes: Sequence[ToolChange]) -> None:
        self._changes = sorted(changes, key=lambda change: change.at_s)
        self._start_ns: int | None = None

    def at(self, now_ns: int) -> Mounted:
        """Return what is mounted at ``now_ns``; the first call starts the time."""
        if self._start_ns is None:
            self._start_ns = now_ns
        since_s = (now_ns - self._start_ns) * 1e-9
        begun = [change for change in self._changes if change.at_s <= since_s]
        if not begun:
            return NOTHING
        after_s = begun[-1].confirmed_after_s
        confirmed = after_s is not None and since_s >= begun[-1].at_s + after_s
        return Mounted(begun[-1].tool, confirmed)
