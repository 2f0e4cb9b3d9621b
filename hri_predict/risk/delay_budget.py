"""The delay budget: the terms of T_r, the time from a capture until the robot starts to brake.

    T_r = age at encoding + one cycle + link delay + the controller's silence time-out + reaction

The silence time-out is included because the decisive frame may be lost; then the robot brakes only
after the controller has detected the silence. One capture is enough for advice, so no captures are
counted here. For a robot with several links, the slowest link applies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from hri_predict.base.errors import ConfigError
from hri_predict.contracts.link import LinkSettings

ENCODING_FRACTION = 0.5
"""Maximum time from the tick to encoding, in cycles; a later prediction is replaced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkDelay:
    """The delays of one link; ``robots``: names of the robots that it advises, ``None``: all."""

    name: str
    robots: frozenset[str] | None
    delay_s: float
    silence_timeout_s: float
    reaction_s: float

    @property
    def total_s(self) -> float:
        """Seconds from encoding until the robot starts to brake, without the cycle."""
        return self.delay_s + self.silence_timeout_s + self.reaction_s


@dataclass(frozen=True, slots=True)
class DelayBudget:
    """The delays between a capture and the start of braking, seconds.

    Attributes:
        stale_s: age at which input becomes stale: the maximum age of the input for any advice.
        encoding_s: from the tick to encoding.
        cycle_s: one cycle of the node.
        links: the delays of each link.
    """

    stale_s: float
    encoding_s: float
    cycle_s: float
    links: tuple[LinkDelay, ...]

    @classmethod
    def from_settings(cls, rate_hz: float, links: Sequence[LinkSettings], stale_s: float) -> Self:
        """Return the budget of a node at ``rate_hz``; input is stale at the age ``stale_s``."""
        return cls(
            stale_s=stale_s,
            encoding_s=ENCODING_FRACTION / rate_hz,
            cycle_s=1.0 / rate_hz,
            links=tuple(
                LinkDelay(
                    name=link.name,
                    # an empty list means all, as everywhere in the configuration
                    robots=frozenset(link.robots) if link.robots else None,
                    delay_s=link.delay_s + link.blocking_s,
                    silence_timeout_s=link.silence_timeout_s,
                    reaction_s=link.reaction_s,
                )
                for link in links
                if link.advises
            ),
        )

    def after_now_s(self, robot: str | None = None) -> float:
        """Return the time from the tick until ``robot`` (default: slowest) brakes, in seconds."""
        worst = self._worst(robot)
        return self.encoding_s + self.cycle_s + (worst.total_s if worst is not None else 0.0)

    def reaction_s(self, age_s: float, robot: str | None = None) -> float:
        """Return T_r, seconds, for advice on a capture with age ``age_s`` at the tick."""
        return age_s + self.after_now_s(robot)

    def terms(self, robot: str | None = None) -> Mapping[str, float]:
        """Return the maximum of each term, s, in the contract's order; they add up to the maximum
        T_r.

        ``age`` is the maximum age at the tick before input becomes stale; ``encoding`` is the time
        from the tick until the message is encoded.
        """
        worst = self._worst(robot)
        return {
            "age": self.stale_s,
            "encoding": self.encoding_s,
            "cycle": self.cycle_s,
            "link_delay": worst.delay_s if worst is not None else 0.0,
            "silence_timeout": worst.silence_timeout_s if worst is not None else 0.0,
            "reaction": worst.reaction_s if worst is not None else 0.0,
        }

    def oldest_s(self, robots: Sequence[str]) -> Mapping[str, float]:
        """Return the maximum age of advice that the controller on each link may obey, s, by link.

        Each robot's distances contain its own T_r, so a robot on a fast link needs a lower limit
        than one on a slow link. The controller brakes within ``reaction_s`` of refusing.
        """
        return {
            link.name: min(
                self.reaction_s(self.stale_s, robot)
                for robot in robots
                if link.robots is None or robot in link.robots
            )
            - link.reaction_s
            for link in self.links
        }

    def oldest_sent_s(self, robots: Sequence[str]) -> Mapping[str, float]:
        """Return the maximum age of advice that the node may send on each link, s, by link.

        It is that of ``oldest_s`` without the link's delay: what a link that refuses old advice
        sends instead needs that time to reach the controller.
        """
        oldest_s = self.oldest_s(robots)
        return {link.name: oldest_s[link.name] - link.delay_s for link in self.links}

    def check(
        self, robot: str, stopping_s: float, horizon_s: float, extend_beyond_horizon: bool
    ) -> None:
        """Check that the forecast covers the robot's stop completely.

        Args:
            robot: the robot's name.
            stopping_s: T_s at its highest speed.
            horizon_s: the forecast's last step after the capture.
            extend_beyond_horizon: whether physical limits are used beyond the horizon.

        Raises:
            ConfigError: T_r + T_s exceeds the horizon, and the horizon is not extended.
        """
        reaction_s = self.reaction_s(self.stale_s, robot)
        if extend_beyond_horizon or reaction_s + stopping_s <= horizon_s + 1e-9:
            return
        raise ConfigError(
            f"predictor.horizon_s: the delay budget of robot {robot}, T_r {reaction_s:.3f} s + T_s "
            f"{stopping_s:.3f} s, exceeds the last horizon, {horizon_s:.3f} s; "
            f"{self.stale_s:.3f} s of it are source.stale_s, which follows from the source's rate: "
            "use a faster source, raise predictor.horizon_s up to what its calibration reaches "
            "(the shipped ones: 1.2 s), lower the robot's max_speed_m_s or the links' times, or "
            "set risk.limits.extend_beyond_horizon: true"
        )

    def _worst(self, robot: str | None) -> LinkDelay | None:
        heard = [k for k in self.links if robot is None or k.robots is None or robot in k.robots]
        return max(heard, key=lambda link: link.total_s, default=None)
