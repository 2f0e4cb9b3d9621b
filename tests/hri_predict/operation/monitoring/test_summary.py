"""The summary: its JSON keys are a contract with users' scripts."""

import io
import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from hri_predict.contracts.link import LinkCounters
from hri_predict.node.listeners import Tick
from hri_predict.operation.monitoring.pace import PACE_TICKS, Pace
from hri_predict.operation.monitoring.summary import LevelCounter, summarise
from hri_predict.protocol.messages import Advice, Level, NodeState
from hri_predict.protocol.reasons import Reason
from tests.messages import make_status

KEYS = {
    "frames_in": int,
    "ticks": int,
    "late_ticks": int,
    "tick_ms": dict,
    "links": list,
    "min_separation_m": float,
    "slowdowns": int,
    "stops": int,
    "contacts": int,
    "contacts_standing": int,
}
LINK_KEYS = {"name": str, "messages": int, "bytes": int, "crc_errors": int}


def tick_of(*levels, separations=None, now_ns=0):
    separations = separations or [None] * len(levels)
    advices = tuple(
        Advice(robot=i, level=level, reason=Reason.NONE, separation_m=s)
        for i, (level, s) in enumerate(zip(levels, separations, strict=True))
    )
    status = make_status(cycle=0)
    return Tick(
        now_ns=now_ns,
        status=status,
        advices=advices,
        snapshot=None,
        forecast=None,
        assessment=None,
        messages=(),
    )


def counted(levels_of_ticks, **kwargs):
    counter = LevelCounter()
    for levels in levels_of_ticks:
        counter.on_tick(tick_of(*levels, **kwargs))
    return counter


C, W, S, X, U = Level.CLEAR, Level.WARN, Level.SLOW, Level.STOP, Level.UNKNOWN


@pytest.mark.parametrize(
    ("levels", "slowdowns", "stops"),
    [
        ([C, C, C], 0, 0),
        ([C, S, S, C, S], 2, 0),
        ([C, S, X, X, S, C], 1, 1),  # from stop to slow is a release, no slowdown
        ([C, X, C, X], 0, 2),
        ([U, S, C], 0, 0),  # likewise from unknown: nothing moved before
        ([S, C], 0, 0),
        ([C, U, X], 0, 1),
        ([W, S, W, S], 2, 0),
    ],
)
def test_changes_into_slow_and_stop_are_counted(levels, slowdowns, stops):
    counter = counted([(level,) for level in levels])
    assert (counter.slowdowns, counter.stops) == (slowdowns, stops)
    assert sum(counter.ticks_at.values()) == len(levels)


def test_time_at_a_level_is_seconds_not_ticks():
    """Ticks that come with captures are of any length."""
    counter = LevelCounter()
    for now_s, levels in [(1.0, (C, X)), (1.5, (S, X)), (1.75, (C, X)), (3.75, (C, C))]:
        counter.on_tick(tick_of(*levels, now_ns=int(now_s * 1e9)))
    # times are whole nanoseconds, and their seconds are not
    assert counter.seconds_at == pytest.approx({"clear": 2.5, "slow": 0.25, "stop": 2.75}, rel=1e-9)


def test_why_nothing_was_known_is_counted():
    assert counted([(U,), (U,), (C,)]).unknown_because == {"none": 2}


def test_robots_are_counted_apart():
    counter = counted([(C, X), (S, X), (X, X), (X, C)])
    assert (counter.slowdowns, counter.stops) == (1, 2)


def test_smallest_separation_of_all_robots_and_ticks():
    counter = LevelCounter()
    counter.on_tick(tick_of(C, C, separations=[None, None]))
    assert counter.min_separation_m is None
    counter.on_tick(tick_of(C, C, separations=[2.0, 0.75]))
    counter.on_tick(tick_of(C, C, separations=[1.0, 3.0]))
    assert counter.min_separation_m == 0.75


