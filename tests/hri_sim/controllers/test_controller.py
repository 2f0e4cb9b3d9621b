"""The mock controller's rule: whatever is not good, fresh and permissive stops the robot.

A small node is played at the other end of the codecs; time is stepped in milliseconds.
"""

from dataclasses import replace

import numpy as np
import pytest

from hri_drivers.links.can.link import CanCodec, CanLinkSettings
from hri_drivers.links.framed import SerialCodec
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Acknowledge,
    Level,
    RobotState,
    Schema,
)
from hri_sim.controllers.controller import ControllerCore, ControllerSettings
from tests.messages import make_advice

MS = 1_000_000
FULL = 1.0
GOOD = make_advice(Level.CLEAR, speed_limit_m_s=FULL, echo=0, age_s=0.04)
SCHEMA = Schema(SCHEMA_VERSION, SCHEMA_HASH)


def make_codec(kind):
    if kind == "serial":
        return SerialCodec(115200)
    return CanCodec(
        CanLinkSettings(name="x", interface="virtual", channel="x", fd=kind == "can_fd")
    )


class Pair:
    """A controller and a played node; advice every 40 ms, schema every second."""

    def __init__(self, kind="serial", **settings):
        values = {"reaction_s": 0.05, "silence_timeout_s": 0.15, "state_rate_hz": 50.0}
        self.core = ControllerCore(
            name="link",
            settings=ControllerSettings(**{**values, **settings}),
            robot=0,
            codec=make_codec(kind),
            full_speed_m_s=FULL,
        )
        self.node = make_codec(kind)
        self.ms = 0
        self.echo = None
        self.heard = []
        self.speeds = []  # permit at every millisecond
        self.causes = []

    def run(self, ms, advice=GOOD, schema=SCHEMA, spoil=None, late_ms=0):
        """Run for ``ms``; ``advice`` may be a function of the time, ``None`` means silence."""
        for _ in range(ms):
            now_ns = self.ms * MS
            units = []
            if schema is not None and self.ms % 1000 == 0:
                units += self.node.encode(schema)
            if self.ms % 40 == 0:
                message = advice(self.ms) if callable(advice) else advice
                if message is not None:
                    if message.echo is not None:
                        message = replace(message, echo=self.echo_of(late_ms))
                    units += self.node.encode(message)
            if spoil is not None:
                units = spoil(units)
            self.core.receive(units, now_ns)
            permit = self.core.permit(now_ns)
            self.core.obey(permit, now_ns)
            self.speeds.append(permit.speed_m_s)
            self.causes.append(permit.cause)
            q = np.zeros(6)
            for unit in self.core.outgoing(now_ns, q, q):
                for message in self.node.decode(unit):
                    self.heard.append((self.ms, message))
            self.ms += 1
        return self

    def echo_of(self, late_ms):
        """Counter of the newest RobotState that is at least ``late_ms`` old."""
        states = [
            m.counter for t, m in self.heard if isinstance(m, RobotState) and t <= self.ms - late_ms
        ]
        return states[-1] if states else None

    @property
    def moving(self):
        return self.speeds[-1] > 0


def running(kind="serial", **settings):
    pair = Pair(kind, **settings).run(1500)
    assert pair.moving
    return pair


@pytest.mark.parametrize("kind", ["serial", "can", "can_fd"])
def test_good_advice_moves_it_over_every_kind_of_link(kind):
    pair = running(kind)
    assert pair.speeds[-1] == pytest.approx(FULL, abs=0.005)
    report = pair.core.report()
    assert (report.crc_errors, report.counter_errors, report.malformed) == (0, 0, 0)
    assert report.messages == len(range(0, 1500, 40)) + 2
    assert report.states_sent == 75
    assert report.max_gap_s == pytest.approx(0.040)
    assert report.max_age_s == pytest.approx(0.04, abs=0.005)
    assert report.round_trip_p50_s is not None
    assert report.round_trip_p50_s <= 0.020
    assert (report.stops, report.slowdowns, report.timeouts) == (0, 0, 0)


