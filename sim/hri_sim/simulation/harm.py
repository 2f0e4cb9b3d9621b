"""Consequences of touches by a moving robot: speed and body part of each touch.

The speed of a touch is that of the robot's fastest point, an upper bound for the touching link. The
*relative* speed adds the speed of the body part. Recorded people do not react: they walk on through
a robot that touches them, so a touch may go deeper, and reach other parts, than in reality.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import Capsules, norm
from hri_predict.base.skeleton import CANONICAL
from hri_predict.risk.contact.judges import fixtures_of, segment_limits
from hri_predict.risk.fixtures import Fixture, floor, gaps
from hri_predict.robots.model import RobotModel, RobotSettings
from hri_predict.run.config import Config
from hri_sim.referee import Contact


@dataclass(frozen=True, slots=True, eq=False)
class Bearable:
    """Limits of what people can bear from one robot.

    Attributes:
        transient_m_s, clamped_m_s: (B,) limits of the referee's capsules, see ``SegmentLimits``.
        fixtures: objects against which the robot may clamp a person.
    """

    transient_m_s: Floats
    clamped_m_s: Floats
    fixtures: Sequence[Fixture]

    @classmethod
    def of(cls, config: Config, robot: RobotSettings, model: RobotModel) -> "Bearable":
        """Return the limits of a robot that may touch people."""
        risk = config.node.risk
        limits = segment_limits(risk, model, CANONICAL.segment_names, config.base_dir)
        ground = floor(config.node.people.floor_m, "floor")
        return cls(
            _with_joints(limits.transient_m_s),
            _with_joints(limits.clamped_m_s),
            [ground, *fixtures_of(risk, robot)],
        )


def _with_joints(limits: Floats) -> Floats:
    """A lone joint has the limits of the most delicate segment that ends there."""
    joints = [
        min(
            (v for s, v in zip(CANONICAL.segments, limits, strict=True) if j in _joints_of(s.name)),
            default=0.0,
        )
        for j in range(len(CANONICAL.joints))
    ]
    return np.append(limits, joints)


def _joints_of(segment: str) -> tuple[int, ...]:
    found = next(s for s in CANONICAL.segments if s.name == segment)
    inside = (CANONICAL.index("head"),) if segment == "head" else ()
    return (found.joint_a, found.joint_b, *inside)


NAMES = (*CANONICAL.segment_names, *CANONICAL.joints)
"""Names of the referee's capsules."""


@dataclass(kw_only=True)
class Touches:
    """Consequences of the touches of an episode.

    Attributes:
        touch_speeds_m_s, touch_relative_m_s: segment or joint -> maximum speed of a touch.
        touch_limits_m_s: maximum permissible speed of a touch of the same parts; the lowest for
            several robots.
        touches_beyond: number of instants with a touch faster than permissible; an instant counts
            once for each robot, whatever the number of people and parts.
        touches_relative_beyond: the same for the relative speed.
        touches_forbidden: number of instants with a touch of head, face or neck.
        clampings: number of instants at which a part was between a link and a fixture, and the
            robot faster than permissible.
    """

    touch_speeds_m_s: dict[str, float] = field(default_factory=dict)
    touch_relative_m_s: dict[str, float] = field(default_factory=dict)
    touch_limits_m_s: dict[str, float] = field(default_factory=dict)
    touches_beyond: int = 0
    touches_relative_beyond: int = 0
    touches_forbidden: int = 0
    clampings: int = 0


@dataclass
class Harm(Touches):
    """Counts the consequences of touches; pass ``note`` to the referee.

    Attributes:
        bearable: limits by robot name.
    """

    bearable: Mapping[str, Bearable]

    def note(self, contact: Contact) -> None:
        """Record the touches of one robot since the last observation."""
        if contact.robot not in self.bearable:
            return
        limits = self.bearable[contact.robot]
        hits = (contact.distance <= 0).any(-1) & contact.moving[:, None]  # (P, K, B)
        own = np.maximum(norm(contact.velocity[0]), norm(contact.velocity[1]))  # (P, B)
        person, instant, body = np.nonzero(hits)
        fastest = contact.speed[instant]
        relative = fastest + own[person, body]
        for b, alone, both in zip(body, fastest, relative, strict=True):
            name = NAMES[b]
            self.touch_speeds_m_s[name] = max(self.touch_speeds_m_s.get(name, 0.0), float(alone))
            self.touch_relative_m_s[name] = max(self.touch_relative_m_s.get(name, 0.0), float(both))
        most = limits.transient_m_s[body]
        for b, bears in zip(body, most.tolist(), strict=True):
            self.touch_limits_m_s[NAMES[b]] = min(self.touch_limits_m_s.get(NAMES[b], bears), bears)
        clamped = self._clamps(contact, limits, (person, instant, body))
        self.touches_forbidden += len(np.unique(instant[most == 0]))
        self.touches_beyond += len(np.unique(instant[fastest > most]))
        self.touches_relative_beyond += len(np.unique(instant[relative > most]))
        self.clampings += len(np.unique(instant[clamped]))

    def _clamps(self, contact: Contact, limits: Bearable, at: tuple[Ints, Ints, Ints]) -> Bools:
        """Return (n,) whether a touched part is pressed against a fixture too fast."""
        person, instant, body = at
        people, robot = contact.bodies, contact.links
        part = Capsules(
            people.a[person, instant, body],
            people.b[person, instant, body],
            people.radius[person, instant, body],
        )
        links = Capsules(robot.a[instant], robot.b[instant], robot.radius[instant])
        against = gaps(part, limits.fixtures) <= 0  # (n, F)
        left = gaps(links, limits.fixtures)  # (n, C, F)
        touching = contact.distance[person, instant, body] <= 0  # (n, C)
        narrow = left < 2 * part.radius[:, None, None]
        pressed = (touching[..., None] & narrow & against[:, None]).any(axis=(1, 2))
        fast: Bools = contact.speed[instant] > limits.clamped_m_s[body]
        return pressed & fast

    def touches(self) -> dict[str, Any]:
        """Return the counts."""
        return {each.name: getattr(self, each.name) for each in fields(Touches)}