def summary_of(ticks_ms=(1.0, 2.0, 30.0), checked=None, levels=((C,), (S,), (X,))):
    pace = Pace()
    for ms in ticks_ms:
        pace.note(ms * 1e-3)
    pace.late_ticks = 1
    pace.connected = {"drive": False, "plc": True}
    node: Any = SimpleNamespace(
        frames_in=12,
        assess_failures=0,
        listener_failures=2,
        strange_states=0,
        acknowledges=0,
        acknowledges_refused=0,
        acknowledges_not_counted={},
        robot_counters={},
        shedding=SimpleNamespace(sheds=0, without={}),
        publish_phase=SimpleNamespace(phase_s=0.0096),
        state=NodeState.STOPPING,
        self_check=lambda: checked,
    )
    counters = LinkCounters(
        messages_sent=5, bytes_sent=99, crc_errors=3, messages_received=7, bus_off=2
    )
    links: Any = [
        SimpleNamespace(name="drive", counters=counters, last_error="bus-off: [can0] is gone"),
        SimpleNamespace(name="plc", counters=LinkCounters(messages_sent=5), last_error=None),
    ]
    counter = counted(levels, separations=[0.51234567])
    return summarise(
        node=node, pace=pace, links=links, levels=counter, counters={"stale": 4, "nothing": 0}
    )


def test_json_has_the_contracts_keys_and_types():
    summary = summary_of()
    summary.contacts, summary.contacts_standing = 0, 0
    data = json.loads(json.dumps(summary.as_dict()))
    for key, kind in KEYS.items():
        assert isinstance(data[key], kind), key
    assert {"p50", "p99", "max"} <= set(data["tick_ms"])
    assert data["publish_phase_ms"] == 9.6
    link, _ = data["links"]
    for key, kind in LINK_KEYS.items():
        assert isinstance(link[key], kind), key
    assert (link["messages"], link["bytes"], link["crc_errors"]) == (5, 99, 3)
    assert (data["slowdowns"], data["stops"], data["min_separation_m"]) == (1, 1, 0.5123)


def test_the_self_check_is_told_where_there_is_one():
    assert summary_of().as_dict()["self_check"] is None
    told = {
        "ticks": 200,
        "ticks_widened": 50,
        "ticks_unlike": 2,
        "covered": 0.9876,
        "judged_in_use": 431,
        "drift": {"drifting": True, "raised": 1, "missed": 0.05},
    }
    summary, shown = summary_of(checked=told), io.StringIO()
    assert summary.as_dict()["self_check"] == told
    summary.print(Console(file=shown, width=120))
    text = " ".join(shown.getvalue().split())
    assert "98.8 % of 431; zones widened 25 %, motion out of distribution 1 % of the time" in text


def test_the_publish_phase_does_not_read_as_lateness():
    summary, shown = summary_of(), io.StringIO()
    summary.controllers = [{"name": "drive", "messages": 12}]
    summary.print(Console(file=shown, width=120))
    assert "9.60 ms after a tick is due" in shown.getvalue()
    assert "messages (each frame of a zone or pose is one)" in shown.getvalue()


def test_levels_stand_in_one_order_and_none_is_lost():
    told = summary_of(levels=[(level,) for level in reversed(Level)] + [(U,)]).ticks_at
    assert list(told) == ["clear", "warn", "slow", "stop", "unknown", "fault"]
    assert list(told.values()) == [1, 1, 1, 1, 2, 1]


def test_shadow_mode_is_told():
    summary, shown = summary_of(), io.StringIO()
    summary.print(Console(file=shown, width=120))
    assert "shadow mode" not in shown.getvalue()
    summary.shadow = True
    summary.print(Console(file=shown, width=120))
    assert "shadow mode" in shown.getvalue()
    assert "links sent unknown" in shown.getvalue()


def test_times_of_ticks_are_percentiles():
    times = np.random.default_rng(3).uniform(0, 9, 999)
    told = summary_of(times).tick_ms
    assert told["p50"] == pytest.approx(np.median(times), abs=1e-3)
    assert told["p99"] == pytest.approx(np.percentile(times, 99), abs=1e-3)
    assert told["max"] == pytest.approx(times.max(), abs=1e-3)


