"""What alternates is counted; nothing more severe than the last report ever waits."""

import io
import json

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.operation.alerting.alert import Alert, ZoneAlert
from hri_predict.operation.monitoring.flapping import AGAIN_S, FIRST_S, HOLDS_S, REPEATS, Flapping
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.monitoring.said import alerts_of

TICK_S = 0.04
SEVERITY = ["clear", "warn", "slow", "stop", "unknown", "fault"]


def change(time_s, level, reason="because", robot="arm"):
    return Alert(
        at=None, time_s=time_s, robot=robot, level=level, was="", reason=reason, detail="",
        clears_when="", separation_m=None, speed_limit_m_s=None,
    )  # fmt: skip


def reported(levels, until_s):
    """What is reported of (seconds, level) by a node that ticks until then."""
    flapping, waiting, found = Flapping(), list(levels), []
    for tick in range(int(until_s / TICK_S) + 1):
        now_s = tick * TICK_S
        found += [(now_s, each) for each in flapping.due(now_s)]
        while waiting and waiting[0][0] <= now_s:
            _, level, *why = waiting.pop(0)
            if (told := flapping.take(change(now_s, level, *why))) is not None:
                found.append((now_s, told))
    return found


def alternating(one, other, seconds, each_s=0.12):
    return [(k * each_s, other if k % 2 else one) for k in range(int(seconds / each_s))]


@pytest.mark.parametrize(
    ("one", "other"), [("stop", "unknown"), ("clear", "stop"), ("clear", "warn"), ("slow", "stop")]
)
def test_a_level_that_alternates_is_a_few_lines_that_count_the_others(one, other):
    changes = alternating(one, other, 120)
    found = reported(changes, 119)
    assert len(found) <= 2 * REPEATS + 8  # two lines after ten seconds, and two a minute
    assert sum(1 + told.held_back for _, told in found) >= len(changes) - AGAIN_S / 0.12
    first = [told.level for _, told in found[: 2 * REPEATS]]
    assert first == [level for _, level in changes[: 2 * REPEATS]]  # at once, each of them


def test_a_state_that_holds_is_reported():
    changes = [
        *alternating("stop", "unknown", 12),
        (12.0, "clear"),
        (12.2, "stop"),
        (12.4, "clear"),
    ]
    now_s, last = reported(changes, 30)[-1]
    assert last.level == "clear"
    assert now_s <= 12.4 + HOLDS_S + 2 * TICK_S


@pytest.mark.parametrize("period_s", [0.04, 0.2, 0.7, 3.0])
def test_what_was_reported_is_never_less_severe_than_what_holds(period_s):
    flapping, shown, level = Flapping(), "fault", "fault"
    order = ["clear", "stop", "warn", "clear", "unknown", "slow", "fault", "stop", "clear"]
    for tick in range(5000):
        now_s = tick * TICK_S
        for told in flapping.due(now_s):
            assert isinstance(told, Alert)
            shown = told.level
        new = order[int(now_s / period_s) % len(order)]
        if new != level:
            level = new
            taken = flapping.take(change(now_s, level))
            if taken is not None:
                assert isinstance(taken, Alert)
                shown = taken.level
        assert SEVERITY.index(shown) >= SEVERITY.index(level)


def test_another_reason_is_reported_at_once():
    changes = [*alternating("stop", "unknown", 9), (9.0, "stop"), (9.04, "unknown", "another")]
    assert (round(reported(changes, 9.1)[-1][0], 2), reported(changes, 9.1)[-1][1].reason) == (
        9.04,
        "another",
    )


def test_a_person_who_comes_and_goes_is_reported_step_by_step():
    way = ["clear", "warn", "slow", "stop", "slow", "warn", "clear"]
    changes = [(20.0 * visit + 0.4 * k, level) for visit in range(5) for k, level in enumerate(way)]
    changes = [c for i, c in enumerate(changes) if i == 0 or changes[i - 1][1] != c[1]]
    assert len(reported(changes, 110)) == len(changes)


def test_robots_and_zones_are_counted_by_themselves():
    flapping = Flapping()
    for k in range(20):
        flapping.take(change(k * 0.1, ("stop", "unknown")[k % 2]))
    assert flapping.take(change(2.0, "clear", robot="gantry")) is not None

    def zone(time_s: float, state: str) -> ZoneAlert:
        return ZoneAlert(at=None, zone="hatch", was="", entry_s=None, time_s=time_s, state=state)

    told = [flapping.take(zone(k * 0.1, ("empty", "occupied")[k % 2])) for k in range(40)]
    assert sum(each is not None for each in told) == 2 * REPEATS


def test_the_terminal_counts_and_the_file_has_all(tmp_path):
    out, clock = io.StringIO(), VirtualClock(0)
    alerts = alerts_of(tmp_path, clock=clock, out=out, file="a.jsonl")
    for k in range(400):
        level = (Level.STOP, Level.UNKNOWN)[k // 3 % 2]
        alerts.observe((Advice(robot=0, level=level, reason=Reason.INPUT_STALE),))
        clock.advance_to(clock.now_ns() + 40_000_000)
    alerts.stop()
    lines = (tmp_path / "a.jsonl").read_text().splitlines()
    assert len(lines) == alerts.count == 134
    assert all("held_back" not in json.loads(line) for line in lines)
    shown = out.getvalue().splitlines()
    assert len(shown) <= 2 * REPEATS + 4
    counted = [int(line.split(";")[-1].split()[0]) for line in shown if "more change" in line]
    assert sum(counted) + len(shown) == 134  # none is lost
    assert FIRST_S < 16.0  # what this run lasts
