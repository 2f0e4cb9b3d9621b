"""Detects a sender slower than its source's ``rate_hz``; one note gives the remedy."""

WINDOW_NS = 5_000_000_000
"""Time over which the rate is measured,"""
PAUSE_NS = 3_000_000_000
"""minimum gap that is excluded: the sender was not started yet, or was stopped,"""
AGAIN_NS = 600_000_000_000
"""and minimum time between two notes."""
SLOW = 0.7
"""Fraction of ``rate_hz`` below which a sender is slow; occasional loss and jitter stay above
it."""


class SenderPace:
    """Measures the number of scenes that arrive per second.

    Args:
        rate_hz: the configured rate.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._begun: tuple[int, int] | None = None  # when, and scenes until then
        self._newest: tuple[int, int] = (0, 0)  # when a scene last came, and scenes until then
        self._said_ns: int | None = None

    def note(self, scenes: int, connected: bool, now_ns: int) -> str | None:
        """Return a message, if due.

        Args:
            scenes: scenes since the start.
            connected: whether the device is open; a pause measures nothing.
            now_ns: node's clock.
        """
        came_ns, until_then = self._newest
        if scenes != until_then:
            self._newest = (now_ns, scenes)
        paused = not until_then or now_ns - came_ns > PAUSE_NS
        if not connected or self._begun is None or paused:
            self._begun = (now_ns, scenes) if connected else None
            return None
        began_ns, before = self._begun
        if now_ns - began_ns < WINDOW_NS:
            return None
        self._begun = (now_ns, scenes)
        rate_hz = (scenes - before) * 1e9 / (now_ns - began_ns)
        if scenes == before or rate_hz >= SLOW * self._rate_hz:
            return None
        if self._said_ns is not None and now_ns - self._said_ns < AGAIN_NS:
            return None
        self._said_ns = now_ns
        return (
            f"{rate_hz:.1f} scenes per second arrive, and source.rate_hz is {self._rate_hz:g}: "
            f"each gap can make the advice unknown; set source.rate_hz to {rate_hz:.3g}, or let "
            f"the sender send faster"
        )
