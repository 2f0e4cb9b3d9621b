"""Settings of the risk stage (``risk:`` in the configuration)."""

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import Field, model_validator

from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import MIN_SPEED_M_S, Settings
from hri_predict.risk.fixtures import Fixture
from hri_predict.risk.sets import SetSettings
from hri_predict.zones.settings import CoverageSettings, HumanLimits

LatchCause = Literal["stop", "start", "blind", "lost", "restart"]
"""Possible causes of a latch, see ``RiskSettings.latch``."""

RestartType = Literal["automatic", "manual", "supervised"]
"""Conditions that end a latch, see ``RiskSettings.restart``."""
INTERLOCKED: tuple[LatchCause, ...] = ("stop", "start", "blind", "lost")
"""Causes of a latch if ``restart`` is given without ``latch``."""

MIN_FIXED_RADIUS_M = 0.3
"""Minimum radius; the smallest robots have a reach of 0.5 m or more (UR3e)."""

RiskMode = Literal["iso", "predictive", "hybrid", "reactive", "fixed"]
RISK_MODES: tuple[str, ...] = get_args(RiskMode)


class ContactSettings(Settings):
    """Permitted contact in mode ``hybrid`` (``risk.contact``); see ``contact.judge``."""

    table: str | None = Field(
        None, description="file with the limits of all body regions; default: the shipped table"
    )
    fixtures: list[Fixture] | None = Field(
        None,
        max_length=32,
        description="objects, besides the floor, against which the robot may clamp a body part; "
        "default: the table on which each robot stands, a plane at its base",
    )
    own_speed: Literal["counted", "left_out"] = Field(
        "counted",
        description="whether a body part's own speed is subtracted from its contact limit, so "
        "that the relative speed is limited. left_out: only the robot's speed is "
        "limited, for cells where a person who strikes a standing robot does so at "
        "their own risk",
    )
    slow_margin_m: float = Field(
        0.1,
        ge=0,
        le=2,
        description="like risk.slow_margin_m, for body parts that may not be touched",
    )

    safety: ClassVar[Safety] = {
        "own_speed": LessSafe(
            other="a person who moves towards the robot may be struck at more than the limit of "
            "the body part, by that person's own speed"
        ),
        "fixtures": LessSafe(other="clamping is judged only against these objects and the floor"),
        "slow_margin_m": LessSafe(below="the limit assumes a person {more:.2g} m farther away"),
    }


