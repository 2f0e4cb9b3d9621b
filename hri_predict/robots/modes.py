"""Operating modes that an integrator may allow for a robot; none is allowed by default."""

from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import MIN_SPEED_M_S, Settings


class TeachMode(Settings):
    """Teaching at reduced speed: manual mode, and the enabling device held.

    The limit is that of ISO 10218-1:2011, 5.6.3 and 5.7.3 (manual reduced speed): 250 mm/s. There
    it applies to the tool centre point; here it applies to every point of the robot.
    """

    speed_m_s: float = Field(
        0.25,
        ge=MIN_SPEED_M_S,
        le=0.25,
        strict=True,
        description="maximum speed of the fastest point",
    )

    safety: ClassVar[Safety] = harmless("speed_m_s")


class RecoveryMode(Settings):
    """Slow backing out after people stopped the robot, while no link moves closer to a person.

    The robot moves backwards along the path of its ``motion.plan``.
    """

    speed_m_s: float = Field(
        0.1, ge=MIN_SPEED_M_S, le=0.1, strict=True, description="maximum speed of the fastest point"
    )

    safety: ClassVar[Safety] = harmless("speed_m_s")


RESTS = 9
"""Default ratio of muting's recovery time to its budget: at most a tenth of the time is muted."""


class MutingMode(Settings):
    """People and zones do not stop the robot for a limited time."""

    max_s: float = Field(
        ge=1,
        le=600,
        strict=True,
        description="total muted time over any number of requests, until it has recovered; muting "
        "then ends automatically, and the request must be released",
    )
    rest_s: float | None = Field(
        None,
        ge=1,
        le=86_400,
        strict=True,
        description="time without a request in which max_s recovers; recovery is proportional, "
        "but once used up the budget must recover completely; default: nine times "
        "max_s",
    )
    speed_m_s: float | None = Field(
        None,
        ge=MIN_SPEED_M_S,
        le=20,
        strict=True,
        description="speed of the fastest point; default: the robot's maximum",
    )

    safety: ClassVar[Safety] = {
        **harmless("speed_m_s"),  # a value can only lower it
        "rest_s": LessSafe(other="the robot may be muted again after {value:g} s"),
    }

    @property
    def recovery_s(self) -> float:
        """Time without a request in which the full ``max_s`` recovers."""
        return RESTS * self.max_s if self.rest_s is None else self.rest_s

    @property
    def share(self) -> float:
        """Long-term fraction of the time for which the robot may be muted."""
        return self.max_s / (self.max_s + self.recovery_s)

    @model_validator(mode="after")
    def _rests(self) -> Self:
        if self.recovery_s < self.max_s:
            raise ValueError(
                f"rest_s {self.recovery_s:g} is shorter than max_s {self.max_s:g}, so people would "
                "be ignored for more than half of the time; raise rest_s, or lower max_s"
            )
        return self


class ModeSettings(Settings):
    """``robots[].modes``: modes not listed are refused."""

    teach: TeachMode | None = Field(None, description="allow teaching by hand at reduced speed")
    recovery: RecoveryMode | None = Field(None, description="allow slow backing out after a stop")
    muting: MutingMode | None = Field(
        None, description="allow a limited time during which people do not stop the robot"
    )

    safety: ClassVar[Safety] = {
        "teach": LessSafe(other="people do not stop the robot while its enabling device is held"),
        "recovery": LessSafe(other="the robot may back out slowly near people"),
        "muting": LessSafe(other="people do not stop the robot for some time"),
    }

    @property
    def allowed(self) -> list[str]:
        """Return the keys of the allowed modes."""
        return [key for key in type(self).model_fields if getattr(self, key) is not None]
