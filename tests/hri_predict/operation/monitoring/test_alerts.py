import errno
import io
import json
import sys

import pytest

from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.operation.monitoring.alerts import Alerts, AlertSettings
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import NamedZoneState
from tests.hri_predict.operation.monitoring.said import alerts_of
from tests.processes import python


def advice(level, robot=0, reason=Reason.PERSON_NEAR):
    return Advice(robot=robot, level=level, reason=reason, separation_m=0.7, speed_limit_m_s=0.2)


def test_only_changes_are_told(tmp_path):
    out, clock = io.StringIO(), VirtualClock(0)
    alerts = alerts_of(tmp_path, robots=["arm", "gantry"], clock=clock, out=out, file="a.jsonl")
    for level in (Level.CLEAR, Level.CLEAR, Level.SLOW, Level.SLOW, Level.STOP):
        alerts.observe((advice(level), advice(Level.CLEAR, robot=1)))
        clock.advance_to(clock.now_ns() + 40_000_000)
    alerts.stop()
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [(a["robot"], a["was"], a["level"]) for a in lines] == [
        ("arm", "none", "clear"),
        ("gantry", "none", "clear"),
        ("arm", "clear", "slow"),
        ("arm", "slow", "stop"),
    ]
    assert lines[2]["time_s"] == 0.08
    assert lines[2]["at"] is None  # the virtual clock knows no date
    assert lines[2]["clears_when"] == Reason.PERSON_NEAR.clears_when
    assert "slow -> stop: arm: a person is too close; clears when" in out.getvalue()


def on_terminal(folder):
    """Alerts of one robot on a terminal, and what the terminal shows."""
    out = io.StringIO()
    alerts = alerts_of(folder, out=out)
    return out, alerts


def test_where_nothing_is_near_nothing_has_to_clear(tmp_path):
    out, alerts = on_terminal(tmp_path)
    alerts.observe((Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE),))
    alerts.stop()
    assert out.getvalue() == "[    0.00 s] none -> clear: arm: nothing is near\n"


@pytest.mark.parametrize("reason", [Reason.STATE_UNTRUSTED, Reason.ACKNOWLEDGE_REPEATED])
def test_a_condition_that_changes_no_level_is_news_once_and_so_is_its_end(tmp_path, reason):
    out, alerts = on_terminal(tmp_path)
    stop = (advice(Level.STOP, reason=Reason.PERSON_LOST),)
    for reasons in ((), (Reason.LOAD_SHED,), (reason,), (reason, Reason.LOAD_SHED), (), ()):
        alerts.observe(stop, reasons)
    alerts.stop()
    begun, held, ended = out.getvalue().splitlines()
    assert reason.text in held
    assert reason.clears_when in held
    assert reason.text not in begun + ended


def test_another_reason_for_unknown_is_news_another_for_stop_is_not(tmp_path):
    out, alerts = on_terminal(tmp_path)
    for level, reason in [
        (Level.UNKNOWN, Reason.STARTING),
        (Level.UNKNOWN, Reason.ROBOT_STATE_STALE),
        (Level.UNKNOWN, Reason.ROBOT_STATE_STALE),
        (Level.STOP, Reason.PERSON_NEAR),
        (Level.STOP, Reason.PERSON_APPROACHING),
    ]:
        alerts.observe((advice(level, reason=reason),))
    lines = out.getvalue().splitlines()
    assert len(lines) == 3
    assert Reason.ROBOT_STATE_STALE.text in lines[1]


def test_changes_of_named_zones_are_told(tmp_path):
    out = io.StringIO()
    alerts = alerts_of(tmp_path, out=out, file="a.jsonl")
    for occupied, entry_s in [
        (False, None),
        (False, 0.4),
        (False, 0.3),
        (True, 0.0),
        (False, None),
    ]:
        alerts.observe_zones([NamedZoneState("hatch", occupied, entry_s)])
    alerts.stop()
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [(a["zone"], a["state"]) for a in lines] == [
        ("hatch", "entry predicted"),
        ("hatch", "occupied"),
        ("hatch", "empty"),
    ]
    assert "zone hatch: empty -> entry predicted in 400 ms" in out.getvalue()


def test_in_a_tick_without_states_each_zone_is_occupied(tmp_path):
    alerts = alerts_of(tmp_path, zones=["hatch", "bench"], out=io.StringIO(), file="a.jsonl")
    known = [NamedZoneState("hatch", False, 0.4), NamedZoneState("bench", False, None)]
    for states in (known, None, None, known):
        alerts.observe_zones(states)
    alerts.stop()
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [(a["zone"], a["state"]) for a in lines] == [
        ("hatch", "entry predicted"),
        ("hatch", "occupied"),
        ("bench", "occupied"),
        ("hatch", "entry predicted"),
        ("bench", "empty"),
    ]


