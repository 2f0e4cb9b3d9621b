"""Check that a robot that is free to move is seen to move.

States that are frozen while a robot is at rest look like those of a waiting robot (``frozen``). But
if a robot is permitted to move for a long time and its joints do not change, its state may be
frozen. Its reported position is then unproven until a joint changes.
"""

from hri_predict.robots.states.frozen import BASE_DITHER, DITHER


class StillCheck:
    """Measures the time for which a robot was permitted to move without any change of its states.

    Time during which its advice stopped it is excluded, so a robot that is stopped for people need
    not move to stay proven.

    Args:
        still_s: time after which its position is unproven; ``None``: never.
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
        """Whether its position can be trusted."""
        return self._still_s is None or self._permitted_s <= self._still_s

    def take(self, q: tuple[float, ...], link: str) -> None:
        """Process the position (N,), rad and m, from a state of a link."""
        held = self._held.setdefault(link, q)
        if any(
            abs(b - a) > (BASE_DITHER if j < self._lead else DITHER)
            for j, (a, b) in enumerate(zip(held, q, strict=True))
        ):
            self._held[link] = q
            self._permitted_s = 0.0

    def advise(self, limit_m_s: float, now_ns: int) -> None:
        """Record the speed limit sent at ``now_ns``; 0 for a stop."""
        if self._may_move_since_ns is not None:
            self._permitted_s += (now_ns - self._may_move_since_ns) * 1e-9
        self._may_move_since_ns = now_ns if limit_m_s > 0 else None
