"""Settings of zones: motion limits of bodies, and coverage of zones."""

from typing import ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.base.settings import MIN_HUMAN_M_S, Settings

MIN_HUMAN_M_S2 = 3.0
"""Minimum acceleration assumed for any joint: half that of sprinters' trunks (``HumanLimits``)."""
MAX_ASSUMED_M_S = 5.0
"""Maximum speed assumed for a person: with more, runners would not count as fast."""
MIN_REACH_SHARE = 0.5
"""Minimum share of the default reach: people at work reach at least this."""

LEVELS = (0.9, 0.95, 0.99)
"""Coverage levels of calibrated zones."""


class Reach(Settings):
    """Reach of a joint of one part of the body: the joint is inside two spheres.

    The first has the radius ``speed_m_s`` t around the joint's last position. The second has the
    radius (``burst_m_s`` + ``sustained_m_s2`` t / 2) t around the position extrapolated with its
    present velocity. Every zone is cut to both, so they must not be smaller than the motion of
    people at work.
    """

    speed_m_s: float = Field(ge=2, le=50, description="maximum speed of any joint of this part")
    burst_m_s: float = Field(
        ge=1, le=50, description="change of velocity within hundredths of a second"
    )
    sustained_m_s2: float = Field(8.3, ge=2, le=100, description="acceleration of the whole body")

    safety: ClassVar[Safety] = {
        "speed_m_s": LessSafe(
            below="no zone holds a joint that is faster than {value:g} m/s, {more:.2g} m/s less "
            "than by default"
        ),
        "burst_m_s": LessSafe(below="a joint that jerks is assumed to be {more:.2g} m/s slower"),
        "sustained_m_s2": LessSafe(
            below="a body that speeds up for a second is expected {more:.2g} m/s slower"
        ),
    }


REACH: dict[Literal["trunk", "arm", "leg"], Reach] = {
    "trunk": Reach(speed_m_s=10.0, burst_m_s=2.0),
    "arm": Reach(speed_m_s=15.0, burst_m_s=4.5),
    "leg": Reach(speed_m_s=20.0, burst_m_s=9.0),
}
"""See ``HumanLimits``."""