class RiskSettings(Settings):
    """Settings for the separation rules and for changes of level.

    ``iso`` compares the present distance with the protective separation distance of ISO/TS 15066.
    ``predictive`` compares the zones with the stopping robot at each time. ``reactive`` does the
    same with zones that grow from the body as seen, without a forecast. ``fixed`` is a circle
    around the robot's base: no person may be inside while the robot moves. ``hybrid`` is
    ``predictive``, but where separation cannot be kept, robots with ``contact: allowed`` may touch
    people at up to the contact limit of the touched body part.
    """

    mode: RiskMode = Field("iso", description="rule for judging separation")
    fixed_radius_m: float | None = Field(
        None,
        ge=MIN_FIXED_RADIUS_M,
        le=100,
        description="radius for mode fixed; default: the robot's reach plus the protective "
        "separation distance at its highest speed and the longest delay",
    )
    intrusion_m: float = Field(0.0, ge=0, le=2, description="C: reach into the field, ISO 13855")
    person_uncertainty_m: float = Field(
        0.05, ge=0, le=1, description="Z_d: uncertainty of a person's sensed position"
    )
    robot_uncertainty_m: float = Field(
        0.01, ge=0, le=1, description="Z_r: uncertainty of the robot's position"
    )
    region_margins_m: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(
        {},
        description="additional distance from body segments, by name (head, hand), beyond C + Z_d "
        "+ Z_r: the segments are treated as that much thicker, also in zones",
    )
    band_m: float = Field(
        0.1, ge=0, le=2, description="distance beyond its threshold at which a level is released"
    )
    release_captures: int = Field(
        15,
        ge=1,
        le=10_000,
        description="number of distinct captures that must agree before a release; the default is "
        "half a second at 30 Hz, the duration of one walking step, whose swing alone "
        "must not start the robot",
    )
    warn_margin_m: float = Field(
        0.5,
        ge=0,
        le=10,
        description="distance before the slow-down of the robot at which a warning is given",
    )
    slow_margin_m: float = Field(
        0.25,
        ge=0,
        le=2,
        description="distance by which a person is assumed nearer for the speed limit, so that a "
        "robot that follows the limit with its delay need not stop while a person "
        "approaches",
    )
    min_speed_m_s: float = Field(
        0.05, ge=MIN_SPEED_M_S, le=1, description="a limit below this is advised as a stop"
    )
    speed_rise_m_s2: float = Field(
        2.0,
        ge=0.01,
        le=100,
        description="maximum rate of increase of the speed limit, which falls without delay. "
        "Every limit is permitted in itself; the rate only avoids jerks",
    )
    latch: list[LatchCause] = Field(
        [],
        description="causes after which the first motion requires an Acknowledge: stop (any "
        "advised stop), start (the node was started), blind (the source was blind, or "
        "its input stale or frozen), lost (a person was lost), restart (like start, "
        "if a state file shows an earlier run)",
    )
    restart: RestartType = Field(
        "automatic",
        description="condition that ends a latch. automatic: nothing is latched; manual: one "
        "press of the button, the default if latch has causes; supervised: the button "
        "is pressed and released within 0.15 to 3 s, while the robot's level would "
        "otherwise be clear all the time. With manual or supervised, latch defaults "
        "to [stop, start, blind, lost]",
    )
    limits: HumanLimits = Field(HumanLimits(), description="speeds of people")
    coverage: CoverageSettings = Field(
        CoverageSettings(), description="coverage of the body by calibrated zones"
    )
    contact: ContactSettings = Field(
        ContactSettings(), description="permitted contact in mode hybrid"
    )

    sets: list[SetSettings] = Field(
        [],
        max_length=16,
        description="configuration sets, one of which a PLC chooses over a link of kind modbus or "
        "opcua",
    )

    safety: ClassVar[Safety] = harmless("region_margins_m") | {
        "fixed_radius_m": LessSafe(below="a person may be {more:.2g} m nearer to a moving robot"),
        "intrusion_m": LessSafe(below="a person may be {more:.2g} m nearer"),
        "person_uncertainty_m": LessSafe(
            below="a person may be {more:.2g} m nearer: the source must be that accurate"
        ),
        "robot_uncertainty_m": LessSafe(
            below="a person may be {more:.2g} m nearer: the robot's position must be that accurate"
        ),
        "band_m": LessSafe(below="the robot is released {more:.2g} m sooner"),
        "release_captures": LessSafe(
            below="the robot is released after {value:g} captures, not {default:g}"
        ),
        "warn_margin_m": LessSafe(below="people get a warning {more:.2g} m later"),
        "slow_margin_m": LessSafe(below="the limit assumes a person {more:.2g} m farther away"),
        "min_speed_m_s": LessSafe(
            below="the robot may creep at {value:g} m/s where it would stop by default"
        ),
        "speed_rise_m_s2": LessSafe(
            above="the limit may rise by {more:.2g} m/s more in each second"
        ),
    }

    @model_validator(mode="before")
    @classmethod
    def _latch_stop_is_gone(cls, data: Any) -> Any:
        if isinstance(data, dict) and "latch_stop" in data:
            instead = "latch: [stop]" if data["latch_stop"] else "latch: []"
            raise ValueError(f"latch_stop is now a list of causes; write '{instead}' instead")
        return data

    @model_validator(mode="before")
    @classmethod
    def _restart_and_latch(cls, data: Any) -> Any:
        """Derive ``latch`` or ``restart`` from the other if only one is given."""
        if not isinstance(data, dict):
            return data
        if "restart" not in data:
            return {**data, "restart": "manual"} if data.get("latch") else data
        if "latch" not in data and data["restart"] != "automatic":
            return {**data, "latch": list(INTERLOCKED)}
        return data

    @model_validator(mode="after")
    def _latched_for_something(self) -> Self:
        if self.restart == "automatic" and self.latch:
            raise ValueError(
                "with 'restart: automatic' nothing is latched; leave out latch, or write "
                "'restart: manual' or 'restart: supervised'"
            )
        if self.restart != "automatic" and not self.latch:
            raise ValueError(
                f"restart {self.restart} needs causes in latch; leave latch out for"
                f" [{', '.join(INTERLOCKED)}]"
            )
        return self

    @model_validator(mode="after")
    def _slower_than_fastest(self) -> Self:
        if self.limits.arm_speed_m_s < self.limits.body_speed_m_s:
            raise ValueError("limits.arm_speed_m_s must be at least limits.body_speed_m_s")
        return self

    @model_validator(mode="after")
    def _checked_contact(self) -> Self:
        if self.mode == "hybrid" and not self.coverage.self_check:
            raise ValueError(
                "mode hybrid needs coverage.self_check: a robot may not touch people where its"
                " forecasts are not checked"
            )
        return self

    @property
    def uses_forecasts(self) -> bool:
        """Whether zones rest on forecasts and their calibration."""
        return self.mode in ("predictive", "hybrid")

    @property
    def judges_over_time(self) -> bool:
        """Whether zones over time are used, not only the present distance."""
        return self.uses_forecasts or self.mode == "reactive"

    @property
    def beyond_horizon(self) -> bool:
        """Whether zones may extend beyond the last forecast step; ``reactive`` uses no forecast."""
        return self.limits.extend_beyond_horizon or self.mode == "reactive"

    @property
    def clearance_m(self) -> float:
        """C + Z_d + Z_r, metres: minimum distance at all times."""
        return self.intrusion_m + self.person_uncertainty_m + self.robot_uncertainty_m

    @property
    def margins_m(self) -> tuple[float, float, float, float]:
        """Margins subtracted from a hazard's distance for each limit of a finding, metres.

        Order: limit, release of the limit, warning, release of the warning.
        """
        slow, warn = self.slow_margin_m, self.slow_margin_m + self.warn_margin_m
        return slow, slow + self.band_m, warn, warn + self.band_m
