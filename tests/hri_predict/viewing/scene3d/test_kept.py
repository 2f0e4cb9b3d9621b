"""What the live view keeps, holds and goes back to, without a browser."""

import io
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest

from hri_predict.viewing.picture import Picture, empty_shapes, pack

pytest.importorskip("viser", reason="the extra viewer is not installed")

from hri_predict.viewing.scene3d.live import KEPT_S, STRIP_PARTS, Kept, LiveView, _take
from tests.hri_predict.viewing.scene3d.test_stage import ROOM


def told(level: str) -> Picture:
    robot: dict[str, Any] = {"name": "arm", "level": level, "reason": f"because of {level}"}
    robot |= {"clears": "", "detail": "", "limit_m_s": 0.0, "separation_m": None, "pair": ""}
    robot |= {"speed_m_s": None, "line": None, "apart": "?", "capsules": 0}
    facts: dict[str, Any] = {"robots": [robot], "people": [], "tracked": 0, "state": "RUNNING"}
    facts |= {"coverage": "", "reasons": [], "zones": [], "times_s": [0.0, 1.2], "named": {}}
    facts |= {"age_s": 0.02, "places": [], "sees": True, "room": ROOM}
    return Picture(facts, **empty_shapes())


@pytest.fixture
def kept():
    """Ten seconds of CLEAR, then ten of STOP, at 10 Hz from 100.0 on."""
    made = Kept()
    for tenth in range(200):
        made.add(told("CLEAR" if tenth < 100 else "STOP"), 100.0 + tenth / 10)
    return made


@pytest.fixture
def view(kept):
    made = LiveView("127.0.0.1", 0, kept)
    yield made
    made.server.stop()


def test_the_timeline_has_the_levels_of_the_last_minute_without_gaps(kept):
    levels = kept.levels(119.95)
    known = [level for level in levels if level]
    assert len(levels) == STRIP_PARTS
    assert known == levels[-len(known) :]
    per_s = STRIP_PARTS / KEPT_S
    assert known.count("STOP") == pytest.approx(10 * per_s, abs=1)
    assert known.count("CLEAR") == pytest.approx(10 * per_s, abs=1)


def test_a_silent_node_leaves_a_gap_in_the_timeline(kept):
    kept.add(told("SLOW"), 130.0)
    levels = kept.levels(130.0)
    assert levels[-1] == "SLOW"
    assert levels[-20] == ""  # 5 s before: the last picture was of 119.9 s


def test_the_slider_goes_back_in_time(view):
    view.draw(119.9)
    assert "because of STOP" in view._head.content
    view._back.value = -15.0
    view.draw(119.9)
    assert "because of CLEAR" in view._head.content
    assert "NOT LIVE" in view._head.content
    view._back.value = 0.0
    view.draw(119.9)
    assert "NOT LIVE" not in view._head.content


def test_a_paused_view_holds_its_picture_for_longer_than_pictures_are_kept(view, kept):
    view.draw(119.9)
    view._pause.value = True
    view.draw(119.9)
    for second in range(120, 200):
        kept.add(told("WARN"), float(second))
        view.draw(float(second))
    assert "because of STOP" in view._head.content
    assert "80.1 s ago" in view._head.content or "79.1 s ago" in view._head.content
    view._back.value = -15.0
    view.draw(199.0)
    assert "because of CLEAR" in view._head.content  # what came before the pause
    view._pause.value, view._back.value = False, 0.0
    view.draw(199.0)
    assert "because of WARN" in view._head.content


def test_a_picture_that_waited_in_the_pipe_is_as_old_as_it_is(monkeypatch):
    """The view's process was stopped, and goes on after the node has died."""
    old, new = told("CLEAR"), told("STOP")
    old.facts["made_s"], new.facts["made_s"] = time.monotonic() - 60.0, time.monotonic()
    pipe = SimpleNamespace(buffer=io.BytesIO(pack(old)))
    monkeypatch.setattr(sys, "stdin", pipe)
    kept = Kept()
    _take(kept)
    found = kept.newest()
    assert found is not None
    assert time.monotonic() - found[0] > 59.0


def test_what_is_live_comes_again_each_half_second(view, kept):
    kept.add(told("CLEAR"), 120.0)
    heads = []
    for tenth in range(9):
        view.draw(120.01 + tenth / 10)
        heads.append(view._head.content)
    assert len(set(heads)) in (2, 3)
