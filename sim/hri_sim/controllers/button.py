"""The acknowledge button of a simulated controller, and the operator who presses it."""

from collections.abc import Sequence

from hri_predict.protocol.messages import Acknowledge
from hri_sim.controllers.lies import LieSettings

PAUSE_NS = 15_000_000_000
"""Time between two presses of the operator; a press is ignored without a pause of 12 s."""
START_NS = 13_000_000_000
"""Time from a node's first Advice to the first press; earlier than 12 s, presses are ignored."""
SILENCE_NS = 1_000_000_000
"""After a longer silence, the next Advice is treated as the first of another run."""
HELD_NS = 500_000_000
"""Time from a press to the release, which a controller reports in any case."""
_PRESSES = 1 << 32  # values of Acknowledge's ACK_ID, of which 0 is not used


class Button:
    """A button pressed some time after a latch id is shown, and again while it stays shown.

    Args:
        after_s: time from showing a latch id to the press, which is delayed while presses would be
            ignored; ``None``: never pressed.
        lies: cases in which the controller acknowledges by itself instead.

    Attributes:
        presses: number of presses.
    """

    def __init__(self, after_s: float | None, lies: Sequence[LieSettings] = ()) -> None:
        self.presses = 0
        self._after_s = after_s
        self._automatic = [_Automatic(lie) for lie in lies if lie.kind == "acknowledges"]
        self._shown: tuple[int, int] | None = None  # latch id, when to press
        self._pressed_ns: int | None = None
        self._down: tuple[int, int] | None = None  # ack id, when to let go
        self._heard_ns: int | None = None
        self._counts_ns = 0  # from when on a press counts

    def show(self, latch_id: int, now_ns: int) -> None:
        """Show the latch id of the newest Advice, to be acknowledged; 0: nothing."""
        if self._heard_ns is None or now_ns - self._heard_ns > SILENCE_NS:
            self._counts_ns, self._shown = now_ns + START_NS, None
        self._heard_ns = now_ns
        for automatic in self._automatic:
            automatic.show(latch_id)
        if latch_id == 0:
            self._shown = None
        elif self._shown is None or self._shown[0] != latch_id:
            self._arm(latch_id, now_ns)

    def press(self, now_ns: int) -> list[Acknowledge]:
        """Return the Acknowledges to send now."""
        by_itself = [press for each in self._automatic if (press := each.press(now_ns))]
        self.presses += len(by_itself)
        if self._down is not None and now_ns >= self._down[1]:
            by_itself.append(Acknowledge(0, self._down[0]))
            self._down = None
        if self._shown is None or now_ns < self._shown[1]:
            return by_itself
        latch_id, _ = self._shown
        self.presses += 1
        self._pressed_ns = now_ns
        self._arm(latch_id, now_ns)
        # numbered by the clock: after a restart of the controller no number comes again
        ack_id = 1 + now_ns // 1_000_000 % (_PRESSES - 1)
        self._down = (ack_id, now_ns + HELD_NS)
        return [*by_itself, Acknowledge(latch_id, ack_id)]

    def _arm(self, latch_id: int, now_ns: int) -> None:
        if self._after_s is None:
            return
        at_ns = max(now_ns + int(self._after_s * 1e9), self._counts_ns)
        if self._pressed_ns is not None:
            at_ns = max(at_ns, self._pressed_ns + PAUSE_NS)
        self._shown = (latch_id, at_ns)


class _Automatic:
    """A button that is held down, or a program that acknowledges on its own."""

    def __init__(self, lie: LieSettings) -> None:
        self._lie = lie
        self._shown = self._first = self._count = 0
        self._start_ns: int | None = None
        self._next_ns = 0

    def show(self, latch_id: int) -> None:
        """Record the latch id of the newest Advice."""
        self._shown = latch_id
        self._first = self._first or latch_id

    def press(self, now_ns: int) -> Acknowledge | None:
        """Return the Acknowledge that is due now, if any."""
        lie = self._lie
        if self._start_ns is None:
            self._start_ns = now_ns
            self._next_ns = now_ns + round(lie.start_s * 1e9)
        ends_s = float("inf") if lie.duration_s is None else lie.start_s + lie.duration_s
        if now_ns < self._next_ns or now_ns - self._start_ns >= ends_s * 1e9:
            return None
        self._next_ns = now_ns + round(lie.period_s * 1e9)
        self._count += 1
        named = {"shown": self._shown, "first": self._first, "nothing": 0}[lie.names]
        return Acknowledge(named, 1 + (self._count - 1) % lie.ids)
