"""Stores lost people across a restart of the node: last seen positions and ages."""

import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import sound_error_m
from hri_predict.people.lost.lost_people import Lost, LostPeople
from hri_predict.people.lost.unplaced import Unplaced

_LONG_AGO_S = 1e8


class RemembersLost:
    """Part of ``People`` that preserves lost people across a restart."""

    _lock: threading.Lock
    _lost: LostPeople
    _counters: Counter[str]
    _unplaced: Unplaced
    _now_ns: int
    _recalled: list[dict[str, Any]]  # lost people of an earlier run, not yet taken
    _since_s: Callable[[], float] = float  # since they were recalled
    _has_recalled: bool

    def remember(self) -> dict[str, Any]:
        """Return the lost people as data for a restart of the node."""
        with self._lock:
            lost = [*lost_as_data(self._lost.people, self._now_ns), *self._recalled]
            forgotten = self._lost.forgotten or bool(self._unplaced)
            data = {"lost": lost, "forgotten": forgotten}
            return data | ({"distrusted": True} if self._lost.distrusted else {})

    def recall(self, data: Mapping[str, Any], since_s: Callable[[], float] = float) -> None:
        """Restore the lost people of an earlier run; they appear in the next snapshot.

        ``since_s`` returns the seconds since this call, by which they are older then.

        Raises:
            KeyError, TypeError, ValueError: the data do not match the output of ``remember``.
        """
        recalled = list(data["lost"])
        lost_from_data(recalled, 0)  # refuses wrong data
        with self._lock:
            self._recalled, self._since_s = recalled, since_s
            self._lost.forgotten |= bool(data["forgotten"])
            self._lost.distrusted |= bool(data.get("distrusted"))
            self._has_recalled = True

    def distrust(self, why: str) -> None:
        """Record unknown lost people: a person may be anywhere until an acknowledgement."""
        with self._lock:
            if not self._has_recalled:
                self._lost.forgotten = self._lost.distrusted = True

    def lose_scene(self, receipt_ns: int) -> int:
        """Record a scene that could not be processed: its people may be anywhere until an
        acknowledgement. Return the number of such scenes.
        """
        with self._lock:
            self._counters["failed_scenes"] += 1
            self._lost.lose_places([receipt_ns])
            return self._counters["failed_scenes"]

    def _take_recalled(self, now_ns: int) -> None:
        recalled, self._recalled = self._recalled, []
        if not recalled:
            return
        for lost in lost_from_data(recalled, now_ns - round(self._since_s() * 1e9)):
            self._lost.keep(lost)


def lost_as_data(people: Sequence[Lost], now_ns: int) -> list[dict[str, Any]]:
    """Return lost people as plain data; a joint that was never observed is ``None``."""
    return [
        {
            "id": lost.id,
            "ago_s": max(now_ns - lost.capture_ns, 0) * 1e-9,
            "speed_m_s": lost.speed_m_s,
            **({"error_m": lost.error_m} if lost.error_m else {}),
            **_by_joint("joint_age_s", np.where(np.isinf(lost.joint_age_s), 0.0, lost.joint_age_s)),
            **_by_joint("limbs_m_s", lost.limbs_m_s),
            "positions": [
                None if np.isnan(joint).any() else [round(float(v), 4) for v in joint]
                for joint in lost.positions
            ],
        }
        for lost in people
    ]


def _by_joint(key: str, values: Floats) -> dict[str, list[float]]:
    """Return a row of the data, unless all values are 0."""
    return {key: [round(float(v), 4) for v in values]} if values.any() else {}


def _of_joints(person: Mapping[str, Any], key: str) -> Floats:
    """Return (J,) values of a row; 0 if it is absent, as from earlier versions.

    Raises:
        TypeError, ValueError: they are not as many numbers from 0 on.
    """
    values = np.array([float(v) for v in person.get(key, [0.0] * len(JOINTS))])
    if values.shape != (len(JOINTS),) or not ((values >= 0) & np.isfinite(values)).all():
        raise ValueError(f"a lost person's {key} are wrong")
    return values


def lost_from_data(people: Sequence[Mapping[str, Any]], now_ns: int) -> list[Lost]:
    """Return lost people from the data of ``lost_as_data``. Their ids are negative, because a
    restarted source may assign the old ids to other people.

    Raises:
        KeyError, TypeError, ValueError: the data do not match the output of ``lost_as_data``.
    """
    found = []
    for person in people:
        rows = [[np.nan] * 3 if p is None else [float(v) for v in p] for p in person["positions"]]
        positions = np.array(rows, dtype=float)
        if positions.shape != (len(JOINTS), 3) or not np.isfinite(positions).any():
            raise ValueError("a lost person's joints are wrong")
        known = np.isfinite(positions).all(axis=1)
        speed_m_s, error_m = float(person["speed_m_s"]), sound_error_m(person.get("error_m", 0.0))
        if not (known.any() and 0 < speed_m_s < np.inf and error_m >= 0):
            raise ValueError("a lost person's joints, speed or error are wrong")
        number = int(person["id"])
        found.append(
            Lost(
                id=number if number < 0 else -1 - number,
                positions=np.where(known[:, None], positions, np.nan),
                joint_age_s=np.where(known, _of_joints(person, "joint_age_s"), np.inf),
                capture_ns=now_ns - round(min(float(person["ago_s"]), _LONG_AGO_S) * 1e9),
                speed_m_s=speed_m_s,
                limbs_m_s=_of_joints(person, "limbs_m_s"),
                error_m=error_m,
            )
        )
    return found
