"""Requests of the controllers of a robot: its operating mode, the request, the enabling device.

A robot may have several controllers, each on a link of its own. What they ask counts only if all
that were heard lately ask the same: one of two channels alone changes no mode.
"""

from dataclasses import dataclass, replace

from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """Requests at one moment.

    Attributes:
        mode: the controllers' operating mode; UNKNOWN if they differ.
        request: the operating mode that is asked for.
        enabling: whether all say that the enabling device is held.
        heard: whether a fresh RobotState says so.
        agreed: whether all controllers ask for the same.
    """

    mode: RobotMode = RobotMode.AUTOMATIC
    request: OperatingMode = OperatingMode.AUTOMATIC
    enabling: bool = False
    heard: bool = False
    agreed: bool = True


NOTHING_ASKED = ModeRequest()


class ModeRequests:
    """Keeps what the newest RobotState of each link asks."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[ModeRequest, int]] = {}

    def take(self, state: RobotState, received_ns: int, link: str) -> None:
        """Take an acceptable RobotState."""
        asked = ModeRequest(state.mode, state.request, state.enabling is True, heard=True)
        self._newest[link] = (asked, received_ns)

    def at(self, now_ns: int, stale_s: float) -> ModeRequest:
        """Return the requests at ``now_ns`` of all links that were heard within ``stale_s``."""
        fresh = [a for a, at_ns in self._newest.values() if now_ns - at_ns <= stale_s * 1e9]
        if not fresh:
            return NOTHING_ASKED
        first, *others = fresh
        for other in others:
            first = _both(first, other)
        return first


def _both(a: ModeRequest, b: ModeRequest) -> ModeRequest:
    return replace(
        a,
        mode=a.mode if a.mode is b.mode else RobotMode.UNKNOWN,
        request=max(a.request, b.request),
        enabling=a.enabling and b.enabling,
        agreed=a.agreed and b.agreed and a.request is b.request,
    )
