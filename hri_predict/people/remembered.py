"""Lost people across a restart of the node: where they were last seen, and how long ago."""

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hri_predict.people.lost import LostPeople
from hri_predict.people.ring_buffer import NEVER, RingBuffer
from hri_predict.people.track import Track


class RemembersLost:
    """The part of ``People`` that carries lost people across a restart."""

    _lock: threading.Lock
    _lost: LostPeople
    _now_ns: int
    _recalled: list[dict[str, Any]]  # lost people of an earlier run, not yet taken
    _has_recalled: bool

    def _history(self) -> RingBuffer:
        raise NotImplementedError

    def remember(self) -> dict[str, Any]:
        """Lost people, for a restart of the node."""
        with self._lock:
            tracks = self._lost.tracks
            lost = [*lost_as_data(tracks, self._now_ns), *self._recalled]
            return {"lost": lost, "forgotten": self._lost.forgotten}

    def recall(self, data: Mapping[str, Any]) -> None:
        """Take the lost people of an earlier run; they appear with the next snapshot or scene."""
        recalled = list(data["lost"])
        lost_from_data(recalled, self._history, 0)  # refuses what is wrong
        with self._lock:
            self._recalled = recalled
            self._lost.forgotten |= bool(data["forgotten"])
            self._has_recalled = True

    def distrust(self, why: str) -> None:
        """Nobody knows who was lost: the room must be seen empty, or somebody acknowledges."""
        with self._lock:
            self._lost.forgotten |= not self._has_recalled

    def _take_recalled(self, now_ns: int) -> None:
        recalled, self._recalled = self._recalled, []
        for track in lost_from_data(recalled, self._history, now_ns):
            self._lost.add(track)


def lost_as_data(tracks: Sequence[Track], now_ns: int) -> list[dict[str, Any]]:
    """Return lost people as plain data; a joint that was never observed is ``None``."""
    return [
        {
            "id": track.id,
            "ago_s": max(now_ns - track.capture_ns, 0) * 1e-9,
            "positions": [
                None if np.isnan(joint).any() else [round(float(v), 4) for v in joint]
                for joint in track.positions
            ],
        }
        for track in tracks
    ]


def lost_from_data(
    people: Sequence[Mapping[str, Any]], history: Callable[[], RingBuffer], now_ns: int
) -> list[Track]:
    """Return the tracks of ``lost_as_data``. Their ids are negative: a source that was restarted
    may give the old numbers to others.

    Raises:
        KeyError, TypeError, ValueError: not as ``lost_as_data`` gives them.
    """
    tracks = []
    for person in people:
        ring = history()
        rows = [[np.nan] * 3 if p is None else [float(v) for v in p] for p in person["positions"]]
        positions = np.array(rows, dtype=float)
        if positions.shape != (ring.joints, 3) or not np.isfinite(positions).any():
            raise ValueError("a lost person's joints are wrong")
        seen_ns = now_ns - round(float(person["ago_s"]) * 1e9)
        known = np.isfinite(positions).all(axis=1)
        number = int(person["id"])
        tracks.append(
            Track(
                id=number if number < 0 else -1 - number,
                history=ring,
                positions=np.where(known[:, None], positions, np.nan),
                stamps=np.where(known, seen_ns, NEVER),
                capture_ns=seen_ns,
                present_ns=seen_ns,
            )
        )
    return tracks
