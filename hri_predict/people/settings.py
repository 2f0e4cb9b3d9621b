"""Settings of the people stage (``people:`` in the configuration)."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import MIN_HUMAN_M_S, Metres, Point, Region, Settings

Part = Literal["torso", "left_arm", "right_arm", "left_leg", "right_leg"]

_GONE = {
    "lost_growth_s": "acknowledge_after_s; the growth of a lost zone is no longer limited",
    "empty_scenes": "source.sees_free_space; a scene without people proves nothing",
}


_ON_M = 0.05
"""Maximum distance of a line from the side on which it must lie."""


class Exit(Region):
    """A region through which people leave the room; see ``people.lost.doors``."""

    out: Annotated[list[Point], Field(min_length=2, max_length=2)] | None = Field(
        None,
        description="the part of one side that people cross on the way out, from [x, y] to [x, y]; "
        "default: every side opposite to where they came in",
    )

    @model_validator(mode="after")
    def _on_a_side(self) -> Self:
        line = self.out
        if line is None:
            return self
        if math.dist(*line) < 2 * _ON_M:
            raise ValueError(f"out: its ends must be at least {2 * _ON_M:g} m apart")
        corners = self.polygon
        if not any(
            lies_on(line, a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
        ):
            raise ValueError(
                "out must lie on one side of polygon; give two points on the side that leads out"
            )
        return self


def lies_on(line: Sequence[Sequence[float]], a: Sequence[float], b: Sequence[float]) -> bool:
    """Return whether both ends of ``line`` are on the segment from ``a`` to ``b``, within 5 cm."""
    along = [b[0] - a[0], b[1] - a[1]]
    square = along[0] ** 2 + along[1] ** 2
    for x, y in line:
        share = ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square if square else 0.0
        share = min(max(share, 0.0), 1.0)
        if math.dist((x, y), (a[0] + share * along[0], a[1] + share * along[1])) > _ON_M:
            return False
    return True


class PeopleSettings(Settings):
    """Settings for tracking people, and for losing and finding them again."""

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
        description="body parts that are never in reach in this room, such as the legs of people "
        "who sit at a table; not parts that are only hidden from the tracker",
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
        description="minimum absence before an Acknowledge may clear a person",
    )
    free_captures: int = Field(
        10,
        ge=1,
        le=10_000,
        description="with source.sees_free_space: number of captures in which the tracker finds "
        "every person who stands in the open",
    )
    max_joint_speed_m_s: float = Field(
        25.0, ge=2, le=100, description="maximum speed of a joint; faster joints are rejected"
    )
    max_body_speed_m_s: float = Field(
        10.0,
        ge=1,
        le=100,
        description="maximum speed of the mean of a body's joints; faster bodies are rejected",
    )
    reaccept_captures: int = Field(
        5,
        ge=2,
        le=1000,
        description="number of captures that must agree before a jump is accepted",
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
        description="maximum apparent change of the floor's height since the first minutes, at "
        "places where people stand; beyond it, the sensor counts as moved",
    )
    posture_unchecked: str | None = Field(
        None,
        min_length=10,
        description="reason for not checking bodies against gravity and the floor; without a "
        "reason they are checked, and an implausible body makes the advice unknown",
    )

    safety: ClassVar[Safety] = harmless("max_people", "floor_m") | {
        "max_gap_s": LessSafe(
            above="a person may be unseen for {value:.2g} s, not {default:.2g} s, before the node "
            "treats the person as lost"
        ),
        "exits": LessSafe(
            other="a person who crosses an exit on the way out counts as gone; make it no larger "
            "than the floor in front of its door"
        ),
        "room": LessSafe(other="the node assumes that no person is outside it"),
        "absent_parts": LessSafe(other="no distance is kept from these parts of any body"),
        "found_within_s": LessSafe(
            above="a body that appears up to {value:g} s after a loss may clear the lost person, "
            "although it may be another person"
        ),
        "lost_speed_m_s": LessSafe(
            below="the zone of a lost person grows {more:.2g} m/s more slowly"
        ),
        "acknowledge_after_s": LessSafe(
            below="an Acknowledge clears a person who was seen {value:g} s before"
        ),
        "free_captures": LessSafe(
            below="after {value:g} captures without a body a place counts as free"
        ),
        "max_joint_speed_m_s": LessSafe(
            above="a joint that moves at up to {value:g} m/s is accepted",
            below="the limb of a person who strikes out faster than {value:g} m/s is rejected",
        ),
        "max_body_speed_m_s": LessSafe(
            above="a body that moves at up to {value:g} m/s is accepted",
            below="a person who runs faster than {value:g} m/s is rejected",
        ),
        "reaccept_captures": LessSafe(
            below="a jump is accepted after {value:g} consistent captures"
        ),
        "frozen_scenes": LessSafe(
            above="a frozen source is detected only after {value:g} identical scenes"
        ),
        "future_tolerance_s": LessSafe(
            above="a capture may be {value:g} s ahead, so its age is underestimated by as much"
        ),
        "floor_tolerance_m": LessSafe(
            above="a body {value:g} m above or below the floor is still accepted"
        ),
        "platform_m": LessSafe(above="a body up to {value:g} m above the floor is accepted"),
        "floor_drift_m": LessSafe(
            above="a sensor that sank, tilted or moved up or down by {value:g} m stays undetected"
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
