"""The alerts of many cells: each change once, none lost, none invented."""

from dataclasses import replace

import pytest

from hri_predict.operation.monitoring.fleet_changes import KEPT
from hri_predict.protocol.messages import Level, Message
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.monitoring.said import CLEAR, OURS, RUNNING
from tests.hri_predict.viewing.many import Cells


def seen(cells: Cells) -> list[tuple[str, int | None, str]]:
    return [(c["cell"], c["robot"], c["level"]) for c in cells.changes.after(0)]


def test_a_cell_that_joins_clear_is_no_alert() -> None:
    cells = Cells()
    for message in (CLEAR, RUNNING):  # the schema comes within a second
        cells.say("press", message)
        cells.changes.look()
    cells.pass_s(0.4)
    cells.say("press", OURS, RUNNING, CLEAR)
    cells.changes.look()
    assert seen(cells) == []


@pytest.mark.parametrize(("says", "level"), [((RUNNING, CLEAR), "UNKNOWN"), ((CLEAR,), "GONE")])
def test_a_cell_that_never_sends_its_schema_is_an_alert(
    says: tuple[Message, ...], level: str
) -> None:
    cells = Cells()
    for _ in range(6):
        cells.say("press", *says)
        cells.changes.look()
        cells.pass_s(0.41)
    assert seen(cells) == [("plant/press", None, level)]


def test_a_cell_that_joins_stopped_is_an_alert_at_once() -> None:
    cells = Cells()
    cells.advise("press", Level.STOP, Reason.PERSON_NEAR)
    cells.changes.look()
    assert seen(cells) == [("plant/press", None, "STOP")]


def test_each_change_comes_once_and_names_its_cell() -> None:
    cells = Cells()
    for level in (Level.CLEAR, Level.SLOW, Level.SLOW, Level.STOP, Level.CLEAR):
        cells.advise("press", level)
        cells.advise("weld", Level.CLEAR)
        cells.changes.look()
        cells.changes.look()
        cells.pass_s(0.1)
    assert seen(cells) == [("plant/press", None, level) for level in ("SLOW", "STOP", "CLEAR")]
    assert [c["number"] for c in cells.changes.after(1)] == [2, 3]
    assert cells.changes.newest == 3


def test_a_stop_between_two_looks_at_all_is_seen() -> None:
    cells = Cells()
    for level in (Level.CLEAR, Level.STOP, Level.CLEAR):
        assert cells.say("press", OURS, RUNNING, replace(CLEAR, level=level))
        cells.changes.look_at("plant", "press")
    assert [level for _, _, level in seen(cells)] == ["STOP", "CLEAR"]
    assert not cells.say("press", OURS, RUNNING, CLEAR)  # nothing new


def test_silence_is_one_alert_of_the_cell_and_its_end_another() -> None:
    cells = Cells()
    cells.advise("press", Level.CLEAR)
    cells.changes.look()
    cells.pass_s(0.6)
    cells.changes.look()
    cells.advise("press", Level.CLEAR)
    cells.changes.look()
    assert [level for _, _, level in seen(cells)] == ["GONE", "CLEAR"]


def test_of_several_robots_the_alert_says_which() -> None:
    cells = Cells()
    cells.say("press", OURS, RUNNING, CLEAR, replace(CLEAR, robot=1, level=Level.STOP))
    cells.changes.look()
    assert seen(cells) == [("plant/press", 1, "STOP")]


def test_what_waits_for_a_page_is_bounded() -> None:
    cells = Cells()
    for i in range(KEPT + 100):
        cells.advise("press", Level.STOP if i % 2 else Level.CLEAR)
        cells.changes.look()
    kept = cells.changes.after(0)
    assert len(kept) == KEPT
    assert kept[-1]["number"] == cells.changes.newest == KEPT + 99
