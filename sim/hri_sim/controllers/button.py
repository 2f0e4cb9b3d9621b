"""The acknowledge button of a simulated controller, and the operator who presses it."""

from hri_predict.protocol.messages import Acknowledge

PAUSE_NS = 15_000_000_000
"""The operator waits so long between two presses: without a pause of 12 s none counts."""
_PRESSES = 1 << 32  # values of Acknowledge's ACK_ID, of which 0 is not used


class Button:
    """Pressed some time after there is something to acknowledge, and again while it stays.

    Args:
        after_s: from being shown to the press; ``None``: never pressed.

    Attributes:
        presses: number of presses.
    """

    def __init__(self, after_s: float | None) -> None:
        self.presses = 0
        self._after_s = after_s
        self._shown: tuple[int, int] | None = None  # latch id, when to press
        self._pressed_ns: int | None = None

    def show(self, latch_id: int, now_ns: int) -> None:
        """Show what the newest Advice says is to be acknowledged; 0: nothing."""
        if latch_id == 0:
            self._shown = None
        elif self._shown is None or self._shown[0] != latch_id:
            self._arm(latch_id, now_ns)

    def press(self, now_ns: int) -> Acknowledge | None:
        """Return the Acknowledge to send, if the operator presses now."""
        if self._shown is None or now_ns < self._shown[1]:
            return None
        latch_id, _ = self._shown
        self.presses += 1
        self._pressed_ns = now_ns
        self._arm(latch_id, now_ns)
        # numbered by the clock: after a restart of the controller no number comes again
        return Acknowledge(latch_id, 1 + now_ns // 1_000_000 % (_PRESSES - 1))

    def _arm(self, latch_id: int, now_ns: int) -> None:
        if self._after_s is None:
            return
        at_ns = now_ns + int(self._after_s * 1e9)
        if self._pressed_ns is not None:
            at_ns = max(at_ns, self._pressed_ns + PAUSE_NS)
        self._shown = (latch_id, at_ns)
