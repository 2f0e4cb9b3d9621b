"""Notes on delays that are not stated, and on time-outs that messages cannot keep."""

from types import SimpleNamespace
from typing import Any

import pytest

from hri_predict.cli.check.notes import delay_notes
from hri_predict.contracts.link import LinkSettings

STATED = {"silence_timeout_s": 0.06, "reaction_s": 0.02}


def notes(rate_hz: float = 25.0, **values: object) -> list[str]:
    link = LinkSettings.model_validate({"name": "plc", "kind": "can"} | values)
    config: Any = SimpleNamespace(links=(link,), node=SimpleNamespace(rate_hz=rate_hz))
    return delay_notes(config)


def test_times_that_are_stated_need_no_note():
    assert notes(**STATED) == []
    assert notes(silence_timeout_s=0.15, reaction_s=0.05) == []


@pytest.mark.parametrize("stated", ["silence_timeout_s", "reaction_s"])
def test_a_time_of_a_controller_that_is_not_stated_is_named_with_its_figure(stated):
    (unset,) = set(STATED) - {stated}
    (note,) = notes(**{stated: STATED[stated]})
    assert f"link plc: {unset} {STATED[unset] * 1e3:g} ms not set" in note
    assert stated not in note


def test_a_simulated_controller_has_the_times_that_the_link_assumes():
    assert notes(simulate={"role": "drive"}) == []


@pytest.mark.parametrize(
    ("values", "effect"),
    [
        ({"repeat_hz": 50}, "two lost in a row stop the robot"),
        ({"repeat_hz": 30}, "each that is lost or late stops the robot"),
        ({"repeat_hz": 0, "silence_timeout_s": 0.05}, "may stop between two"),
    ],
)
def test_a_time_out_that_is_short_for_the_rate_is_named_with_one_that_is_not(values, effect):
    stated = STATED | values
    (note,) = notes(**stated)
    assert effect in note
    enough_s = float(note.split("raise it to ")[1].split()[0])
    assert notes(**(stated | {"silence_timeout_s": enough_s})) == []


def test_the_rate_of_the_cycles_counts_where_it_is_higher():
    assert notes(rate_hz=80.0, repeat_hz=0, **STATED) == []
