"""Validity of Acknowledges: button presses by a person who saw the displayed condition.

A button that is taped down, a controller that acknowledges by itself, and a replayed recording all
send well-formed Acknowledges. These name a latch that was not displayed, arrive too soon after it
was shown, or arrive without a pause. So an Acknowledge counts if

- it names the ``latch_id`` that this link is shown now, and has been shown for ``SHOWN_S``;
- no other Acknowledge has come on this link for ``QUIET_S``, since the node's start at least: the
  button was seen released. Acknowledges for several robots within ``TOGETHER_S`` are one press.

A repetition of an Acknowledge within ``REPEATS_S`` is the same message, and is ignored; a later one
is a replay and never counts.

An Acknowledge with latch id 0 and the number of a press says that its button was released. With
``supervised``, a press counts only then, if it lasted from ``SHORTEST_S`` to ``LONGEST_S``, and its
latch was shown all the time: a button that is stuck, taped down or bridged is never released.
"""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from hri_predict.protocol.messages import Acknowledge, Advice

SHOWN_S = 1.0
"""Minimum time to read a display, look into the cell and press; the reaction alone takes 0.5 s."""
QUIET_S = 12.0
"""Pause before a press that counts. Timers in controllers' programs run for up to 10 s."""
TOGETHER_S = 0.5
"""Interval in which a controller sends one button's presses for several robots: a few of its
cycles.
"""
REPEATS_S = 2.0
"""Interval in which a controller repeats one Acknowledge in case a frame is lost."""
SHORTEST_S, LONGEST_S = 0.15, 3.0
"""Duration of a supervised press. A bouncing contact is shorter, a button held by an object
longer.
"""
HELD_AT = 3
"""Number of consecutive Acknowledges, each too soon after the previous one, that is treated as a
fault; a person who presses twice by mistake causes one.
"""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Press:
    """A valid press: its latch, and the time at which the button was pressed, node's clock."""

    latch_id: int
    down_ns: int


@dataclass(slots=True)
class _Line:
    """Acknowledges received on one link.

    Attributes:
        heard_ns: arrival of the newest Acknowledge, except repeats; initially the node's start.
        pressed_ns: start of the newest press, which is an Acknowledge after a pause.
        in_a_row: number of Acknowledges since then that do not belong to the press.
        seen: (latch id, ack id) -> time of first arrival, for the newest ones.
        down: ack id -> its presses not yet released; none for a refused press.
    """

    heard_ns: int
    pressed_ns: int | None = None
    in_a_row: int = 0
    seen: dict[tuple[int, int], int] = field(default_factory=dict)
    down: dict[int, tuple[Press, ...]] = field(default_factory=dict)


_MOST_SEEN = 64


