"""Observed people as canonical joints, and their actual motion."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.joint_map import JointMap
from hri_predict.explaining.values import listed, mapped, text, whole
from hri_predict.recording import Told

LONGEST_GAP_NS = 200_000_000
"""Maximum interval between two captures within which a joint's position is known."""
_OFFSETS = 25


@dataclass(frozen=True, slots=True, eq=False)
class SeenPerson:
    """One person of one scene: (J, 3) metres, room frame, and (J,) whether each joint was
    observed.
    """

    person: int
    stamp_ns: int
    positions: Floats
    observed: Bools


def people_of(scene: Told, joint_map: JointMap) -> list[SeenPerson]:
    """Return the people of a scene; people with invalid numbers are left out."""
    stamp_ns = whole(scene.data.get("capture_ns"))
    found = []
    for person in map(mapped, listed(scene.data.get("people"))):
        id_ = whole(person.get("id"))
        joints = _joints(person, len(joint_map.source_joints))
        if id_ is not None and stamp_ns is not None and joints is not None:
            found.append(SeenPerson(id_, stamp_ns, *joint_map.map(*joints)))
    return found


def _joints(person: Any, count: int) -> tuple[Floats, Bools] | None:
    observed = np.array([c == "1" for c in text(person.get("observed"))], dtype=np.bool_)
    try:
        raw = person.get("positions")
        positions = np.array(
            [[np.nan if v is None else v for v in joint] for joint in raw], dtype=np.float64
        )
    except (TypeError, ValueError, OverflowError):
        return None
    if positions.shape != (count, 3) or observed.shape != (count,):
        return None
    return positions, observed


class Offset:
    """Offset of the node's clock from the source's, estimated from forecasts and preceding
    scenes.
    """

    def __init__(self) -> None:
        self._found: deque[int] = deque(maxlen=_OFFSETS)

    def learn(self, forecast: Told, stamps: dict[int, int]) -> None:
        """``stamps`` has each person's newest stamp when the forecast was made."""
        ids, captures = listed(forecast.data.get("ids")), listed(forecast.data.get("capture_ns"))
        for id_, capture_ns in zip(ids, captures, strict=False):
            if isinstance(id_, int) and id_ in stamps and whole(capture_ns) is not None:
                self._found.append(capture_ns - stamps[id_])

    @property
    def ns(self) -> int | None:
        """Return the median of the newest offsets; ``None`` before the first."""
        return sorted(self._found)[len(self._found) // 2] if self._found else None


def place_at(track: Sequence[SeenPerson], stamp_ns: int) -> tuple[Floats, Bools] | None:
    """Return a person's position between two captures (source's clock); ``None``: not observed.

    Args:
        track: observations of one person, by stamp.
    """
    after = next((k for k, seen in enumerate(track) if seen.stamp_ns >= stamp_ns), None)
    if after is None:
        return None
    late = track[after]
    if late.stamp_ns == stamp_ns or after == 0:
        return (late.positions, late.observed) if late.stamp_ns == stamp_ns else None
    early = track[after - 1]
    gap_ns = late.stamp_ns - early.stamp_ns
    if gap_ns > LONGEST_GAP_NS:
        return None
    share = (stamp_ns - early.stamp_ns) / gap_ns
    positions = early.positions + share * (late.positions - early.positions)
    return positions, early.observed & late.observed
