"""``check`` tells how fast a robot may touch whom, and warns of it."""

import numpy as np
import pytest
import yaml

from hri_predict.base.files import data_path
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.check.check import check
from hri_predict.cli.check.robots import (
    contact_facts,
    contact_notes,
    unseen_ends_note,
)
from hri_predict.risk.settings import RiskSettings
from hri_predict.run import config as configuration
from tests.hri_predict.risk.contact.cell import HYBRID, MODEL
from tests.hri_predict.risk.contact.cell import ROBOT as ARM

ROBOTS = [(ARM, MODEL)]


def test_limits_are_those_of_the_rule():
    parts = contact_facts(HYBRID, ROBOTS, None)["arm"]["parts"]
    assert parts["head"]["free_m_s"] == parts["head"]["clamped_m_s"] == 0
    assert parts["hand"]["free_m_s"] > parts["thorax"]["free_m_s"] > parts["foot"]["free_m_s"] > 0
    assert all(p["clamped_m_s"] <= p["free_m_s"] for p in parts.values())


def test_contact_that_is_allowed_is_said_loudly():
    notes = contact_notes(HYBRID, ROBOTS, None)
    assert notes[0].startswith("CONTACT IS ALLOWED: arm")
    assert any("fixtures" in note for note in notes)


def test_contact_without_the_mode_has_no_effect_and_check_says_so():
    other = RiskSettings(mode="predictive")
    assert contact_facts(other, ROBOTS, None) == {}
    (note,) = contact_notes(other, ROBOTS, None)
    assert "no effect" in note


def test_nothing_is_said_where_nobody_may_be_touched():
    aloof = ARM.model_copy(update={"contact": None})
    assert contact_notes(HYBRID, [(aloof, ROBOTS[0][1])], None) == []


def hybrid(**contact):
    return RiskSettings.model_validate({"mode": "hybrid", "contact": contact})


@pytest.mark.parametrize(
    ("fixture", "holds"),
    [
        ({"kind": "plane", "point": [-1, 0, 0], "normal": [1, 0, 0]}, False),
        ({"kind": "plane", "point": [-1, 0, 0], "normal": [-1, 0, 0]}, True),  # wrong way round
        ({"kind": "plane", "point": [0, 0, 0.75], "normal": [0, 0, 1]}, False),  # its table
        ({"kind": "box", "pose": {"xyz": [0, 0, 0.375]}, "size": [0.3, 0.3, 0.75]}, False),
        ({"kind": "box", "pose": {"xyz": [0, 0, 1]}, "size": [4, 4, 2]}, True),  # the whole cell
    ],
)
def test_a_fixture_that_holds_the_robot_itself_is_said(fixture, holds):
    notes = contact_notes(hybrid(fixtures=[{"name": "wall", **fixture}]), ROBOTS, None)
    assert any("in or behind wall" in note for note in notes) is holds


def test_a_table_that_permits_more_than_the_shipped_one_is_said(tmp_path):
    data = yaml.safe_load(data_path("contact", "iso_ts_15066.yaml").read_text())
    (tmp_path / "same.yaml").write_text(yaml.safe_dump(data))
    data["regions"]["chest"]["spring_n_mm"] = 1
    (tmp_path / "soft.yaml").write_text(yaml.safe_dump(data))
    milder = contact_notes(hybrid(table="soft.yaml"), ROBOTS, tmp_path)
    assert any("touch chest faster" in note for note in milder)
    same = contact_notes(hybrid(table="same.yaml"), ROBOTS, tmp_path)
    assert not any("faster than the shipped" in note for note in same)


def test_an_own_speed_that_is_left_out_is_said():
    assert any("left_out" in n for n in contact_notes(hybrid(own_speed="left_out"), ROBOTS, None))
    assert not any("left_out" in note for note in contact_notes(HYBRID, ROBOTS, None))


def test_hands_that_the_tracker_does_not_deliver_are_said():
    mapped = ~np.isin(JOINTS, ("l_hand", "r_hand"))
    assert "l_hand, r_hand not delivered" in unseen_ends_note(HYBRID, mapped)[0]
    assert unseen_ends_note(HYBRID, np.ones(len(JOINTS), bool)) == []
    assert unseen_ends_note(hybrid(own_speed="left_out"), mapped) == []
    assert unseen_ends_note(RiskSettings(), mapped) == []


def test_names_are_printed_as_they_are(tmp_path, capsys):
    data = yaml.safe_load(configuration.shipped("demo.yaml").read_text())
    data["robots"][0] |= {"name": "arm (links)", "contact": "allowed"}
    data["risk"] |= {
        "mode": "hybrid",
        "contact": {
            "fixtures": [
                {"kind": "box", "name": "red_3.b", "pose": {"xyz": [2, 2, 1]}, "size": [1, 1, 1]}
            ]
        },
    }
    for link in data["links"]:
        del link["simulate"]["robot"]
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(data))
    check(config=tmp_path / "cell.yaml")
    said = capsys.readouterr().out
    assert "arm (links)" in said
    assert "red_3.b" in said
