"""``check`` warns plainly of each operating mode that is allowed, and of none that is not."""

from pathlib import Path

import pytest
import yaml

from hri_predict.cli.check.check import examine
from hri_predict.cli.check.notes import mode_notes, still_note
from hri_predict.robots.model import RobotSettings
from hri_predict.run import config as configuration
from hri_sim.baseline_demo import BASELINE
from tests.pages import ROOT

ARM = {"name": "arm", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}
MODES = {"teach": {}, "recovery": {"speed_m_s": 0.06}, "muting": {"max_s": 4}}
WORDS = {
    "teach": "robot arm: TEACH is allowed: in manual mode, while the enabling device is held",
    "recovery": "robot arm: RECOVERY is allowed: near people it may move back along its plan at up "
    "to 0.06 m/s",
    "muting": "robot arm: MUTING is allowed: for up to 4 s no person stops it, at up to 1 m/s",
}


def notes(**modes: object) -> list[str]:
    motion = {"kind": "state", "plan": "pick_and_place"}
    return mode_notes(RobotSettings.model_validate({**ARM, "motion": motion, "modes": modes}))


@pytest.mark.parametrize("key", MODES)
def test_each_mode_has_its_warning(key: str) -> None:
    (note,) = notes(**{key: MODES[key]})
    assert note.startswith(WORDS[key])


def test_a_robot_that_a_file_moves_is_named() -> None:
    motion = {"kind": "trajectory", "file": "pick_and_place"}
    (note,) = mode_notes(RobotSettings.model_validate({**ARM, "motion": motion}))
    assert note.startswith("robot arm: motion.kind trajectory: the file says where it is")


def test_muting_says_for_which_share_of_the_time() -> None:
    (note,) = notes(muting={"max_s": 4, "rest_s": 12})
    assert "after 12 s without a request, so people may be ignored for 25% of" in note


def test_nothing_is_said_by_default_and_all_where_all_is_allowed() -> None:
    assert notes() == []
    assert len(notes(**MODES)) == 3


def test_robots_whose_freeze_at_a_standstill_is_not_noticed_are_named_in_one_note() -> None:
    arms = [RobotSettings.model_validate({**ARM, "name": name}) for name in ("left", "right")]
    doubted = RobotSettings.model_validate({**ARM, "motion": {"kind": "state", "still_s": 2}})
    (note,) = still_note([*arms, doubted], "predictive")
    assert note.startswith("left, right: a RobotState that freezes while the robot is at rest")
    assert "motion.still_s notices it" in note
    assert still_note([doubted], "predictive") == []
    assert still_note(arms, "fixed") == []  # it holds wherever in its reach the arm is


def test_check_shows_them(tmp_path: Path) -> None:
    data = yaml.safe_load((ROOT / "configs" / "demo.yaml").read_text(encoding="utf-8"))
    data["predictor"] = BASELINE
    data["robots"][0]["modes"] = {"muting": {"max_s": 4}}
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    found = examine(configuration.load(path))["notes"]
    assert any(note.startswith(WORDS["muting"]) for note in found)
