"""What ``check`` says about people who vanish."""

from dataclasses import replace

import pytest

from hri_predict.cli.check.check import examine
from hri_predict.node.memory import StateSettings
from hri_sim.baseline_demo import baseline_demo

FLOOR = {"polygon": [[-6, -6], [6, -6], [6, 6], [-6, 6]]}


def about(word, **source):
    """The notes with this word on the demo without its exit, with another source."""
    config = baseline_demo()
    people = config.node.people.model_copy(update={"exits": []})
    config = replace(config, node=config.node.model_copy(update={"people": people}))
    notes = examine(config.with_source(config.source.model_dump() | source))["notes"]
    return [note for note in notes if word in note]


@pytest.mark.parametrize(
    ("keeps_ids", "end"),
    [(False, "until an Acknowledge ends"), (True, "until an Acknowledge or the same id ends")],
)
def test_it_says_what_ends_being_lost(keeps_ids, end):
    (note,) = about("stays lost", keeps_ids=keeps_ids)
    assert end in note
    assert note.startswith("a person who vanishes for longer than")


def test_free_space_without_viewpoints_is_worth_little():
    free = {"sees_free_space": True, "field_of_view": FLOOR}
    assert about("without viewpoints", **free)
    assert not about("without viewpoints", viewpoints=[[-6, -6, 2.8]], **free)
    assert not about("stays lost", **free)


@pytest.mark.parametrize(("x", "is_near"), [(1.5, True), (5.4, False)])
def test_a_shadow_near_a_robot_keeps_it_waiting(x, is_near):
    corners = [[x, -0.3], [x + 0.5, -0.3], [x + 0.5, 0.3], [x, 0.3]]
    free = {"sees_free_space": True, "field_of_view": FLOOR}
    found = about("source.shadows.0", shadows=[{"polygon": corners}], **free)
    assert len(found) == is_near


def test_three_ends_are_listed_as_one_says_them():
    config = baseline_demo()  # with an exit
    source = config.source.model_dump() | {"keeps_ids": True}
    notes = examine(config.with_source(source))["notes"]
    assert any("until an Acknowledge, an exit or the same id ends it" in note for note in notes)


def test_a_first_start_with_a_state_file_waits_for_one_acknowledge(tmp_path):
    config = baseline_demo()
    path = tmp_path / "state.json"
    node = config.node.model_copy(update={"state": StateSettings(path=str(path))})
    config = replace(config, node=node)

    def said():
        return [note for note in examine(config)["notes"] if note.startswith("state:")]

    (note,) = said()
    assert str(path) in note
    assert "one Acknowledge" in note
    path.write_text("{}")
    assert said() == []