def test_each_round_trip_is_reported_where_it_is_asked_for():
    assert running().core.report().round_trips == []
    report = running(keep_round_trips=True).core.report()
    seconds = [s for _, s in report.round_trips]
    assert len(seconds) >= 30
    assert report.round_trip_max_s == pytest.approx(max(seconds))
    assert report.round_trip_p50_s == pytest.approx(float(np.median(seconds)))


def test_a_round_trip_needs_no_age_and_an_advice_without_one_permits_nothing():
    pair = Pair(keep_round_trips=True).run(1500, replace(GOOD, age_s=None))
    assert not pair.moving
    assert len(pair.core.report().round_trips) >= 30


BAD_ADVICE = {
    "unknown": replace(GOOD, level=Level.UNKNOWN),
    "stop": replace(GOOD, level=Level.STOP),
    "fault": replace(GOOD, level=Level.FAULT),
    "limit not available": replace(GOOD, speed_limit_m_s=None),
    "limit 0": replace(GOOD, level=Level.SLOW, speed_limit_m_s=0.0),
    "age not available": replace(GOOD, age_s=None),
    "echo not available": replace(GOOD, echo=None),
    "too old": replace(GOOD, age_s=1.0),
    "silence": None,
    "another robot's": replace(GOOD, robot=1),
}


@pytest.mark.parametrize("what", BAD_ADVICE)
def test_every_bad_advice_stops_it_and_good_advice_frees_it(what):
    pair = running()
    pair.run(500, BAD_ADVICE[what])
    assert not pair.moving
    assert pair.core.report().stops == 1
    pair.run(1500)
    assert pair.moving
    assert pair.core.report().stops == 1


@pytest.mark.parametrize("level", [Level.CLEAR, Level.WARN, Level.SLOW])
def test_it_obeys_the_speed_limit_of_every_level_that_permits_motion(level):
    pair = running().run(200, replace(GOOD, level=level, speed_limit_m_s=0.25))
    assert pair.speeds[-1] == pytest.approx(0.25, abs=0.005)


def flip(units):
    return [bytes([unit[0], unit[1] ^ 1]) + unit[2:] for unit in units]


def test_a_corrupt_message_stops_it_until_the_line_is_clean_again():
    pair = running()
    at = pair.ms
    pair.run(40, spoil=flip)
    assert not pair.moving
    assert pair.causes[-1] == "errors"
    pair.run(600)
    assert pair.moving
    report = pair.core.report()
    assert report.crc_errors + report.malformed == 1
    assert report.stop_causes == {"errors": 1}
    held = [ms for ms in range(at, pair.ms) if pair.speeds[ms] == 0]
    # the next message shows the gap in the counter; from there the window, then the wait for fresh
    # advice, then the reaction
    assert 40 + 500 <= len(held) <= 40 + 500 + 40 + 50


def test_a_corrupt_message_may_be_tolerated_but_never_obeyed():
    pair = running(tolerated_errors=2)
    pair.run(80, replace(GOOD, speed_limit_m_s=5.0), spoil=flip)
    assert pair.speeds[-1] == pytest.approx(FULL, abs=0.005)
    pair.run(40, spoil=flip)
    assert not pair.moving


def test_repeated_messages_are_not_advice():
    pair = running()
    codec = make_codec("serial")
    stale = codec.encode(SCHEMA) + codec.encode(replace(GOOD, echo=1))
    again = Pair()
    again.run(1, advice=None, schema=None)
    for _ in range(100):
        again.core.receive(stale, again.ms * MS)
        again.run(40, advice=None, schema=None)
    assert max(again.speeds) == 0.0
    # out of order: an older message after a newer one is an error and stops
    older = pair.node.encode(replace(GOOD, echo=pair.echo_of(0)))
    newer = pair.node.encode(replace(GOOD, echo=pair.echo_of(0)))
    pair.core.receive(newer + older, pair.ms * MS)
    pair.run(1, advice=None)
    assert pair.causes[-1] == "errors"


