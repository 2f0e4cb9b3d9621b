"""Settings of the people stage (``people:`` in the configuration)."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import MIN_HUMAN_M_S, Metres, Point, Region, Settings

Part = Literal["torso", "left_arm", "right_arm", "left_leg", "right_leg"]

_GONE = {
    "lost_growth_s": "acknowledge_after_s; a lost zone no longer stops growing",
    "empty_scenes": "source.sees_free_space; a scene without people proves nothing",
}


_ON_M = 0.05
"""A line that is to lie on a side may miss it by this much."""


class Exit(Region):
    """A region through which people leave the room; see ``people.lost.doors``."""

    out: Annotated[list[Point], Field(min_length=2, max_length=2)] | None = Field(
        None,
        description="the part of one side that people cross on the way out, from [x, y] to [x, y]; "
        "default: every side that is opposite to where they came in",
    )

    @model_validator(mode="after")
    def _on_a_side(self) -> Self:
        line = self.out
        if line is None:
            return self
        if math.dist(*line) < 2 * _ON_M:
            raise ValueError(f"out: its ends must be {2 * _ON_M:g} m apart at least")
        corners = self.polygon
        if not any(
            lies_on(line, a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
        ):
            raise ValueError(
                "out must lie on one side of polygon; give two points on the side that leads out"
            )
        return self


def lies_on(line: Sequence[Sequence[float]], a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether both ends of ``line`` lie on the segment from ``a`` to ``b``, within 5 cm."""
    along = [b[0] - a[0], b[1] - a[1]]
    square = along[0] ** 2 + along[1] ** 2
    for x, y in line:
        share = ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square if square else 0.0
        share = min(max(share, 0.0), 1.0)
        if math.dist((x, y), (a[0] + share * along[0], a[1] + share * along[1])) > _ON_M:
            return False
    return True


class PeopleSettings(Settings):
    """Settings for tracking people, losing them and finding them again."""

    max_people: int = Field(
        16, ge=1, le=64, description="maximum number of people tracked at the same time"
    )
    max_gap_s: float | None = Field(
        None,
        ge=0.005,
        le=2,
        description="longest gap in a joint's observations that is bridged, and longest absence "
        "before a person counts as vanished; default: 0.1 s, or 2.5 source periods if longer",
    )
    exits: list[Exit] = Field(
        [], description="regions through which people leave the room, far from every robot"
    )
    entrances: list[Region] | None = Field(
        None, description="regions where people may enter; default: the exits"
    )
    room: Region | None = Field(
        None, description="the floor up to walls and fences; no person can be outside it"
    )
    absent_parts: list[Part] = Field(
        [],
        description="body parts never visible in this room, such as the legs of seated people",
    )
    found_within_s: float = Field(
        0.5,
        ge=0,
        le=2,
        description="maximum absence after which a body that appears may be a person who "
        "vanished; later, both exist",
    )
    lost_speed_m_s: float = Field(
        1.6,
        ge=MIN_HUMAN_M_S,
        le=10,
        description="minimum speed assumed for a person who vanished; ISO 13855 walking speed",
    )
    acknowledge_after_s: float = Field(
        3.0,
        ge=0,
        le=60,
        description="minimum absence before an Acknowledge may forget a person",
    )
    free_captures: int = Field(
        10,
        ge=1,
        le=10_000,
        description="with source.sees_free_space: number of captures in which the tracker finds "
        "every person who stands in the open",
    )
    max_joint_speed_m_s: float = Field(
        25.0, ge=2, le=100, description="a joint faster than this is not believed"
    )
    max_body_speed_m_s: float = Field(
        10.0, ge=1, le=100, description="a body whose joints' mean moves faster is not believed"
    )
    reaccept_captures: int = Field(
        5,
        ge=2,
        le=1000,
        description="number of captures that must agree before a jump is believed",
    )
    frozen_scenes: int = Field(
        3, ge=1, le=1000, description="number of consecutive repeats that mean a frozen source"
    )
    future_tolerance_s: float = Field(
        0.02,
        ge=0,
        le=1,
        description="maximum time by which a capture may be ahead of the node's clock",
    )
    floor_m: Metres = Field(0.0, description="height of the floor (room frame)")
    floor_tolerance_m: float = Field(
        0.3, ge=0.05, le=2, description="maximum apparent distance of a foot from the floor"
    )
    platform_m: float = Field(
        1.0,
        ge=0,
        le=20,
        description="height above the floor of the highest place where people stand",
    )
    floor_drift_m: float = Field(
        0.15,
        ge=0.05,
        le=1,
        description="where people stand again, the floor may appear this much higher or lower than "
        "in the first minutes, before its sensor counts as moved",
    )
    posture_unchecked: str | None = Field(
        None,
        min_length=10,
        description="why bodies are not checked against gravity and the floor here; without a "
        "reason they are, and a body that cannot be right makes the advice unknown",
    )

    safety: ClassVar[Safety] = harmless("max_people", "floor_m") | {
        "max_gap_s": LessSafe(
            above="a person may be unseen for {value:.2g} s, not {default:.2g} s, before the node "
            "counts on a loss"
        ),
        "exits": LessSafe(
            other="a person who crosses one on the way out counts as gone; make it no larger than "
            "the floor before its door"
        ),
        "room": LessSafe(other="the node expects no person outside it"),
        "absent_parts": LessSafe(other="no distance is kept from these parts of any body"),
        "found_within_s": LessSafe(
            above="a body that appears up to {value:g} s after a loss may end the lost person, who "
            "may be another one"
        ),
        "lost_speed_m_s": LessSafe(
            below="the zone of a lost person grows {more:.2g} m less in each second"
        ),
        "acknowledge_after_s": LessSafe(
            below="an Acknowledge forgets a person who was seen {value:g} s before"
        ),
        "free_captures": LessSafe(
            below="after {value:g} captures without a body a place counts as free"
        ),
        "max_joint_speed_m_s": LessSafe(
            above="a joint that jumps by {value:g} m in a second is believed",
            below="the limb of a person who strikes out faster than {value:g} m/s is not believed",
        ),
        "max_body_speed_m_s": LessSafe(
            above="a body that jumps by {value:g} m in a second is believed",
            below="a person who runs faster than {value:g} m/s is not believed",
        ),
        "reaccept_captures": LessSafe(below="{value:g} captures that agree make a jump believed"),
        "frozen_scenes": LessSafe(
            above="a frozen source is noticed only after {value:g} equal scenes"
        ),
        "future_tolerance_s": LessSafe(
            above="a capture may lie {value:g} s ahead, so that its age is too small by as much"
        ),
        "floor_tolerance_m": LessSafe(
            above="a body {value:g} m above or below the floor still counts as right"
        ),
        "platform_m": LessSafe(above="a body up to {value:g} m above the floor counts as right"),
        "floor_drift_m": LessSafe(
            above="a sensor that sank, tilted or was moved by {value:g} m up or down is not noticed"
        ),
        "posture_unchecked": LessSafe(
            other="axes and height of the source are not checked: people may be somewhere else"
        ),
    }

    @field_validator("exits", mode="before")
    @classmethod
    def _regions(cls, data: Any) -> Any:
        if not isinstance(data, list):
            return data
        return [r.model_dump() if isinstance(r, Region) else r for r in data]

    @model_validator(mode="before")
    @classmethod
    def _gone(cls, data: Any) -> Any:
        for key, instead in _GONE.items():
            if isinstance(data, dict) and key in data:
                raise ValueError(f"{key} is gone; see {instead}")
        return data
