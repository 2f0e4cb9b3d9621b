"""``check --listen``: does the source show the floor, and are bodies at possible heights above it?

Only feet show the floor. A body whose legs are hidden looks the same on a pose that is 30 cm wrong,
so its floor is reported as unchecked. Heights of its head, shoulders and hips only show an error of
about a metre, because people stand or sit.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.body.posture import posture_of

LEAST_CAPTURES = 10
ANKLE_M = 0.08
"""Height of a standing person's ankles above the floor."""
NEAR_M = 0.15
"""Maximum distance of a stance ankle from that height. In the data pack a lower quartile of the
lower ankle's heights over 3 s was 3 to 21 cm, also of people who run."""
_QUARTILE = 0.25
_JOINTS = {
    "head": [JOINTS.index("head")],
    "shoulders": [JOINTS.index("l_shoulder"), JOINTS.index("r_shoulder")],
    "hips": [JOINTS.index("l_hip"), JOINTS.index("r_hip")],
}
POSSIBLE_M = {"head": (0.9, 2.05), "shoulders": (0.65, 1.8), "hips": (0.25, 1.3)}
"""Minimum and maximum heights above the floor of adults of 1.5 to 2.1 m who stand, or sit on a
chair or stool. In 1,324 spans of 3 s of whole recorded bodies no median was outside; 1.0 m lower
all heads and shoulders were, 1.0 m higher 99.9 %."""
_ANKLES = [JOINTS.index("l_ankle"), JOINTS.index("r_ankle")]


class Floor(Enum):
    """Finding about the floor, from the people seen."""

    SEEN = "seen"
    UNSEEN = "unseen"
    FEET_ELSEWHERE = "feet elsewhere"
    TOO_LOW = "too low"
    TOO_HIGH = "too high"


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorFacts:
    """The floor that people show.

    Attributes:
        floor: the finding.
        ankles_m: height of stance ankles above ``people.floor_m``, of the person nearest to it;
            ``None``: no feet were seen.
        heights_m: median heights of all people's head, shoulders and hips above it, where seen.
    """

    floor: Floor
    ankles_m: float | None
    heights_m: dict[str, float]


def floor_of(people: dict[int, tuple[Floats, Bools]], floor_m: float) -> FloorFacts:
    """Return what the captures of all people show of the floor.

    Args:
        people: captures of each, (n, J, 3) metres in the room and (n, J).
        floor_m: height of the floor in the room's frame.
    """
    ankles = [a - floor_m for each in people.values() if (a := _ankles_m(*each)) is not None]
    nearest = min(ankles, key=lambda a: abs(a - ANKLE_M), default=None)
    each = [_heights_m(*captures, floor_m) for captures in people.values()]
    each = [heights for heights in each if heights]
    parts = {part: [h[part] for h in each if part in h] for part in POSSIBLE_M}
    heights = {part: round(float(np.median(h)), 3) for part, h in parts.items() if h}
    if nearest is not None:
        near = abs(nearest - ANKLE_M) <= NEAR_M
        found = Floor.SEEN if near else Floor.FEET_ELSEWHERE
        return FloorFacts(floor=found, ankles_m=round(nearest, 3), heights_m=heights)
    found = Floor.UNSEEN
    if each and all(_too_low(h) for h in each):
        found = Floor.TOO_LOW
    elif each and all(_too_high(h) for h in each):
        found = Floor.TOO_HIGH
    return FloorFacts(floor=found, ankles_m=None, heights_m=heights)


def shows_sides(people: dict[int, tuple[Floats, Bools]]) -> bool:
    """Return whether knees, feet or hanging arms of a person showed which side is the left one."""
    return any(
        sum(posture_of(b, o).handed_m is not None for b, o in zip(*each, strict=True) if o.any())
        >= LEAST_CAPTURES
        for each in people.values()
    )


def impossible(facts: FloorFacts, z_m: float) -> tuple[str, str] | None:
    """Return the fault of heights that no standing or seated person has, and the remedy."""
    if facts.floor not in (Floor.TOO_LOW, Floor.TOO_HIGH):
        return None
    low = facts.floor is Floor.TOO_LOW
    shown = ", ".join(f"{part} at {m:.2f} m" for part, m in facts.heights_m.items())
    way = "low" if low else "high"
    text = f"too {way} above the floor for people who stand or sit ({shown})"
    return text, (
        f"the height in source.room_from_source.xyz ({z_m:g}) or people.floor_m is wrong: "
        "measure the pose with hri-predict register. If people "
        + ("crouched or lay" if low else "stood on a platform")
        + ", let them stand on the floor and listen again"
    )


def floor_lines(found: dict[str, Any], fine: bool) -> list[str]:
    """Return the lines about upright bodies, from all findings; ``fine``: nothing is wrong."""
    floor, sides, ankles_m = found["floor"], found["sides"], found["ankles_m"]
    correct = ", left and right correct" if sides else ""
    lines = []
    if floor == Floor.SEEN.value:
        lines.append(f"{'ok: ' if fine else ''}bodies stand upright on the floor{correct}")
    elif floor == Floor.FEET_ELSEWHERE.value:
        off_m = ankles_m - ANKLE_M
        lines += [
            f"bodies stand upright{correct}",
            f"the floor could not be verified: feet are {abs(off_m):.2f} m "
            f"{'above' if off_m > 0 else 'below'} people.floor_m; let a person stand on the floor. "
            "If one did, the height in source.room_from_source.xyz or people.floor_m is wrong",
        ]
    else:
        lines += [
            f"bodies are upright{correct}",
            "the floor could not be verified, because no feet were seen: the pose may be decimetres"
            " too high or too low; let a person whose feet are seen walk by, or compare a point "
            "that a hand touches (--touched x,y,z, or hri-predict register)",
        ]
    if not sides:
        lines.append(
            "left and right could not be verified: let a person stand with hanging arms, or with "
            "the legs in view"
        )
    return lines


def verified(found: dict[str, Any]) -> bool:
    """Return whether ``--listen`` saw feet on the floor, and the sides of a body."""
    return found["floor"] == Floor.SEEN.value and bool(found["sides"])


def _ankles_m(positions: Floats, observed: Bools) -> float | None:
    """Return the height of a person's stance ankle; ``None`` if ankles were hardly seen."""
    seen = observed[:, _ANKLES]
    lower = np.where(seen, positions[:, _ANKLES, 2], np.inf).min(1)[seen.any(1)]
    return float(np.quantile(lower, _QUARTILE)) if len(lower) >= LEAST_CAPTURES else None


def _heights_m(positions: Floats, observed: Bools, floor_m: float) -> dict[str, float]:
    """Return the median heights of the parts that were seen often enough."""
    heights = {}
    for part, joints in _JOINTS.items():
        seen = observed[:, joints].all(1)
        if np.count_nonzero(seen) >= LEAST_CAPTURES:
            middle = positions[seen][:, joints, 2].mean(1)
            heights[part] = float(np.median(middle)) - floor_m
    return heights


def _too_low(heights: dict[str, float]) -> bool:
    """Return whether all parts are too low: people who bend lower the head only."""
    return all(m < POSSIBLE_M[part][0] for part, m in heights.items())


def _too_high(heights: dict[str, float]) -> bool:
    """Return whether any part is too high: no posture raises one."""
    return any(m > POSSIBLE_M[part][1] for part, m in heights.items())