@pytest.mark.parametrize(
    "schema",
    [
        None,
        Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 1),
        Schema((SCHEMA_VERSION + 1) % 256, SCHEMA_HASH),
    ],
)
def test_nothing_counts_until_the_schema_matches(schema):
    pair = Pair().run(1500, schema=schema)
    assert max(pair.speeds) == 0.0
    assert pair.core.report().schema_mismatches == (0 if schema is None else 2)
    named = "" if schema is None else f"received Schema of version {schema.version}, "
    assert pair.core.report().schema_trouble.startswith(named)
    pair.run(1000)
    assert pair.moving


def test_a_schema_that_changes_stops_it():
    pair = running().run(600, schema=Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 1))
    assert not pair.moving
    assert pair.causes[-1] == "schema"


def test_after_a_long_silence_the_schema_must_be_heard_again():
    pair = running()
    pair.run(1400, advice=None, schema=None)
    pair.run(300, schema=None)
    assert not pair.moving
    pair.run(1400)
    assert pair.moving


def test_a_restarted_node_is_followed_at_once_with_its_counters_at_zero():
    pair = running("can")
    pair.run(1500, advice=None, schema=None)
    pair.node = make_codec("can")
    while pair.ms % 1000:
        pair.run(1, advice=None, schema=None)
    pair.run(120)
    assert pair.moving
    assert pair.core.report().counter_errors == 0


def test_advice_takes_effect_after_the_reaction_time_in_both_directions():
    pair = running(reaction_s=0.1)
    while pair.ms % 40:
        pair.run(1)
    at = pair.ms
    pair.run(400, replace(GOOD, level=Level.STOP))
    assert pair.speeds[at + 99] > 0
    assert pair.speeds[at + 100] == 0
    while pair.ms % 40:
        pair.run(1, replace(GOOD, level=Level.STOP))
    at = pair.ms
    pair.run(400)
    assert pair.speeds[at + 99] == 0
    assert pair.speeds[at + 100] > 0


@pytest.mark.parametrize("timeout_s", [0.1, 0.3])
def test_silence_stops_it_at_the_time_out_by_itself(timeout_s):
    pair = running(silence_timeout_s=timeout_s, max_age_s=2.0)
    last = max(ms for ms in range(pair.ms) if ms % 40 == 0)
    pair.run(500, advice=None)
    # it counts with its own cycle of 8 ms, so as to stop within the time-out, not after it
    assert pair.speeds[last + round(timeout_s * 1e3) - 8] > 0
    assert pair.speeds[last + round(timeout_s * 1e3) - 7] == 0
    report = pair.core.report()
    assert report.timeouts == 1
    assert report.stop_causes == {"silent": 1}


def test_what_was_heard_before_a_silence_does_not_come_back_after_it():
    # the first advice after the silence says stop: not even for the reaction time may it move
    pair = running(reaction_s=0.2)
    pair.run(600, advice=None)
    at = pair.ms
    pair.run(800, replace(GOOD, level=Level.STOP))
    assert max(pair.speeds[at:]) == 0.0


def test_the_age_counts_on_between_advices():
    # old at receipt but within the limit; 40 ms on it would be beyond
    pair = running(max_age_s=0.1, silence_timeout_s=1.0)
    pair.run(300, replace(GOOD, age_s=0.07))
    speeds = pair.speeds[-200:]
    assert min(speeds) == 0.0
    assert pair.core.report().stale >= 1


def test_a_link_that_delays_is_found_out_by_the_echo():
    # The advice claims an age of 40 ms, and comes regularly; but it took 400 ms on its way.
    pair = running()
    assert pair.run(500, late_ms=100).moving
    pair.run(500, late_ms=400)
    assert not pair.moving
    assert pair.causes[-1] == "stale"
    assert pair.core.report().stale == 1


