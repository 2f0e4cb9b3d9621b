"""The publisher: what is told to whom, and how often."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.predictor import Forecast
from hri_predict.node.listeners import Tick
from hri_predict.node.publisher import Publisher
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Advice,
    Level,
    NodeState,
    Pose,
    Schema,
    Status,
    Zone,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.zones.types import Zones

MS = 1_000_000
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=0)
ADVICES = [
    Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0),
    Advice(robot=1, level=Level.STOP, reason=Reason.PERSON_NEAR, latch_id=9, speed_limit_m_s=0.0),
]
PREDICTOR: Any = SimpleNamespace(rate_hz=20.0, skeleton=CANONICAL)


class Posted:
    def __init__(self):
        self.messages = []

    def post(self, message):
        self.messages.append(message)

    def of(self, kind):
        return [m for m in self.messages if isinstance(m, kind)]


def make(*robots, shadow=False):
    links: list[Any] = [Posted() for _ in robots]
    return Publisher(links, [frozenset(r) for r in robots], PREDICTOR, shadow), links


def tick_of(zones=None, **parts: Any) -> Tick:
    assessment: Any = None if zones is None else SimpleNamespace(zones=zones)
    return Tick(
        **({"now_ns": 0, "status": STATUS, "advices": ADVICES, "assessment": assessment} | parts)
    )


def zones_of(segments, people=(7,), steps=5):
    """A capsule whose every number tells who, when and which segment it is."""
    p, k, s = np.meshgrid(people, range(steps), range(len(segments)), indexing="ij")
    a = np.stack([p, k, s], axis=-1).astype(float)
    capsules = Capsules(a, a + 0.5, 0.1 + s * 0.01)
    return Zones(
        ids=tuple(people), segments=tuple(segments), times_s=np.arange(steps) * 0.1,
        capsules=capsules,
    )  # fmt: skip


def snapshot(people=(7,), capture_ns=5 * MS) -> Any:
    return SimpleNamespace(
        now_ns=capture_ns + 20 * MS,
        ids=tuple(people),
        newest_capture_ns=capture_ns,
        capture_ns=np.array([capture_ns - i * MS for i in range(len(people))]),
    )


@pytest.mark.parametrize("rate_hz", [10, 25, 100])
def test_schema_is_told_at_the_start_and_once_a_second(rate_hz):
    publisher, (link,) = make({0})
    period = 1_000 * MS // rate_hz
    at = []
    for tick in range(3 * rate_hz + 1):
        publisher.publish(tick_of(now_ns=tick * period))
        at += [tick * period // MS] * len(link.of(Schema))
        link.messages.clear()
    assert at == [0, 1000, 2000, 3000]


def test_schema_is_the_protocols_own():
    publisher, (link,) = make({0})
    publisher.publish(tick_of())
    assert link.of(Schema) == [Schema(SCHEMA_VERSION, SCHEMA_HASH)]


def test_advice_goes_to_the_links_of_that_robot_alone_and_status_to_all():
    publisher, links = make({0}, {1}, {0, 1}, set())
    told = publisher.publish(tick_of())
    assert [[m.robot for m in link.of(Advice)] for link in links] == [[0], [1], [0, 1], []]
    assert all(link.of(Status) == [STATUS] for link in links)
    assert [m for m in told if isinstance(m, Advice)] == ADVICES


def test_advice_and_status_come_before_what_is_bulky():
    publisher, (link,) = make({0, 1})
    forecast = Forecast(np.zeros((1, 10, len(JOINTS), 3)), None)
    zones = zones_of(CANONICAL.segment_names)
    publisher.publish(tick_of(zones=zones, forecast=forecast, snapshot=snapshot()))
    kinds = [type(m).__name__ for m in link.messages]
    assert kinds[:4] == ["Advice", "Advice", "Status", "Schema"]
    assert set(kinds[4:]) == {"Zone", "Pose"}


def test_segments_keep_their_numbers_when_parts_are_absent():
    names = CANONICAL.segment_names
    legs = ("thigh", "shank", "foot")
    here = [n for n in names if not any(leg in n for leg in legs)]
    assert 0 < len(here) < len(names)
    publisher, (link,) = make({0})
    publisher.publish(tick_of(zones=zones_of(here), snapshot=snapshot()))
    for zone in link.of(Zone):
        assert [names[c.segment] for c in zone.capsules] == here
        for i, capsule in enumerate(zone.capsules):
            assert capsule.a == (7.0, float(zone.step), float(i))
            assert capsule.b == (7.5, zone.step + 0.5, i + 0.5)
            assert capsule.radius == pytest.approx(0.1 + i * 0.01)


def test_zones_are_first_middle_and_last_of_everybody():
    publisher, (link,) = make({0})
    zones = zones_of(CANONICAL.segment_names, people=(7, 3), steps=9)
    publisher.publish(tick_of(zones=zones, snapshot=snapshot((7,))))
    told = {(z.person, z.step): z for z in link.of(Zone)}
    assert sorted(told) == [(3, 0), (3, 4), (3, 8), (7, 0), (7, 4), (7, 8)]
    assert told[7, 0].horizon_s == 0.0  # the body at its capture, 20 ms ago
    assert told[7, 4].horizon_s == pytest.approx(0.42)  # zones count from now, the wire from there
    assert told[3, 4].horizon_s == pytest.approx(0.42)
    assert told[3, 4].capsules[2].a == (3.0, 4.0, 2.0)  # a lost person has a zone, too
    assert {z.capture_ns for z in told.values()} == {5 * MS}


def test_poses_carry_their_persons_capture_and_time():
    publisher, (link,) = make({0})
    positions = np.random.default_rng(1).normal(size=(2, 10, len(JOINTS), 3))
    publisher.publish(tick_of(forecast=Forecast(positions, None), snapshot=snapshot((7, 3))))
    told = {(z.person, z.step): z for z in link.of(Pose)}
    assert sorted({step for _, step in told}) == [1, 6, 10]  # step 0 is the capture itself
    for (person, step), pose in told.items():
        p = (7, 3).index(person)
        assert pose.horizon_s == pytest.approx(step / 20.0)
        assert pose.capture_ns == (5 - p) * MS
        expected = [(j, *positions[p, step - 1, j]) for j in range(len(JOINTS))]
        np.testing.assert_array_equal(pose.joints, expected)


def test_in_shadow_mode_links_hear_unknown_and_nothing_of_people():
    publisher, (link,) = make({0, 1}, shadow=True)
    forecast = Forecast(np.zeros((1, 10, len(JOINTS), 3)), None)
    zones = zones_of(CANONICAL.segment_names)
    told = publisher.publish(tick_of(zones=zones, forecast=forecast, snapshot=snapshot()))
    assert told == link.messages
    for advice in link.of(Advice):
        assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.SHADOW_MODE)
        assert (advice.speed_limit_m_s, advice.latch_id) == (0.0, 0)
    assert not link.of(Zone)
    assert not link.of(Pose)


def test_nobody_here_gives_no_zones_and_no_poses():
    publisher, (link,) = make({0})
    forecast = Forecast(np.zeros((0, 10, len(JOINTS), 3)), None)
    zones = zones_of(CANONICAL.segment_names, people=())
    publisher.publish(tick_of(zones=zones, forecast=forecast, snapshot=snapshot(())))
    assert {type(m) for m in link.messages} == {Advice, Status, Schema}
