"""``check`` tells how fast a robot may touch whom, and warns of it."""

from hri_predict.cli.check.contact import contact_facts, contact_notes
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.settings import Pose

ARM = RobotSettings(
    name="arm",
    model="ur5e",
    room_from_robot=Pose(xyz=[0, 0, 0.75]),
    payload_kg=2.0,
    max_speed_m_s=1.0,
    contact="allowed",
)
ROBOTS = [(ARM, load_robot(ARM, None))]
HYBRID = RiskSettings(mode="hybrid")


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
