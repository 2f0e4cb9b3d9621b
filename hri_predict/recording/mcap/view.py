"""Content of a 3D view of a recording: people, zones, robots and their levels.

It is decimated and only for display: the exact numbers are in /scene, /zones and /advice.
"""

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, nearest_points
from hri_predict.base.looks import LOOKS
from hri_predict.base.skeleton import JOINTS, PARENTS
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.recording.mcap import well_known
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.well_known import Rgba
from hri_predict.risk.types import Grounds
from hri_predict.risk.wording import apart_text

ROOM = "room"
"""The common parent frame: the room's, z up."""
SHOWN_S = 0.5
"""Time ahead for which the zones are drawn: about the time a robot needs to stop."""
BODY_M, PAIR_M = 0.09, 0.02
ZONE_OPACITY = 0.04
"""Opacity of a capsule's part: a zone has forty, one behind the other, and a person within."""
PAIR = "separation"
"""The name of the entity that joins the deciding pair of a robot begins with it."""


_BONES = [(joint, parent) for joint, parent in enumerate(PARENTS) if parent >= 0]
_WAIST = JOINTS.index("waist")


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One tick's picture. Arrays are copies.

    Attributes:
        people: (id, (J, 3) joints, whether lost).
        zones: (id, (S, 2, 3) ends, (S,) radii).
        robots: (name, (C, 2, 3) ends, (C,) radii, level, label).
        pairs: (robot's name, (2, 3) nearest points of the deciding pair, level, label).
    """

    people: list[tuple[int, Floats, bool]]
    zones: list[tuple[int, Floats, Floats]]
    robots: list[tuple[str, Floats | None, Floats | None, Level, str]]
    lifetime_s: float
    pairs: list[tuple[str, Floats, Level, str]]


def seen(tick: Tick, robots: tuple[str, ...], lifetime_s: float) -> Seen:
    """The picture of a tick."""
    people: list[tuple[int, Floats, bool]] = []
    if tick.snapshot is not None:
        people = [
            (id_, joints.copy(), False)
            for id_, joints in zip(tick.snapshot.ids, tick.snapshot.last_positions, strict=True)
        ]
        people += [(lost.id, lost.positions, True) for lost in tick.snapshot.lost]
    zones: list[tuple[int, Floats, Floats]] = []

    if tick.assessment is not None:
        there = tick.assessment.zones
        if there.ids:
            step = int(np.searchsorted(there.times_s, SHOWN_S).clip(0, len(there.times_s) - 1))
            zones = [(id_, *_ends(there.capsules, (p, step))) for p, id_ in enumerate(there.ids)]
    shown: list[tuple[str, Floats | None, Floats | None, Level, str]] = []
    pairs: list[tuple[str, Floats, Level, str]] = []
    for advice in tick.advices:
        name = robots[advice.robot] if advice.robot < len(robots) else str(advice.robot)
        why = tick.grounds(advice.robot) or Grounds()
        known = why.capsules
        ends, radius = _ends(known, ...) if known is not None else (None, None)
        limit = advice.speed_limit_m_s or 0.0
        label = f"{name}: {advice.level.name} {limit:.2f} m/s {advice.reason.name}"
        shown.append((name, ends, radius, advice.level, label))
        if why.pair is not None:
            between = np.stack(nearest_points(*why.pair))
            pairs.append((name, between, advice.level, apart_text(advice, why)))
    return Seen(people, zones, shown, lifetime_s, pairs)


def _ends(capsules: Capsules, where: Any) -> tuple[Floats, Floats]:
    a, b, radius = (np.asarray(part)[where] for part in (capsules.a, capsules.b, capsules.radius))
    return np.stack((a, b), axis=-2), radius.copy()


def scene_update(picture: Seen, utc_ns: int) -> dict[str, Any]:
    """``foxglove.SceneUpdate``: removed entities disappear at the end of their lifetime."""
    levels = [level for *_, level, _ in picture.robots]
    worst = max(levels, key=attrgetter("urgency"), default=Level.UNKNOWN)
    entities = []

    def add(name: str, **parts: list[Any]) -> None:
        entities.append(well_known.entity(name, utc_ns, picture.lifetime_s, ROOM, **parts))

    for id_, joints, lost in picture.people:
        bones = np.array([joints[list(bone)] for bone in _BONES])
        bones = bones[np.isfinite(bones).all(axis=(1, 2))]
        if len(bones):
            rgba: Rgba = (0.5, 0.5, 0.5, 0.5) if lost else (0.1, 0.4, 0.9, 1.0)
            add(f"person {id_}", lines=[well_known.lines(bones, BODY_M, rgba)])
    for id_, ends, radius in picture.zones:
        sound = np.isfinite(ends).all(axis=(1, 2)) & np.isfinite(radius)
        if sound.any():
            rgba = LOOKS[worst.name].rgba(ZONE_OPACITY)
            add(f"zone {id_}", **well_known.capsules(ends[sound], radius[sound], rgba))
    for name, own, own_radius, level, text in picture.robots:
        rgba = LOOKS[level.name].rgba(0.9)
        if own is not None and own_radius is not None:
            solid = well_known.capsules(own, own_radius, rgba)
            top = own.reshape(-1, 3).max(axis=0)
            above = [*own[0, 0, :2].round(3).tolist(), round(float(top[2]) + 0.3, 3)]
            add(f"robot {name}", **solid, texts=[well_known.label(above, text, rgba)])
    for name, between, level, text in picture.pairs:
        if np.isfinite(between).all():
            rgba = LOOKS[level.name].rgba(1.0)
            label = well_known.label(between.mean(axis=0).round(3).tolist(), text, rgba)
            line = well_known.lines(between[None], PAIR_M, rgba)
            add(f"{PAIR} {name}", lines=[line], texts=[label])
    return {"deletions": [], "entities": entities}


def people_poses(picture: Seen, utc_ns: int) -> dict[str, Any]:
    """``foxglove.PosesInFrame``: positions of the waists of all tracked people."""
    waists = np.array([joints[_WAIST] for _, joints, lost in picture.people if not lost])
    waists = waists.reshape(-1, 3)
    return well_known.poses(waists[np.isfinite(waists).all(axis=1)], utc_ns, ROOM)


def frame_transforms(info: RecordingInfo, utc_ns: int) -> dict[str, Any]:
    """``foxglove.FrameTransforms``: the robots' bases in the room."""
    found = [well_known.transform(name, pose, utc_ns, ROOM) for name, pose in info.frames]
    return {"transforms": found}
