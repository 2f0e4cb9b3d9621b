"""Checks over time that a source's bodies are plausible: on the floor, upright, not mirrored.

Wrong axes (camera axes instead of room axes, y up instead of z up) rotate every body of a source,
all the time. One capture proves nothing, because people lie down, jump and fall. So each person is
judged from postures smoothed over half a second, and a verdict is reached or withdrawn only over a
span of postures.

A body that lies flat is accepted only near the floor, nearly at rest, and after a person has stood
upright. Until then it may as well be due to wrong axes, and is refused immediately.

Heights of all seen joints are checked: no joint may be below the floor, or higher than a tall
person can reach on the highest platform. This also applies if only arms are seen, which show
nothing else.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import in_polygon
from hri_predict.base.settings import Region
from hri_predict.people.body.posture import Posture, posture_of, postures_of
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body

UPRIGHT = 0.7
"""Minimum cosine between a body's down and gravity at which the body confirms the axes."""
TILTED, TILTED_UPPER = 0.35, 0.2
"""Minimum cosine for a body that stands, sits or kneels; for a body without a leg in view."""
COHERENT, COHERENT_UPPER = 0.4, 0.6
"""Minimum length of ``Posture.down`` per length of bones: below it, the bones disagree."""
MIRRORED_M = 0.025
"""Distance of knees, toes and elbows on the wrong side at which left and right count as swapped;
the minimum in any recording was 0.05 m on the correct side, with a leg in view."""
LYING_M = 0.9
"""Height above the floor that nine tenths of a lying person's joints are below: a bench."""
GLIDING_M_S = 0.8
"""Maximum speed of a lying person; a walking person is faster."""
VIEW_MARGIN_M = 0.5
"""Distance outside the field of view at which a body's position cannot be right."""

SMOOTH_S = 0.5
JUDGE_NS = 30_000_000
HOLD_S, HOLD_UPPER_S, HOLD_BONE_S, RELEASE_S = 0.5, 2.0, 4.0, 1.0
"""Times for which a body must be wrong before it is refused: a whole body, a body without a leg in
view, and a body judged from a single bone, because people look down at their work for some
seconds."""
FORGET_NS = 5_000_000_000
INHERIT_M = 0.5


class Verdict(Enum):
    """Fault of a body's posture; its value is the name of its counter."""

    TILTED = "lying_bodies"
    UPSIDE_DOWN = "upside_down_bodies"
    MIRRORED = "mirrored_bodies"
    OFF_FLOOR = "off_floor_bodies"
    OUT_OF_VIEW = "out_of_view_bodies"

    @property
    def text(self) -> str:
        """Readable text that completes the phrase "bodies are"."""
        return _TEXT[self]


_TEXT = {
    Verdict.TILTED: "lying in the air or gliding",
    Verdict.UPSIDE_DOWN: "upside down",
    Verdict.MIRRORED: "mirrored (left and right swapped)",
    Verdict.OFF_FLOOR: "below the floor, or higher above it than people stand",
    Verdict.OUT_OF_VIEW: "outside the field of view",
}


@dataclass(slots=True, kw_only=True)
class _Record:
    """One person's smoothed posture, and the time for which it has been wrong or right."""

    seen_ns: int
    judged_ns: int
    middle: Floats
    down: Floats
    bones_m: float = 0.0
    velocity: Floats
    handed_m: float | None = None
    feet_m: float | None = None
    lowest_m: float
    above_m: float
    wrong_s: float = 0.0
    right_s: float = 0.0
    upright_s: float = 0.0
    refused: Verdict | None = None


