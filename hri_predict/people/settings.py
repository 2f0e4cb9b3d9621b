"""Settings of the people stage (``people:`` in the configuration)."""

from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from hri_predict.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.settings import MIN_HUMAN_M_S, Metres, Region, Settings

Part = Literal["torso", "left_arm", "right_arm", "left_leg", "right_leg"]

_GONE = {
    "lost_growth_s": "acknowledge_after_s; a lost zone no longer stops growing",
    "empty_scenes": "source.sees_free_space; a scene without anybody proves nothing",
}


class PeopleSettings(Settings):
    """Settings for tracking people, losing them and finding them again."""

    max_people: int = Field(16, ge=1, le=64, description="most people tracked at the same time")
    max_gap_s: float | None = Field(
        None,
        ge=0.005,
        le=2,
        description="longest gap in a joint's observations that is bridged, and longest absence "
        "before a person counts as vanished; default: 0.1 s, or 2.5 source periods if longer",
    )
    exits: list[Region] = Field(
        [], description="where people may leave the room, far from every robot"
    )
    entrances: list[Region] | None = Field(
        None, description="where people may enter; default: by the exits"
    )
    room: Region | None = Field(
        None, description="the floor up to walls and fences; nobody can be outside it"
    )
    absent_parts: list[Part] = Field(
        [],
        description="body parts never visible in this room, such as the legs of seated people",
    )
    found_within_s: float = Field(
        0.5,
        ge=0,
        le=2,
        description="a body that appears may be a person who vanished at most so long before; "
        "later, both exist",
    )
    lost_speed_m_s: float = Field(
        1.6,
        ge=MIN_HUMAN_M_S,
        le=10,
        description="least speed of a person who vanished; ISO 13855 walking speed",
    )
    acknowledge_after_s: float = Field(
        3.0,
        ge=0,
        le=60,
        description="an Acknowledge forgets only people who were last seen so long before",
    )
    free_captures: int = Field(
        10,
        ge=1,
        le=10_000,
        description="with source.sees_free_space: in how many captures the tracker finds everybody "
        "who stands in the open",
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
        description="how many captures must agree with each other before a jump is believed",
    )
    frozen_scenes: int = Field(
        3, ge=1, le=1000, description="how many repeats in a row mean a frozen source"
    )
    future_tolerance_s: float = Field(
        0.02, ge=0, le=1, description="how far ahead of the node's clock a capture may lie"
    )
    floor_m: Metres = Field(0.0, description="height of the floor (room frame)")
    floor_tolerance_m: float = Field(
        0.3, ge=0.05, le=2, description="how far off the floor a foot may seem to be"
    )
    platform_m: float = Field(
        1.0, ge=0, le=20, description="highest place above the floor where people stand"
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
            other="a person who vanishes in one, on the way out, counts as gone; none may be larger"
            " than the floor before its door"
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
        "posture_unchecked": LessSafe(
            other="axes and height of the source are not checked: people may be somewhere else"
        ),
    }

    @model_validator(mode="before")
    @classmethod
    def _gone(cls, data: Any) -> Any:
        for key, instead in _GONE.items():
            if isinstance(data, dict) and key in data:
                raise ValueError(f"{key} is gone; see {instead}")
        return data