def test_command_gets_the_alert_and_is_debounced(tmp_path):
    target = tmp_path / "got"
    append = ["sh", "-c", f"cat >> {target}; echo >> {target}"]  # done long before the end gives up
    settings = AlertSettings(terminal=False, command=append, debounce_s=60, timeout_s=60)
    alerts = Alerts(settings=settings, robots=["arm"], clock=MonotonicClock(), base_dir=tmp_path)
    alerts.start()
    for level in (Level.CLEAR, Level.SLOW, Level.CLEAR, Level.STOP):
        alerts.observe((advice(level),))
    alerts.stop()
    got = [json.loads(line)["level"] for line in target.read_text().splitlines()]
    assert got[-1] == "stop"  # the newest is never lost by the debounce
    assert len(got) <= 2


def test_no_robots_change_is_lost_to_anothers(tmp_path):
    target = tmp_path / "got"
    append = ["sh", "-c", f"cat >> {target}; echo >> {target}"]  # done long before the end gives up
    settings = AlertSettings(terminal=False, command=append, debounce_s=60, timeout_s=60)
    alerts = Alerts(
        settings=settings, robots=["arm", "gantry"], clock=MonotonicClock(), base_dir=tmp_path
    )
    alerts.start()
    alerts.observe((advice(Level.CLEAR), advice(Level.CLEAR, robot=1)))
    alerts.observe((advice(Level.STOP), advice(Level.SLOW, robot=1)))
    alerts.stop()
    got = [json.loads(line) for line in target.read_text().splitlines()]
    last = {a["robot"]: a["level"] for a in got}
    assert last == {"arm": "stop", "gantry": "slow"}
    assert all(a["at"].endswith("+00:00") for a in got)


@pytest.mark.parametrize(
    "command",
    [["/no/such/program"], [sys.executable, "-c", "raise SystemExit(3)"]],
)
def test_failing_command_is_counted(tmp_path, command):
    settings = AlertSettings(terminal=False, command=command, timeout_s=20)
    alerts = Alerts(settings=settings, robots=["arm"], clock=MonotonicClock(), base_dir=tmp_path)
    alerts.start()
    alerts.observe((advice(Level.STOP),))
    alerts.stop()
    assert alerts.failures == 1


def test_hanging_command_is_ended(tmp_path, caplog):
    hang = [sys.executable, "-c", "import time; time.sleep(60)"]
    settings = AlertSettings(terminal=False, command=hang, timeout_s=0.2)
    alerts = Alerts(settings=settings, robots=["arm"], clock=MonotonicClock(), base_dir=tmp_path)
    alerts.start()
    alerts.observe((advice(Level.STOP),))
    alerts.stop()
    assert alerts.failures == 1
    assert "was killed" in caplog.text


def test_a_flood_never_blocks_and_is_counted(tmp_path):
    alerts = alerts_of(tmp_path, threaded=True, terminal=False)
    for i in range(1000):
        alerts.observe((advice(Level.CLEAR if i % 2 else Level.STOP),))
    assert alerts.count == 1000
    assert alerts.dropped == 1000 - 256


class Refuses(io.StringIO):
    """Standard error on a disk that is full."""

    def write(self, text):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_terminal_that_takes_nothing_does_not_cost_the_alert_file(tmp_path):
    alerts = alerts_of(
        tmp_path, clock=MonotonicClock(), out=Refuses(), threaded=True, file="a.jsonl"
    )
    alerts.start()
    for level in (Level.CLEAR, Level.STOP):
        alerts.observe((advice(level),))
    alerts.stop()
    assert len((tmp_path / "a.jsonl").read_text().splitlines()) == 2
    assert alerts.failures == 2


def test_after_a_line_that_was_cut_short_the_next_stands_on_its_own(tmp_path):
    (tmp_path / "a.jsonl").write_text('{"level": "st')
    alerts = alerts_of(tmp_path, file="a.jsonl", terminal=False)
    alerts.observe((advice(Level.STOP),))
    cut, whole = (tmp_path / "a.jsonl").read_text().splitlines()
    assert cut == '{"level": "st'
    assert json.loads(whole)["level"] == "stop"


def test_a_line_that_no_longer_fits_on_the_disk_leaves_no_part(tmp_path):
    """A limit of the file's size is a full disk that a test can have."""
    code = (
        "import resource, signal; from pathlib import Path; from hri_predict.operation.monitoring "
        "import alerts; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit("
        "resource.RLIMIT_FSIZE, (100, 100)); path = Path('a.jsonl'); line = b'x' * 39 + b'\\n'\n"
        "for _ in range(2): alerts._append(path, line)\n"
        "try: alerts._append(path, line)\n"
        "except OSError as error: print(error.strerror)\n"
    )
    run = python("-c", code, cwd=tmp_path, check=True)
    assert run.stdout == "No space left on device\n"
    assert (tmp_path / "a.jsonl").read_bytes() == 2 * (b"x" * 39 + b"\n")