class Presses:
    """Checks the Acknowledges of all links.

    Args:
        supervised: whether a press counts only when its button is released.

    Attributes:
        refused: reason -> number of invalid Acknowledges.
    """

    def __init__(self, supervised: bool = False) -> None:
        self._supervised = supervised
        self.refused: Counter[str] = Counter()
        self._lines: dict[str, _Line] = {}
        self._start_ns: int | None = None
        self._shown: dict[int, tuple[int, int]] = {}  # robot -> its latch id, and since when

    def show(self, advices: Sequence[Advice], now_ns: int) -> None:
        """Record the latches displayed to the operators from now on."""
        if self._start_ns is None:
            self._start_ns = now_ns
        for advice in advices:
            if self._shown.get(advice.robot, (0, 0))[0] != advice.latch_id:
                self._shown[advice.robot] = (advice.latch_id, now_ns)

    def take(
        self, link: str, robots: frozenset[int], message: Acknowledge, at_ns: int
    ) -> tuple[Press, ...]:
        """Return the presses that become valid with this Acknowledge.

        Args:
            link: name of the link it arrived on.
            robots: indices of the robots that are advised on this link.
            message: the Acknowledge.
            at_ns: time of receipt.
        """
        start_ns = at_ns if self._start_ns is None else self._start_ns
        line = self._lines.setdefault(link, _Line(start_ns))
        pair = (message.latch_id, message.ack_id)
        first_ns = line.seen.get(pair)
        if first_ns is not None and at_ns - first_ns <= REPEATS_S * 1e9:
            return ()  # the same message again
        line.seen.setdefault(pair, at_ns)
        if len(line.seen) > _MOST_SEEN:
            del line.seen[next(iter(line.seen))]
        if message.latch_id == 0 and message.ack_id in line.down:
            return self._released(link, robots, message, at_ns)
        why = self._why_not(line, robots, message.latch_id, at_ns)
        if first_ns is not None:
            why = why or "replayed"
        if why:  # one that is refused also ends what was begun
            line.down = {message.ack_id: ()} if message.latch_id else {}
            self._refuse(link, message, why)
            return ()
        press = Press(message.latch_id, at_ns)
        line.down[message.ack_id] = (*line.down.get(message.ack_id, ()), press)
        return () if self._supervised else (press,)

    def _released(
        self, link: str, robots: frozenset[int], message: Acknowledge, at_ns: int
    ) -> tuple[Press, ...]:
        """Check released presses; without ``supervised`` they were already counted."""
        line = self._lines[link]
        line.heard_ns = at_ns
        presses = line.down.pop(message.ack_id)
        if not self._supervised:
            return ()
        if not presses:
            self._refuse(link, message, "no_press")
        counting = []
        for press in presses:
            held_s = (at_ns - press.down_ns) * 1e-9
            since_ns = self._shown_ns(robots, press.latch_id)
            if not SHORTEST_S <= held_s <= LONGEST_S:
                why = "too_short" if held_s < SHORTEST_S else "too_long"
                self._refuse(link, Acknowledge(press.latch_id, message.ack_id), why)
            elif since_ns is None or since_ns > press.down_ns:
                self._refuse(link, Acknowledge(press.latch_id, message.ack_id), "not_kept")
            else:
                counting.append(press)
        return tuple(counting)

    def are_held(self, now_ns: int) -> bool:
        """Whether Acknowledges arrive continuously on any link."""
        return any(
            line.in_a_row >= HELD_AT and now_ns - line.heard_ns < QUIET_S * 1e9
            for line in self._lines.values()
        )

    def _why_not(self, line: _Line, robots: frozenset[int], latch_id: int, at_ns: int) -> str:
        """Return why a non-repeated Acknowledge is invalid; "" if it is valid."""
        after_pause = at_ns - line.heard_ns >= QUIET_S * 1e9
        line.heard_ns = at_ns
        if after_pause:
            line.pressed_ns, line.in_a_row = at_ns, 0
        together = line.pressed_ns is not None and at_ns - line.pressed_ns <= TOGETHER_S * 1e9
        if not together:
            line.in_a_row += 1
        if latch_id == 0:
            return "names_nothing"
        since_ns = self._shown_ns(robots, latch_id)
        if since_ns is None:
            return "not_shown"
        if at_ns - since_ns < SHOWN_S * 1e9:
            return "too_soon"
        return "" if together else "no_pause"

    def _shown_ns(self, robots: frozenset[int], latch_id: int) -> int | None:
        """Return the time since which a latch id has been shown for any of these robots; ``None``
        if it is not shown.
        """
        since_ns = [s for r, (n, s) in self._shown.items() if r in robots and n == latch_id]
        return min(since_ns, default=None)

    def _refuse(self, link: str, message: Acknowledge, why: str) -> None:
        if self.refused[why] % 1000 == 0:  # a controller must not fill the log
            log.warning(
                "link %s: Acknowledge of latch id %d does not count: %s (%d such before)",
                link,
                message.latch_id,
                _WORDS[why],
                self.refused[why],
            )
        self.refused[why] += 1


_WORDS = {
    "names_nothing": "latch id 0 acknowledges nothing, and no press with this number waits for its"
    " release; since protocol version 3 a press must name the latch id of the Advice",
    "not_shown": "the Advice does not show this latch id now",
    "too_soon": f"it came within {SHOWN_S:g} s of being shown, sooner than a person presses",
    "replayed": f"it came more than {REPEATS_S:g} s ago already; give each press its own number",
    "no_pause": f"it came less than {QUIET_S:g} s after another one or after the node's start;"
    f" wait {QUIET_S:g} s, then press once",
    "no_press": "its button's press did not count, or another Acknowledge came before the release",
    "too_short": f"the button was released within {SHORTEST_S:g} s; press it longer",
    "too_long": f"the button was held for more than {LONGEST_S:g} s; press it and let go",
    "not_kept": "while the button was held, the Advice did not show this latch id all the time",
}
