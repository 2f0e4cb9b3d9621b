"""Only the pose's numbers change in a configuration; what is unusual is left to the user."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path, load_yaml
from hri_predict.cli.register.write import with_pose, write_pose
from hri_predict.run import config as configuration

POSE = ([1.0, -2.0, 2.4], [0.0, 0.6, 0.0, 0.8])
UDP = data_path("live_udp.yaml").read_text()
BLOCK = """\
source:  # the camera above the door
  kind: udp
  room_from_source:
    xyz: [0, 0, 0]  # measured in May
    quaternion_xyzw: [0, 0, 0, 1]  # and its rotation
  port: 47800
"""


@pytest.mark.parametrize("text", [UDP, BLOCK, BLOCK.replace("\n", "\r\n")])
def test_nothing_but_the_numbers_changes(text):
    new = with_pose(text, POSE)
    assert new is not None
    assert load_yaml(new)["source"]["room_from_source"] == {
        "xyz": POSE[0],
        "quaternion_xyzw": POSE[1],
    }
    assert new.replace("[1.0, -2.0, 2.4]", "[0, 0, 0]").replace(
        "[0.0, 0.6, 0.0, 0.8]", "[0, 0, 0, 1]"
    ) == text.replace("[0.0, 0.6, 0.0, 0.8]", "[0, 0, 0, 1]")


def test_a_missing_rotation_is_added():
    new = with_pose("source: {room_from_source: {xyz: [0, 0, 0]}, kind: udp}\n", POSE)
    assert new is not None
    assert load_yaml(new)["source"]["room_from_source"]["quaternion_xyzw"] == POSE[1]


@pytest.mark.parametrize(
    "text",
    [
        "source: {kind: udp}\n",
        "pose: &pose {xyz: [0, 0, 0]}\nsource: {room_from_source: *pose}\n",
        "source:\n  room_from_source:\n    xyz:\n    - 0\n    - 0\n    - 0\n",
        "- 1\n",
    ],
)
def test_an_unusual_form_is_left_alone(text):
    assert with_pose(text, POSE) is None


def test_the_old_file_is_kept_and_no_backup_is_overwritten(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(UDP)
    first = write_pose(path, POSE)
    second = write_pose(path, ([0.5, 0.0, 0.0], POSE[1]))
    assert first.read_text() == UDP
    assert first != second
    assert configuration.load(path).source.room_from_source.xyz == [0.5, 0.0, 0.0]


def test_a_shipped_configuration_is_not_written():
    with pytest.raises(ConfigError, match=r"belongs to the package.*room_from_source: \{xyz"):
        write_pose(data_path("live_udp.yaml"), POSE)


def test_small_numbers_are_no_words():
    """YAML reads -5e-06 as text; a level sensor's pose has such numbers."""
    pose = ([0.0, 1e-7, 2.4], [-5e-06, 5e-06, 0.295506, 0.955341])
    new = with_pose("source:\n  room_from_source: {xyz: [0, 0, 0]}\n  kind: udp\n", pose)
    assert new is not None
    assert "[-0.000005, 0.000005, 0.295506, 0.955341]" in new
    assert "[0.0, 0.0, 2.4]" in new
