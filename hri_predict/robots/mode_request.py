"""Requests from a robot's controllers: operating mode, requested mode and enabling device.

A robot may have several controllers, each on its own link. Their requests are valid only if all
agree, so that one of two channels alone cannot change the mode. A controller that was heard before
and is silent now agrees with nothing: else a pulled cable would grant what it refuses.
"""

from dataclasses import dataclass, replace

from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """The requests at one moment.

    Attributes:
        mode: the controllers' operating mode; UNKNOWN if they differ.
        request: the requested operating mode.
        enabling: whether all report that the enabling device is held.
        heard: whether there is a fresh RobotState.
        agreed: whether all controllers ever heard are heard now, and request the same.
    """

    mode: RobotMode = RobotMode.AUTOMATIC
    request: OperatingMode = OperatingMode.AUTOMATIC
    enabling: bool = False
    heard: bool = False
    agreed: bool = True


NOTHING_ASKED = ModeRequest()


class ModeRequests:
    """Keeps the request in the newest RobotState of each link."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[ModeRequest, int]] = {}

    def take(self, state: RobotState, received_ns: int, link: str) -> None:
        """Process an accepted RobotState."""
        asked = ModeRequest(state.mode, state.request, state.enabling is True, heard=True)
        self._newest[link] = (asked, received_ns)

    def at(self, now_ns: int, stale_s: float) -> ModeRequest:
        """Return the requests at ``now_ns`` from all links received within ``stale_s``."""
        fresh = [a for a, at_ns in self._newest.values() if now_ns - at_ns <= stale_s * 1e9]
        if not fresh:
            return NOTHING_ASKED
        first, *others = fresh
        for other in others:
            first = _both(first, other)
        return first if len(fresh) == len(self._newest) else replace(first, agreed=False)


def _both(a: ModeRequest, b: ModeRequest) -> ModeRequest:
    return replace(
        a,
        mode=a.mode if a.mode is b.mode else RobotMode.UNKNOWN,
        request=max(a.request, b.request),
        enabling=a.enabling and b.enabling,
        agreed=a.agreed and b.agreed and a.request is b.request,
    )