class PostureWatch:
    """Verdicts on the people of one source. One thread only.

    Attributes:
        upright_seen: whether a person has stood upright, uncontradicted since: ``room_from_source``
            and the joint map then give the right direction of gravity.
        unjudged: number of captures of bodies with too few seen joints for a direction; only their
            heights are checked.
    """

    def __init__(self, settings: PeopleSettings, field_of_view: Region | None = None) -> None:
        self._on = settings.posture_unchecked is None
        self._floor = settings.floor_m
        self._below = settings.floor_m - settings.floor_tolerance_m
        self._above = settings.floor_m + settings.platform_m + settings.floor_tolerance_m
        self._view = field_of_view
        self._records: dict[int, _Record] = {}
        self.upright_seen = False
        self.unjudged = 0

    def due(self, bodies: Iterable[Body], capture_ns: int) -> dict[int, Posture]:
        """Return the postures, by id, of those bodies that ``judge`` will look at."""
        due: dict[int, Body] = {}
        for body in bodies:
            if self._on and self._is_due(body.id, capture_ns):
                due.setdefault(body.id, body)  # a second body with an id is not judged
        if not due:
            return {}
        positions = np.stack([body.positions for body in due.values()])
        observed = np.stack([body.observed for body in due.values()])
        return dict(zip(due, postures_of(positions, observed), strict=True))

    def _is_due(self, person: int, capture_ns: int) -> bool:
        record = self._records.get(person)
        return (
            record is None
            or capture_ns - record.seen_ns > FORGET_NS
            or capture_ns - record.judged_ns >= JUDGE_NS
        )

    def judge(self, body: Body, capture_ns: int, posture: Posture | None = None) -> Verdict | None:
        """Add one body, room frame; return its fault if it has been wrong for long enough.

        Args:
            body: its joints, at least one of them observed.
            capture_ns: rises from call to call for each person.
            posture: its posture if it has been computed, see ``due``.
        """
        if not self._on:
            return None
        record = self._records.get(body.id)
        if record is not None and capture_ns - record.seen_ns > FORGET_NS:
            record = None  # the id may be another person's now
        if record is not None and capture_ns - record.judged_ns < JUDGE_NS:
            record.seen_ns = capture_ns
            return record.refused
        posture = posture or posture_of(body.positions, body.observed)
        self.unjudged += not posture.bones
        record = record or self._begin(body.id, posture, capture_ns)
        elapsed_s = _smooth(record, posture, capture_ns)
        if posture.bones or not record.bones_m or self._out_of_reach(record):
            self._decide(record, posture, elapsed_s)  # else nothing contradicts or confirms it
        return record.refused

    def _begin(self, person: int, posture: Posture, capture_ns: int) -> _Record:
        """Start a record, or continue that of a body that stood here with another id."""
        for other, record in list(self._records.items()):
            if record.seen_ns == capture_ns:
                continue
            if capture_ns - record.seen_ns > FORGET_NS:
                del self._records[other]
            elif math.dist(record.middle, posture.middle) < INHERIT_M:
                self._records[person] = self._records.pop(other)
                return record
        record = self._records[person] = _Record(
            seen_ns=NEVER,
            judged_ns=NEVER,
            middle=posture.middle,
            down=np.zeros(3),
            velocity=np.zeros(3),
            lowest_m=posture.lowest_m,
            above_m=posture.above_m,
        )
        return record

    def _decide(self, record: _Record, posture: Posture, elapsed_s: float) -> None:
        """Update the times for which the record has been wrong, right and upright, and judge."""
        wrong = self._wrong(record, posture)
        if wrong is None:
            record.wrong_s, record.right_s = 0.0, record.right_s + elapsed_s
        else:
            record.wrong_s, record.right_s = record.wrong_s + elapsed_s, 0.0
        turned = wrong in (Verdict.TILTED, Verdict.UPSIDE_DOWN)
        if wrong is not None and record.wrong_s >= self._hold_s(wrong, turned, record, posture):
            record.refused = wrong
            self.upright_seen &= not turned
        elif record.right_s >= RELEASE_S:
            record.refused = None
        stands = posture.has_leg and wrong is None and _cosine(record) > UPRIGHT
        record.upright_s = record.upright_s + elapsed_s if stands else 0.0
        self.upright_seen |= record.upright_s >= HOLD_S

    def _hold_s(self, wrong: Verdict, turned: bool, record: _Record, posture: Posture) -> float:
        """Return the time for which a body must be wrong before it is refused."""
        impossible = self._out_of_reach(record)
        if not (posture.has_leg or impossible or wrong is Verdict.MIRRORED):
            return HOLD_UPPER_S if posture.bones > 1 else HOLD_BONE_S
        return HOLD_S if self.upright_seen or not (turned or impossible) else 0.0

    def _wrong(self, record: _Record, posture: Posture) -> Verdict | None:
        """Return the fault of the smoothed posture."""
        cosine, whole = _cosine(record), posture.has_leg
        length_m = float(np.linalg.norm(record.down))
        agree = length_m > (COHERENT if whole else COHERENT_UPPER) * record.bones_m
        if agree and cosine < -(TILTED if whole else TILTED_UPPER):
            return Verdict.UPSIDE_DOWN
        if agree and cosine < (TILTED if whole else TILTED_UPPER):
            return None if self._may_lie(record, posture) else Verdict.TILTED
        if record.handed_m is not None and record.handed_m < -MIRRORED_M:
            return Verdict.MIRRORED
        if self._off_floor(record):
            return Verdict.OFF_FLOOR
        if self._view is not None:
            if _outside(self._view, posture.middle) > VIEW_MARGIN_M:
                return Verdict.OUT_OF_VIEW
            if whole and cosine > UPRIGHT:
                self._view = None  # somebody is where the sensor sees: the heading is right
        return None

    def _may_lie(self, record: _Record, posture: Posture) -> bool:
        """Return whether a person may lie here, on the floor or slightly above it."""
        low, high = posture.heights
        near_floor = self._below <= low and high <= self._floor + LYING_M
        return self.upright_seen and near_floor and _speed(record) < GLIDING_M_S

    def _off_floor(self, record: _Record) -> bool:
        """Return whether feet are below the floor, or higher than a person can stand here."""
        on_floor = record.feet_m is None or self._below <= record.feet_m <= self._above
        return not on_floor or self._out_of_reach(record)

    def _out_of_reach(self, record: _Record) -> bool:
        """Return whether joints are at heights that no person can reach in any posture."""
        return record.lowest_m < self._below or record.above_m > self._above


