"""Whether a robot that may move is ever seen to move.

States that are frozen while a robot is at rest look like those of a waiting robot (``frozen``). But
a robot that is permitted to move for long, and whose joints do not change meanwhile, may be either.
It is not proven to be where it says until a joint changes.
"""

from hri_predict.robots.states.frozen import BASE_DITHER, DITHER


class StillCheck:
    """Measures for how long a robot was permitted to move without any change of its states.

    Time in which it was held by its advice does not count, so a robot that is stopped for people
    need not move to stay proven.

    Args:
        still_s: it is not proven alive after more than this time; ``None``: never doubted.
        lead: number of a moving base's coordinates, which come first.
    """

    def __init__(self, still_s: float | None, lead: int = 0) -> None:
        self._still_s = still_s
        self._lead = lead
        self._held: dict[str, tuple[float, ...]] = {}  # by link
        self._permitted_s = 0.0
        self._may_move_since_ns: int | None = None

    @property
    def is_proven(self) -> bool:
        """Whether its place can be trusted."""
        return self._still_s is None or self._permitted_s <= self._still_s

    def take(self, q: tuple[float, ...], link: str) -> None:
        """Take the place (N,), rad and m, that a state of a link reports."""
        held = self._held.setdefault(link, q)
        if any(
            abs(b - a) > (BASE_DITHER if j < self._lead else DITHER)
            for j, (a, b) in enumerate(zip(held, q, strict=True))
        ):
            self._held[link] = q
            self._permitted_s = 0.0

    def advise(self, limit_m_s: float, now_ns: int) -> None:
        """Note the speed limit that goes out at ``now_ns``; 0 for a stop."""
        if self._may_move_since_ns is not None:
            self._permitted_s += (now_ns - self._may_move_since_ns) * 1e-9
        self._may_move_since_ns = now_ns if limit_m_s > 0 else None