def test_slowdowns_and_stops_are_counted_as_transitions():
    slow = replace(GOOD, level=Level.SLOW, speed_limit_m_s=0.3)
    slower = replace(GOOD, level=Level.SLOW, speed_limit_m_s=0.1)
    stop = replace(GOOD, level=Level.STOP)
    pair = running()
    for advice in (slow, slower, slow, GOOD, slow, stop, slow, stop, GOOD):
        pair.run(200, advice)
    report = pair.core.report()
    assert report.slowdowns == 2
    assert report.stops == 2
    kinds = [cause for _, cause, _ in report.events]
    assert kinds == ["clear", "slow", "clear", "slow", "stop", "slow", "stop", "clear"]


def _pressed(message):
    return isinstance(message, Acknowledge) and message.latch_id != 0


def test_the_button_is_not_pressed_while_a_node_that_started_refuses_presses():
    pair = running(acknowledge_after_s=0.5)
    for _ in range(2):
        before = len([m for _, m in pair.heard if _pressed(m)])
        pair.run(11_500, replace(GOOD, level=Level.STOP, latch_id=7))
        assert len([m for _, m in pair.heard if _pressed(m)]) == before
        pair.run(2000, replace(GOOD, level=Level.STOP, latch_id=7))
        assert len([m for _, m in pair.heard if _pressed(m)]) == before + 1
        pair.run(3000, None)  # the node is gone, and another one starts


def test_the_button_is_pressed_once_for_what_is_shown_and_after_a_pause_while_it_stays():
    pair = running(acknowledge_after_s=0.5)
    pair.run(13_000)
    pair.run(1200, replace(GOOD, level=Level.STOP, latch_id=7))
    presses = [m for _, m in pair.heard if _pressed(m)]
    assert [p.latch_id for p in presses] == [7]
    pair.run(15_000, replace(GOOD, level=Level.STOP, latch_id=7))
    presses = [m for _, m in pair.heard if _pressed(m)]
    assert [p.latch_id for p in presses] == [7, 7]
    assert len({p.ack_id for p in presses}) == 2
    assert all(p.ack_id != 0 for p in presses)
    assert not pair.moving  # pressing starts nothing
    pair.run(1000)
    assert len([m for _, m in pair.heard if _pressed(m)]) == 2


def test_garbage_never_raises_and_never_moves():
    rng = np.random.default_rng(3)
    pair = Pair()
    for _ in range(300):
        chunk = rng.integers(0, 256, rng.integers(1, 200)).astype(np.uint8).tobytes()
        pair.core.receive([chunk], pair.ms * MS)
        pair.run(5, advice=None, schema=None)
    assert max(pair.speeds) == 0.0
    report = pair.core.report()
    assert report.crc_errors + report.malformed > 100


def test_unresolved_settings_are_refused():
    with pytest.raises(ValueError, match="resolved"):
        ControllerCore(
            name="x",
            settings=ControllerSettings(),
            robot=0,
            codec=make_codec("serial"),
            full_speed_m_s=1.0,
        )


def test_a_controller_that_acknowledges_by_itself_names_what_is_shown_or_was():
    lie = {"kind": "acknowledges", "period_s": 0.1, "ids": 2}
    for names, named in (("shown", 8), ("first", 7), ("nothing", 0)):
        pair = running(lies=[lie | {"names": names}])
        pair.run(300, replace(GOOD, level=Level.STOP, latch_id=7))
        pair.run(300, replace(GOOD, level=Level.STOP, latch_id=8))
        presses = [m for _, m in pair.heard if isinstance(m, Acknowledge)]
        assert len(presses) >= 6
        assert presses[-1].latch_id == named
        assert {p.ack_id for p in presses} == {1, 2}
