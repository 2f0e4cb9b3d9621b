"""Cells and robots in other units, and numbers that YAML reads otherwise: ``check`` refuses them.

The inputs are shared ones, so that others read the same.
"""

import re

import pytest

from tests.cases import CASES
from tests.commands import status_of as run

CELLS = CASES / "cells"
pytestmark = pytest.mark.skipif(not CELLS.is_dir(), reason=f"needs {CELLS}")
STOP = ["--deceleration", "2", "--brake-delay", "0.1", "--payload-kg", "1"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("robot_pose_mm", r"yaml:11: robots\.0\.room_from_robot\.xyz\.0.*800.*metres are meant: 0"),
        ("limits_deg", r"limits_deg_robot\.yaml: .*'shoulder_pan'.*radians are meant: -6\.283\?"),
        ("octal_bitrate", "line 18.*'0500000' starts with a zero"),
        ("sexa_rate", "line 1.*'1:00' has a colon"),
        ("channel_octal", "line 18.*'010' starts with a zero"),
        ("usb_octal", "line 18.*'0403' starts with a zero"),
    ],
)
def test_a_cell_with_a_number_that_cannot_be_meant_is_refused_in_one_line(name, said, capsys):
    assert run("check", str(CELLS / f"{name}.yaml")) == 2
    error = capsys.readouterr().err
    assert re.search(said, error), error
    assert error.count("\n") == 1


def test_the_same_cell_in_metres_is_accepted(capsys):
    assert run("check", str(CELLS / "true.yaml")) == 0
    assert "true.yaml: ok" in capsys.readouterr().out.replace("\n", "")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("limits_degrees", "joint 'j1': .*radians per second are meant: 3.142"),
        ("rpy_degrees", "joint 'j2': origin's rpy 90.*radians are meant: 1.571"),
        ("xyz_mm", "joint 'j1': origin's xyz 400.*metres are meant: 0.4"),
        ("unexpanded", "<xacro:include> is left in it; expand it first"),
        ("placeholder_name", r"'\$\{prefix\}l2' in <link> is a placeholder.*expand it first"),
    ],
)
def test_a_urdf_that_cannot_be_meant_is_refused_in_one_line(name, said, capsys, tmp_path):
    out = tmp_path / "arm.yaml"
    chain = ["--base", "base_link", "--tip", "tool0", "--out", str(out)]
    assert run("urdf", str(CELLS / f"{name}.urdf"), *chain, *STOP) == 2
    error = capsys.readouterr().err
    assert re.search(said, error), error
    assert error.count("\n") == 1
    assert not out.exists()


def test_the_same_urdf_in_metres_and_radians_is_accepted(tmp_path):
    chain = ["--base", "base_link", "--tip", "tool0", "--out", str(tmp_path / "arm.yaml")]
    assert run("urdf", str(CELLS / "good.urdf"), *chain, *STOP) == 0