class HumanLimits(Settings):
    """Speeds of people: assumptions of the standard, and physical limits.

    The standard's figures apply without a calibrated forecast: ISO 13855:2010 gives K = 2.0 m/s for
    an upper limb and 1.6 m/s for a walking body (as quoted in the ifm OY and Schmersal SLC
    manuals). Accelerations: the body file of SaRA gives 20-25 m/s2 for trunk and head, 30 for legs,
    50 for arms and hands, and 2 m/s for every joint (JakobThumm/sara-shield,
    ``safety_shield/config/human_reach_TUM_lab.yaml``).

    No zone needs to exceed ``reach``. SaRA's figures are too small for this: people run, jump and
    kick. The sprinters of di Prampero et al. (J. Exp. Biol. 208 (2005) 2809) reached 9.46 m/s (SD
    0.19) and accelerated by 6.42 m/s2 (SD 0.61). Mean + 3 SD give the trunk's speed and every
    part's sustained acceleration. Bursts and limb speeds are chosen so that zones contain at least
    99.9 % of all joints, up to 1 s ahead, in the recordings of the ``fit``, ``validation`` and
    ``calibration`` splits (version 1, CMU only). A unit test checks this on the ``test`` split.
    """

    arm_speed_m_s: float = Field(
        2.0, ge=MIN_HUMAN_M_S, le=MAX_ASSUMED_M_S, description="shoulder to finger tips"
    )
    body_speed_m_s: float = Field(
        1.6, ge=MIN_HUMAN_M_S, le=MAX_ASSUMED_M_S, description="everything else"
    )
    physical_speed_m_s: float = Field(
        2.0,
        ge=MIN_HUMAN_M_S,
        le=20,
        description="speed of a joint without a forecast, or its present speed if higher",
    )
    arm_acceleration_m_s2: float = Field(
        50.0, ge=MIN_HUMAN_M_S2, le=1000, description="maximum acceleration of arms and hands"
    )
    body_acceleration_m_s2: float = Field(
        30.0, ge=MIN_HUMAN_M_S2, le=1000, description="maximum acceleration of all other parts"
    )
    velocity_error_m_s: float = Field(
        1.6,
        ge=0,
        le=20,
        description="error of an uncalibrated forecast's velocity at capture; the default, a whole"
        " walking speed, holds for any predictor",
    )
    std_factor: float = Field(
        2.0,
        ge=0,
        le=10,
        description="minimum size of zones, in standard deviations that the forecast states",
    )
    extend_beyond_horizon: bool = Field(
        False, description="let zones grow at the physical speed beyond the last horizon"
    )
    reach: dict[Literal["trunk", "arm", "leg"], Reach] = Field(
        REACH,
        description="reach of each part of the body: trunk, arm, leg",
    )

    safety: ClassVar[Safety] = {
        "arm_speed_m_s": LessSafe(
            below="an approaching arm is assumed to be {more:.2g} m/s slower",
            above="an arm of up to {value:g} m/s does not count as fast",
        ),
        "body_speed_m_s": LessSafe(
            below="an approaching person is assumed to be {more:.2g} m/s slower",
            above="a person who approaches at up to {value:g} m/s does not count as fast",
        ),
        "physical_speed_m_s": LessSafe(
            below="joints without a forecast and lost people are assumed to be {more:.2g} m/s "
            "slower"
        ),
        "arm_acceleration_m_s2": LessSafe(
            below="an arm that starts to move is expected {more:.2g} m/s slower after a second"
        ),
        "body_acceleration_m_s2": LessSafe(
            below="a person who starts to move is expected {more:.2g} m/s slower after a second"
        ),
        "velocity_error_m_s": LessSafe(
            below="zones without a calibration are {more:.2g} m narrower for each second ahead"
        ),
        "std_factor": LessSafe(below="zones cover fewer standard deviations of the forecast"),
        "extend_beyond_horizon": LessSafe(
            other="past the horizon zones rest on physical_speed_m_s alone, and the robot need not "
            "stop within the horizon"
        ),
    }

    @field_validator("reach")
    @classmethod
    def _every_part(cls, value: dict[str, Reach]) -> dict[str, Reach]:
        for part in ("trunk", "arm", "leg"):
            if part not in value:
                raise ValueError(f"reach needs trunk, arm and leg; {part} is missing")
            for key in Reach.model_fields:
                given, usual = getattr(value[part], key), getattr(REACH[part], key)
                if given < MIN_REACH_SHARE * usual:
                    raise ValueError(
                        f"{part}.{key} {given:g} is less than people at work do; give at least "
                        f"{MIN_REACH_SHARE * usual:g}, the default is {usual:g}"
                    )
        return value


class CoverageSettings(Settings):
    """Coverage of the body by zones (``risk.coverage``); see ``calibration``.

    ``of: joint`` requires each joint to be inside (the joint nearest to the robot is one joint);
    ``body`` requires all joints at once, which requires larger zones. ``guaranteed`` radii exist
    only if enough independent recordings support the level; ``estimated`` radii use all windows
    together.
    """

    level: float = Field(0.99, description="0.9, 0.95 or 0.99")
    of: Literal["body", "joint"] = Field(
        "joint",
        description="unit that must be inside at this rate: each joint, or the whole body at once",
    )
    basis: Literal["estimated", "guaranteed"] = Field(
        "estimated",
        description="estimated: all windows count; guaranteed: separate recordings must support it",
    )
    calibration: str | None = Field(
        None, description="file from hri-predict calibrate; default: the shipped one"
    )
    self_check: bool = Field(
        True,
        description="compare past forecasts with the actual motion; widen zones that are too small",
    )

    safety: ClassVar[Safety] = {
        "level": LessSafe(below="zones fail to hold a body more often: 1 - {value:g} of the time"),
        "self_check": LessSafe(other="zones that turn out too small are not detected or widened"),
    }

    @model_validator(mode="after")
    def _known_level(self) -> Self:
        if self.level not in LEVELS:
            raise ValueError(f"level must be one of {', '.join(map(str, LEVELS))}")
        return self
