"""The delay budget: the terms of T_r, the time from a capture until the robot begins to brake.

    T_r = age at encoding + one cycle + link delay + the controller's silence time-out + reaction

The silence time-out counts because the one frame that matters may be lost: then the robot brakes
only when the controller has noticed the silence. One capture is enough for advice, so trigger
counts add nothing. For a robot with several links, only the slowest link counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from hri_predict.base.errors import ConfigError
from hri_predict.contracts.link import LinkSettings

ENCODING_FRACTION = 0.5
"""Part of a cycle from the tick to encoding, at worst: a later prediction is replaced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkDelay:
    """The delays of one link; ``robots`` are the names of the robots it advises, ``None``: all."""

    name: str
    robots: frozenset[str] | None
    delay_s: float
    silence_timeout_s: float
    reaction_s: float

    @property
    def total_s(self) -> float:
        """Seconds from encoding until the robot begins to brake, without the cycle."""
        return self.delay_s + self.silence_timeout_s + self.reaction_s


@dataclass(frozen=True, slots=True)
class DelayBudget:
    """The delays between a capture and braking, seconds.

    Attributes:
        stale_s: age at which input counts as stale: the worst age of input behind any advice.
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
        """Budget of a node at ``rate_hz`` whose input is stale at the age ``stale_s``."""
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
        """Seconds from the tick until ``robot`` (default: the slowest) begins to brake."""
        worst = self._worst(robot)
        return self.encoding_s + self.cycle_s + (worst.total_s if worst is not None else 0.0)

    def reaction_s(self, age_s: float, robot: str | None = None) -> float:
        """T_r, seconds, for advice on a capture whose age is ``age_s`` at the tick."""
        return age_s + self.after_now_s(robot)

    def terms(self, robot: str | None = None) -> Mapping[str, float]:
        """Each term and its seconds at worst, in the contract's order; their sum is T_r at worst.

        ``age`` is the age at the tick when the input is just not stale; ``encoding`` is the time
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

    def check(
        self, robot: str, stopping_s: float, horizon_s: float, extend_beyond_horizon: bool
    ) -> None:
        """Check that the forecast reaches to the end of the robot's stop.

        Args:
            robot: the robot's name.
            stopping_s: T_s at its highest speed.
            horizon_s: the forecast's last step after the capture.
            extend_beyond_horizon: whether the physical limits take over past the horizon.

        Raises:
            ConfigError: T_r + T_s goes past the horizon and nothing extends it.
        """
        reaction_s = self.reaction_s(self.stale_s, robot)
        if extend_beyond_horizon or reaction_s + stopping_s <= horizon_s + 1e-9:
            return
        raise ConfigError(
            f"predictor.horizon_s: the delay budget of robot {robot}, T_r {reaction_s:.3f} s + T_s"
            f" {stopping_s:.3f} s, goes past the last horizon, {horizon_s:.3f} s; raise"
            " predictor.horizon_s, lower the robot's max_speed_m_s or the links' times, or set"
            " risk.limits.extend_beyond_horizon: true"
        )

    def _worst(self, robot: str | None) -> LinkDelay | None:
        heard = [k for k in self.links if robot is None or k.robots is None or robot in k.robots]
        return max(heard, key=lambda link: link.total_s, default=None)
