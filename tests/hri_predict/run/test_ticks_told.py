"""What ``check`` says of ticks."""

from dataclasses import replace

import pytest

from hri_predict.base.errors import LinkError
from hri_predict.cli.check.check import examine
from hri_predict.run.config import NodeSettings
from hri_predict.run.ticks_told import race_notes, ticks_facts, ticks_line
from hri_sim.baseline_demo import baseline_demo

ROBOT = {"name": "a", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}


def settings(**keys):
    return NodeSettings.model_validate({"source": {}, "robots": [ROBOT], **keys})


@pytest.mark.parametrize(
    ("keys", "source_hz", "mean_ms", "most_ms"),
    [
        ({}, 25, 20, 40),
        ({}, 10, 20, 40),  # as long as until the next tick, however rare captures are
        ({}, 100, 5, 10),  # the newest of four is that old
        ({"ticks": "capture"}, 25, 0, 10),
        ({"ticks": "capture", "max_rate_hz": 50}, 25, 0, 20),
        ({"ticks": "capture", "max_rate_hz": 50}, 240, 2.08, 20),
    ],
)
def test_how_long_a_capture_waits(keys, source_hz, mean_ms, most_ms):
    wait = ticks_facts(settings(**keys), source_hz)["wait_s"]
    assert wait["mean"] * 1e3 == pytest.approx(mean_ms, abs=0.01)
    assert wait["most"] * 1e3 == pytest.approx(most_ms, abs=0.01)


def test_the_line_says_the_rates():
    assert ticks_line(ticks_facts(settings(), 30)) == (
        "ticks: fixed, 25 per second; a capture of the source's 30 per second waits 17 ms on "
        "average and 33 ms at most"
    )
    line = ticks_line(ticks_facts(settings(ticks="capture"), 30))
    assert "capture, 25 to 100 per second" in line


@pytest.mark.parametrize(
    ("ticks", "rate_hz", "told"),
    [("capture", 25, True), ("capture", 28, True), ("capture", 20, False), ("capture", 50, True),
     ("fixed", 25, False)],
)  # fmt: skip
def test_a_floor_that_races_with_captures_is_told(ticks, rate_hz, told):
    notes = race_notes(settings(ticks=ticks, rate_hz=rate_hz), 26.0)
    assert bool(notes) is told
    remedy = "23.4 is enough" if rate_hz > 26 / 0.9 else "rate_hz up to 23.4 avoids it"
    assert all(remedy in note for note in notes)


def with_capture(**node):
    demo = baseline_demo()
    update = {"ticks": "capture"} | node
    return replace(demo, node=demo.node.model_copy(update=update))


def test_links_are_loaded_with_the_largest_rate_and_delays_with_the_least():
    fixed, capture = examine(baseline_demo()), examine(with_capture(max_rate_hz=75.0))
    assert capture["delay_budget_s"] == fixed["delay_budget_s"]
    for slow, fast in zip(fixed["links"], capture["links"], strict=True):
        # each 15 ms: thrice in a cycle of 40 ms, and twice in each that is a little longer than 15
        assert (slow["rate_hz"], fast["rate_hz"]) == pytest.approx((75.0, 2 / 0.015))
        for message in ("Status", "Advice"):
            ratio = fast["details"][message] / slow["details"][message]
            assert ratio == pytest.approx(2 / 0.015 / 75.0)
        assert fast["details"]["RobotState"] == slow["details"]["RobotState"]


def test_a_largest_rate_that_a_link_cannot_carry_is_refused_with_one_that_it_can():
    demo = with_capture()
    update = {"baudrate": 19200, "robot_state_rate_hz": 10.0, "repeat_hz": 0.0}
    slow = demo.links[0].model_copy(update=update)
    with pytest.raises(LinkError, match=r"lower max_rate_hz from 100 to (\d+)") as caught:
        examine(replace(demo, links=(slow,)))
    fits = float(str(caught.value).split("max_rate_hz from 100 to ")[1].split()[0])
    fitting = demo.node.model_copy(update={"rate_hz": 10.0, "max_rate_hz": fits})
    assert examine(replace(demo, links=(slow,), node=fitting))["links"][0]["spare"] >= 0


@pytest.mark.parametrize(
    ("ticks", "baudrate"), [("fixed", 57600), ("fixed", 38400), ("capture", 57600)]
)
def test_repetitions_that_a_link_cannot_carry_are_refused_with_a_rate_that_it_can(ticks, baudrate):
    demo = with_capture(ticks=ticks, max_rate_hz=50.0 if ticks == "capture" else None)
    link = demo.links[0].model_copy(update={"baudrate": baudrate, "robot_state_rate_hz": 30.0})
    with pytest.raises(LinkError, match=r"lower repeat_hz from 66.7 to (\d+)") as caught:
        examine(replace(demo, links=(link,)))
    fits = float(str(caught.value).split("repeat_hz from 66.7 to ")[1].split()[0])
    fitting = link.model_copy(update={"repeat_hz": fits})
    found = examine(replace(demo, links=(fitting,)))
    assert found["links"][0]["spare"] >= 0
    # a longer time between messages leaves less room for lost ones, and check says so
    assert any("silence_timeout_s 60 ms is short" in note for note in found["notes"])
