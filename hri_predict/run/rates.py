"""Settings of the loop: how often it ticks, and when a tick's messages leave."""

from typing import Literal, Self

from pydantic import Field, model_validator

from hri_predict.base.settings import Settings
from hri_predict.risk.delay_budget import ENCODING_FRACTION

MAX_TICKS_HZ = 100.0


class RateSettings(Settings):
    """Rates of a node: its part of the top level of a configuration."""

    rate_hz: float = Field(
        25.0, ge=10, le=100, description="cycles per second; controllers expect at least 10"
    )
    ticks: Literal["fixed", "capture"] = Field(
        "fixed",
        description="fixed: at rate_hz; capture: when a scene arrives, and at least at rate_hz",
    )
    max_rate_hz: float | None = Field(
        None,
        ge=10,
        le=MAX_TICKS_HZ,
        description="with ticks: capture, maximum cycles per second; default: 100",
    )
    publish_phase_s: float | None = Field(
        None,
        ge=0,
        le=60,
        description="with ticks: fixed, time from a tick's deadline to its messages, half a cycle "
        "at most; 0: as soon as computed; default: learned from the first minute with people",
    )

    @model_validator(mode="after")
    def _phase_fits(self) -> Self:
        if self.publish_phase_s is None:
            return self
        if self.ticks == "capture":
            raise ValueError("publish_phase_s has no effect with ticks: capture; remove it")
        if self.publish_phase_s > (longest_s := ENCODING_FRACTION / self.rate_hz):
            raise ValueError(
                f"publish_phase_s {self.publish_phase_s:g} is over half a cycle, {longest_s:g} s, "
                "which the delay budget allows; lower it"
            )
        return self

    @model_validator(mode="after")
    def _rates_fit(self) -> Self:
        if self.max_rate_hz is None:
            return self
        if self.ticks == "fixed":
            raise ValueError("max_rate_hz has no effect with ticks: fixed; remove it")
        if self.max_rate_hz < self.rate_hz:
            raise ValueError(
                f"max_rate_hz {self.max_rate_hz:g} is below rate_hz {self.rate_hz:g}; raise "
                "max_rate_hz or lower rate_hz"
            )
        return self

    @property
    def largest_rate_hz(self) -> float:
        """Maximum cycles per second; the links' capacity must suffice for it."""
        return self.rate_hz if self.ticks == "fixed" else self.max_rate_hz or MAX_TICKS_HZ
