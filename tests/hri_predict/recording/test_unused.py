"""What is said of joints that are not used, and of those that are missing."""

import logging

import pytest

from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.recording import open_recording, unused
from hri_predict.recording.naming import map_of_names

SHIPPED = [name for name in map_names() if name != "bvh"]


@pytest.mark.parametrize("name", SHIPPED)
def test_nothing_is_said_of_a_shipped_maps_own_joints(name):
    assert unused.unused(load_joint_map(name)) == ""
    assert unused.unused(map_of_names(load_joint_map(name).source_joints)) == ""


def test_idle_and_missing_joints_are_one_line():
    names = [*load_joint_map("coco17").source_joints, "Prop"]
    line = unused.unused(map_of_names(names))
    assert line == (
        "joints not used: nose, left_eye, right_eye, Prop; joints of a body that are missing: "
        "torso, head_top, l_hand, r_hand, l_foot, r_foot"
    )


def test_long_lists_are_cut():
    line = unused.unused(
        map_of_names([*load_joint_map("coco17").source_joints, *(f"P{k}" for k in range(30))])
    )
    assert "P8, and 21 more;" in line


def test_it_is_said_once_for_the_same_joints(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(unused, "_said", set())
    names = [*load_joint_map("coco17").source_joints, "Prop"]
    columns = ",".join(f"{name}_{axis}" for name in names for axis in "xyz")
    rows = "".join(f"{0.04 * k:.2f}{',1' * 3 * len(names)}\n" for k in range(3))
    with caplog.at_level(logging.WARNING):
        for name in ("a.csv", "b.csv"):
            (tmp_path / name).write_text(f"time_s,{columns}\n{rows}", encoding="utf-8")
            open_recording(tmp_path / name)
    assert [record.message for record in caplog.records] == [
        f"recording {tmp_path / 'a.csv'}: {unused.unused(map_of_names(names))}"
    ]