def test_a_run_without_ticks_or_truth_has_a_summary_all_the_same():
    data = summary_of(()).as_dict()
    assert data["ticks"] == 0
    assert data["tick_ms"] == {"p50": 0.0, "p99": 0.0, "max": 0.0}
    assert data["contacts"] is None  # nobody saw the truth: that is not "none"
    assert data["contacts_standing"] is None
    json.dumps(data)


def test_only_what_was_counted_is_listed():
    assert summary_of().counted == {"stale": 4, "listener_failures": 2}


def test_long_runs_keep_the_newest_times_in_bounded_room():
    pace = Pace()
    for _ in range(PACE_TICKS):
        pace.note(0.001)
    for _ in range(10):
        pace.note(0.005)
    assert len(pace.tick_ms) == PACE_TICKS
    assert pace.ticks == PACE_TICKS + 10
    assert sum(ms == pytest.approx(5.0) for ms in pace.tick_ms) == 10


def test_the_table_shows_it():
    out = io.StringIO()
    summary = summary_of()
    summary.controllers = [{"name": "drive", "stops": 1, "events": [], "ended": "ok"}]
    summary.predictor = "kalman"
    summary.print(Console(file=out, width=120))
    text = out.getvalue()
    for part in (
        "kalman",
        "frames in",
        "12",
        "3 (1)",
        "0.51 m",
        "1, 1",
        "drive",
        "crc errors",
        "stale 4",
    ):
        assert part in text
    assert "contacts, moving robot" in text


def test_a_machine_that_is_too_slow_is_named_first():
    """The line explains other faults, which the tables name."""
    out = io.StringIO()
    summary = summary_of()
    assert summary.too_slow == ""
    summary.too_slow = "too slow: 11 of 1000 ticks were late"
    summary.print(Console(file=out, width=120))
    assert out.getvalue().startswith("too slow: 11 of 1000 ticks were late\n")


def test_what_went_wrong_on_a_link_stands_under_the_table():
    out = io.StringIO()
    summary = summary_of()
    summary.print(Console(file=out, width=120))
    told = "drive: not connected at the end; bus_off 2; last error"
    assert f"{told}: bus-off: [can0] is gone\n" in out.getvalue()
    assert [link["connected"] for link in summary.as_dict()["links"]] == [False, True]
    assert "plc:" not in out.getvalue()
    assert [link["last_error"] for link in summary.as_dict()["links"]] == [
        "bus-off: [can0] is gone",
        None,
    ]


def test_the_links_fit_an_ordinary_terminal():
    out = io.StringIO()
    summary = summary_of()
    summary.links[0]["bytes"] = 123_456_789
    summary.links[0]["name"] = "drive_of_the_press"
    summary.print(Console(file=out, width=80))
    assert "…" not in out.getvalue()
    words = out.getvalue().replace("┃", " ").replace("│", " ").split()
    assert {"superseded", "reconnects", "received", "123456789", "crc", "errors"} <= set(words)


def test_frames_of_our_own_that_came_back_are_no_trouble():
    out = io.StringIO()
    summary = summary_of()
    summary.links[1]["echoes"] = 352
    summary.print(Console(file=out, width=80))
    assert "352" not in out.getvalue()


def test_each_alert_hook_has_a_line_of_its_own():
    summary = summary_of()
    counts = {"delivered": 0, "left_out": 3, "dropped": 1, "retried": 0, "failures": 2}
    quiet = dict.fromkeys(counts, 0) | {"name": "syslog [log]", "last_error": ""}
    summary.alerts = [counts | {"name": "webhook a", "last_error": "HTTP status 503"}, quiet]
    out = io.StringIO()
    summary.print(Console(file=out, width=80))
    assert (
        "alerts by webhook a: delivered 0, left out 3, dropped 1, failures 2; "
        "last error: HTTP status 503\nalerts by syslog [log]: delivered 0\n"
    ) in out.getvalue()
    assert summary.as_dict()["alerts"] == summary.alerts
