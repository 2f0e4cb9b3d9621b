"""Debounce, rate limit and retry, on a clock that the tests turn."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.operation.alerting.alert import ZoneAlert, payload
from hri_predict.operation.alerting.hook import Outbox
from hri_predict.operation.alerting.webhook import WebhookHook
from tests.hri_predict.operation.alerting.servers import alert


def outbox(**settings):
    whole = {"kind": "webhook", "url": "http://localhost/", "debounce_s": 0} | settings
    return Outbox(WebhookHook(**whole))


def test_of_one_robot_the_newest_waits_and_the_rest_is_told():
    box = outbox()
    for level in ("clear", "slow", "stop"):
        box.put(alert(level))
    box.put(alert("slow", "gantry"))
    first = box.next(0.0)
    assert (first.alert.robot, first.alert.level, first.more_changes) == ("arm", "stop", 2)
    box.arrived(first)
    second = box.next(0.0)
    assert (second.alert.robot, second.more_changes) == ("gantry", 0)
    assert box.next(0.0) is None
    assert (box.delivered, box.left_out, box.dropped) == (1, 2, 0)


def test_what_was_held_back_before_is_told_too():
    box = outbox()
    box.put(alert("stop", held_back=57))
    box.put(alert("unknown", held_back=2))
    entry = box.next(0.0)
    assert (entry.alert.level, entry.more_changes, box.left_out) == ("unknown", 60, 60)
    assert "held_back" not in payload(entry.alert, "cell7", entry.more_changes)


def test_only_what_may_go_out_sooner_wakes_the_thread():
    box = outbox(levels=["stop", "fault"])
    assert [box.put(alert(level)) for level in ("clear", "stop", "fault")] == [False, True, False]


def test_debounce_holds_one_robot_back_and_no_other():
    box = outbox(debounce_s=2.0)
    box.put(alert("slow"))
    box.arrived(box.next(10.0))
    box.put(alert("stop"))
    box.put(alert("stop", "gantry"))
    assert box.next(11.0).alert.robot == "gantry"
    assert box.next(11.9) is None
    assert box.wait_s(11.9) == pytest.approx(0.1)
    assert box.next(12.0).alert.level == "stop"


def test_the_rate_holds_within_any_minute_and_the_newest_goes_out_after_it():
    box = outbox(rate_per_minute=3)
    sent = []
    for second in range(0, 180):
        box.put(alert("stop" if second % 2 else "clear"))
        while (entry := box.next(float(second))) is not None:
            box.arrived(entry)
            sent.append((second, entry.more_changes))
    times = [second for second, _ in sent]
    assert times == [0, 1, 2, 60, 61, 62, 120, 121, 122]
    assert sent[3] == (60, 57)  # those of seconds 3 to 59
    assert box.delivered + box.left_out + 1 == 180  # one still waits


def test_a_failed_alert_is_tried_again_more_and_more_seldom():
    box = outbox(retry_s=20)
    box.put(alert())
    tries = []
    now = 0.0
    while (wait := box.wait_s(now)) is not None:
        now += wait
        entry = box.next(now)
        tries.append(now)
        box.failed(entry, now, again=True)
    assert tries == [0.0, 1.0, 3.0, 7.0, 15.0]  # 31 would be later than 20
    assert (box.failures, box.retried, box.dropped, box.delivered) == (5, 4, 1, 0)
    box.put(alert("clear"))
    assert box.next(now + 30.0).more_changes == 1


def test_what_was_refused_for_good_is_dropped_and_holds_up_no_other():
    box = outbox()
    box.put(alert())
    box.failed(box.next(0.0), 0.0, again=False)
    box.put(alert("clear"))
    assert box.next(0.0) is not None
    assert box.dropped == 1


def test_a_newer_alert_takes_the_place_of_one_that_failed():
    box = outbox()
    box.put(alert("stop"))
    entry = box.next(0.0)
    box.put(alert("clear"))
    box.failed(entry, 0.1, again=True)
    box.put(alert("slow"))
    again = box.next(5.0)
    assert (again.alert.level, again.more_changes) == ("slow", 2)
    assert box.next(5.0) is None


def test_what_is_told_is_told_again_after_a_failure():
    box = outbox()
    box.put(alert("slow"))
    box.put(alert("stop"))
    entry = box.next(0.0)
    box.failed(entry, 0.0, again=True)
    entry = box.next(1.0)
    assert entry.more_changes == 1
    box.arrived(entry)
    box.put(alert("clear"))
    assert box.next(1.0).more_changes == 0


def test_in_a_hurry_nothing_waits():
    box = outbox(debounce_s=60, rate_per_minute=1)
    box.put(alert("slow"))
    box.failed(box.next(0.0), 0.0, again=True)
    box.put(alert("stop"))
    box.put(alert("stop", "gantry"))
    assert [box.next(0.1, hurry=True).alert.robot for _ in range(2)] == ["arm", "gantry"]


def test_only_chosen_levels_robots_and_zones_come():
    box = outbox(levels=["stop", "fault"], robots=["arm"], zones=[])
    box.put(alert("slow"))
    box.put(alert("stop", "gantry"))
    box.put(
        ZoneAlert(at=None, time_s=0.0, zone="hatch", state="occupied", was="empty", entry_s=None)
    )
    assert box.next(0.0) is None
    box.put(alert("stop"))
    assert box.next(0.0) is not None
    assert box.left_out == 0  # what is not meant for this hook is not left out


EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("put"), st.sampled_from("abc"), st.sampled_from(["clear", "stop"])),
        st.tuples(st.sampled_from(["arrive", "fail", "refuse"])),
        st.tuples(st.just("pass"), st.floats(0.0, 40.0)),
    ),
    max_size=60,
)


@given(EVENTS, st.floats(0, 5), st.integers(1, 5), st.floats(0, 60))
def test_every_alert_is_delivered_left_out_dropped_or_waits(events, debounce_s, rate, retry_s):
    box = outbox(debounce_s=debounce_s, rate_per_minute=rate, retry_s=retry_s)
    put, now, newest, out = 0, 0.0, {}, {}
    for event in events:
        if event[0] == "put":
            put += 1
            box.put(alert(event[2], event[1], time_s=float(put)))
            newest[event[1]] = float(put)
        elif event[0] == "pass":
            now += event[1]
        elif (entry := box.next(now)) is not None:
            assert entry.alert.time_s == newest[entry.alert.robot]  # nobody hears what is old
            if event[0] == "arrive":
                box.arrived(entry)
                out[entry.alert.robot] = entry.alert.time_s
            else:
                box.failed(entry, now, again=event[0] == "fail")
    waiting = 0
    while box.next(now, hurry=True) is not None:
        waiting += 1
    assert waiting <= 3
    assert put == box.delivered + box.left_out + box.dropped + waiting


@pytest.mark.parametrize(("asked", "waits"), [(20.0, 20.0), (0.2, 1.0), (1e6, 300.0), (None, 1.0)])
def test_the_pause_that_a_receiver_asks_for_is_kept_within_bounds(asked, waits):
    box = outbox(retry_s=600)
    box.put(alert())
    box.failed(box.next(0.0), 0.0, again=True, again_s=asked)
    assert box.wait_s(0.0) == pytest.approx(waits)
