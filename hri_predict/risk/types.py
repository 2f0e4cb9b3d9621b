"""Results of the risk stage."""

from collections.abc import Callable
from dataclasses import dataclass

from hri_predict.base.geometry import Capsules
from hri_predict.protocol.messages import Advice
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.terms import ProtectiveDistance, protective_distance
from hri_predict.zones.types import Zones


@dataclass(frozen=True, slots=True)
class Assessment:
    """Findings of the risk stage in one tick.

    Attributes:
        advices: one per robot, in the configuration's order.
        zones: the zones behind the advice.
        named_zones: the state of each of the user's named zones.
        reasons: reasons for degraded zones; empty if there is no problem.
        near_misses: near misses, at most one per robot.
        ask_grounds: computes ``grounds`` on demand, because only a recorder reads them.
        set_in_force: number and hash of the configuration set; ``None`` without sets.
    """

    advices: tuple[Advice, ...]
    zones: Zones
    named_zones: tuple["NamedZoneState", ...]
    reasons: tuple[Reason, ...] = ()
    near_misses: tuple["NearMiss", ...] = ()
    ask_grounds: Callable[[], tuple["Grounds", ...]] = tuple
    set_in_force: tuple[int, int] | None = None

    @property
    def grounds(self) -> tuple["Grounds", ...]:
        """Grounds of each robot's advice; empty if unknown. Thread-safe."""
        return self.ask_grounds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Grounds:
    """Grounds of one robot's advice, for explaining it later.

    Attributes:
        unknown: why the robot's situation is unknown; the other fields are then empty.
        speed_m_s: speed of the robot's fastest point.
        capsules: (C,) the robot's capsules as used now.
        way: rule for the deciding people: ``zones``, ``standard`` or ``contact``; "" if there are
            no people.
        person, segment, link: the deciding pair: the person's id, the body's segment by name, the
            robot's capsule by index.
        pair: the body's segment and the robot's capsule of that pair, as they are now.
        pair_m: the distance of that pair now; negative where they overlap.
        separation_m: smallest present distance of all pairs; the deciding pair over time need not
            be the nearest.
        slack_m: distance of the person beyond the distance that the robot's present motion
            requires.
        milder_way, milder_slack_m: the rule with the most slack for the same people, and this
            slack, if it is not ``way``: a robot may move as soon as one rule permits it.
        hidden_ends: number of the segment's two joints that were not seen, so that its place is
            inferred; 0 for a lost person.
        reaction_s, stopping_s, stopping_m: T_r from the capture, T_s and S_s at that speed.
        intrusion_m, person_uncertainty_m, robot_uncertainty_m: C, Z_d, Z_r.
        human_m_s: speed of the person, if faster than the standard assumes; else 0.
        place_error_m: stated position error of the person, by which these distances are reduced.
    """

    unknown: tuple[Reason, ...] = ()
    speed_m_s: float | None = None
    capsules: Capsules | None = None
    way: str = ""
    person: int | None = None
    segment: str = ""
    link: int | None = None
    pair: tuple[Capsules, Capsules] | None = None
    pair_m: float | None = None
    separation_m: float | None = None
    slack_m: float | None = None
    milder_way: str = ""
    milder_slack_m: float | None = None
    hidden_ends: int = 0
    reaction_s: float = 0.0
    stopping_s: float = 0.0
    stopping_m: float = 0.0
    intrusion_m: float = 0.0
    person_uncertainty_m: float = 0.0
    robot_uncertainty_m: float = 0.0
    human_m_s: float = 0.0
    place_error_m: float = 0.0

    @property
    def needed_m(self) -> float | None:
        """Distance that the robot's present motion requires, as used for the advice."""
        if self.separation_m is None or self.slack_m is None:
            return None
        return self.separation_m - self.slack_m

    @property
    def pair_needed_m(self) -> float | None:
        """Value of ``pair_m`` that the robot's present motion requires, by the milder rule."""
        if self.pair_m is None or self.slack_m is None:
            return None
        slack_m = self.slack_m if self.milder_slack_m is None else self.milder_slack_m
        return self.pair_m - slack_m

    @property
    def terms(self) -> ProtectiveDistance | None:
        """S_p at the present speed, term by term; as in the standard, for every mode."""
        if self.speed_m_s is None:
            return None
        return protective_distance(
            self.speed_m_s,
            self.reaction_s,
            self.stopping_s,
            self.stopping_m,
            intrusion_m=self.intrusion_m,
            person_uncertainty_m=self.person_uncertainty_m,
            robot_uncertainty_m=self.robot_uncertainty_m,
            human_m_s=self.human_m_s,
        )


@dataclass(frozen=True, slots=True)
class NearMiss:
    """A moving robot with hardly more distance to a person than its motion requires.

    Attributes:
        robot: its index.
        person: the id.
        segment: name of the body's segment.
        link: index of the robot's capsule.
        separation_m: the distance now.
        limit_m: the distance that the robot's motion requires.
    """

    robot: int
    person: int
    segment: str
    link: int
    separation_m: float
    limit_m: float


@dataclass(frozen=True, slots=True)
class NamedZoneState:
    """A named zone at one tick.

    Attributes:
        name: as configured.
        occupied: whether a person is inside now.
        entry_s: seconds until a person may first be inside; 0 if occupied, ``None`` if not within
            the horizon.
    """

    name: str
    occupied: bool
    entry_s: float | None