def refusal_of(
    positions: Floats,
    observed: Bools,
    settings: PeopleSettings,
    field_of_view: Region | None = None,
) -> Verdict | None:
    """Return why one person's consecutive captures (n, J, 3) and (n, J) cannot be right.

    Also ``None`` if they are not checked; too little may be seen, see ``shows_down``.
    """
    watch = PostureWatch(settings, field_of_view)
    verdict = None
    for index, (joints, seen) in enumerate(zip(positions, observed, strict=True)):
        if seen.any():
            verdict = watch.judge(Body(0, joints, seen), (index + 1) * JUDGE_NS)
    return verdict


def _smooth(record: _Record, posture: Posture, capture_ns: int) -> float:
    """Add a posture to the record; return the time since the previous posture, at most 0.5 s."""
    first = record.judged_ns == NEVER
    elapsed_s = 0.0 if first else min((capture_ns - record.judged_ns) * 1e-9, SMOOTH_S)
    share = 1.0 if first else 1.0 - math.exp(-elapsed_s / SMOOTH_S)
    if not first:
        moved = (posture.middle - record.middle) / ((capture_ns - record.judged_ns) * 1e-9)
        record.velocity += share * (moved - record.velocity)
    if posture.bones:
        turn = share if record.bones_m else 1.0
        record.down += turn * (posture.down - record.down)
        record.bones_m += turn * (posture.bones_m - record.bones_m)
    record.handed_m = _mixed(record.handed_m, posture.handed_m, share)
    record.feet_m = _mixed(record.feet_m, posture.feet_m, share)
    record.lowest_m += share * (posture.lowest_m - record.lowest_m)
    record.above_m += share * (posture.above_m - record.above_m)
    record.middle = posture.middle
    record.seen_ns = record.judged_ns = capture_ns
    return elapsed_s


def _mixed(before: float | None, now: float | None, share: float) -> float | None:
    if before is None or now is None:
        return before if now is None else now
    return before + share * (now - before)


def _cosine(record: _Record) -> float:
    """Return the cosine between the smoothed down direction and gravity."""
    return float(-record.down[2] / max(float(np.linalg.norm(record.down)), 1e-9))


def _speed(record: _Record) -> float:
    return float(np.linalg.norm(record.velocity))


def _outside(region: Region, point: Floats) -> float:
    """Return the distance in metres of ``point`` (3,) from a prism; 0 inside."""
    up = max(region.z_min - point[2], point[2] - region.z_max, 0.0)
    corners = np.asarray(region.polygon, np.float64)
    if in_polygon(point[:2], corners):
        return float(up)
    along = np.roll(corners, -1, axis=0) - corners
    to_point = point[:2] - corners
    part = (to_point * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-12)
    nearest = to_point - np.clip(part, 0.0, 1.0)[:, None] * along
    return float(math.hypot(np.linalg.norm(nearest, axis=1).min(), up))
