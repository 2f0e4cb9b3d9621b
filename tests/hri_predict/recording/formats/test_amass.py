"""Archives in AMASS's style: joints are read, parameters of a body model are explained."""

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import open_recording
from hri_predict.recording.formats.amass import SMPL


@pytest.fixture
def save(tmp_path):
    def call(**arrays):
        np.savez(tmp_path / "a.npz", **arrays)
        return tmp_path / "a.npz"

    return call


def _error(path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("count", [22, 24, 52])
@pytest.mark.parametrize("key", ["joints", "Jtr"])
def test_joints_in_the_order_of_smpl(save, key, count):
    joints = np.random.default_rng(0).normal(size=(3, count, 3))
    path = save(**{key: joints}, mocap_framerate=60.0, poses=np.zeros((3, 156)))
    recording = open_recording(path, person=9)
    assert (recording.kind, recording.rate_hz) == ("amass", 60.0)
    person = recording.scenes[2].people[0]
    assert person.id == 9
    mapped, seen = recording.joint_map.map(person.positions, person.observed)
    for name, column in (("l_hip", 1), ("r_wrist", 21), ("head", 15), ("l_foot", 10)):
        assert seen[JOINTS.index(name)]
        np.testing.assert_array_equal(mapped[JOINTS.index(name)], joints[2, column])


@pytest.mark.parametrize("count", [17, 23, 25, 44])
def test_as_many_joints_as_no_smpl_has_are_not_taken_for_it(save, count):
    joints = np.random.default_rng(0).normal(size=(3, count, 3))
    assert "no joint matches" in _error(save(joints=joints, fps=30))


def test_names_in_the_file_come_first(save):
    names = np.array([*JOINTS[::-1], "tool"])
    joints = np.random.default_rng(0).normal(size=(3, 22, 3))
    recording = open_recording(save(joints=joints, fps=30, joint_names=names))
    person = recording.scenes[0].people[0]
    mapped, seen = recording.joint_map.map(person.positions, person.observed)
    assert seen.all()
    np.testing.assert_array_equal(mapped, joints[0, 20::-1])


def test_parameters_of_the_body_model_are_no_joints(save):
    path = save(poses=np.zeros((3, 156)), trans=np.zeros((3, 3)), betas=np.zeros(16))
    assert "licensed model" in _error(path)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"joints": np.zeros((3, 22, 3))}, "'mocap_framerate' is missing"),
        ({"joints": np.zeros((3, 22, 3)), "fps": 0.0}, "'fps' gives 0"),
        ({"joints": np.zeros((3, 22, 3)), "fps": "fast"}, "'fps' is not one finite number"),
        ({"joints": np.zeros((3, 66)), "fps": 30.0}, "of shape (3, 66)"),
        ({"joints": np.zeros((0, 22, 3)), "fps": 30.0}, "'joints' has no frames"),
        ({"joints": np.full((3, 22, 3), "x"), "fps": 30.0}, "expected numbers"),
        (
            {"joints": np.zeros((3, 2, 3)), "fps": 30.0, "joint_names": ["a", "a"]},
            "different names",
        ),
        ({"joints": np.array([object()]), "fps": 30.0}, "truncated or not a NumPy archive"),
    ],
)
def test_what_is_wrong_is_named(save, arrays, message):
    assert message in _error(save(**arrays))


@pytest.mark.parametrize("rate", [30, 30.0, [30], [[30.0]], np.float32(30), "30", b"30"])
def test_a_rate_of_any_shape_is_one_number(save, rate):
    path = save(joints=np.ones((3, 22, 3)), mocap_framerate=rate)
    assert open_recording(path).rate_hz == 30.0


@pytest.mark.parametrize("rate", [[30, 31], [], np.nan, [np.inf], "fast"])
def test_what_is_not_one_rate_is_refused(save, rate):
    assert "'mocap_framerate' is not one finite number" in _error(
        save(joints=np.ones((3, 22, 3)), mocap_framerate=rate)
    )


@pytest.mark.parametrize("other", ["fps", "mocap_frame_rate", "frame_rate"])
def test_two_rates_must_be_the_same(save, other):
    both = {"joints": np.ones((3, 22, 3)), "mocap_framerate": 120.0}
    assert open_recording(save(**both, **{other: [120]})).rate_hz == 120.0
    error = _error(save(**both, **{other: 30}))
    assert f"'{other}' is" in error or f"but '{other}'" in error
    assert "remove the wrong one" in error


@pytest.mark.parametrize("kind", ["S", "U"])
@pytest.mark.parametrize("shape", [(22,), (22, 1), (1, 22)])
def test_names_as_bytes_or_text_of_any_shape(save, kind, shape):
    names = np.array(SMPL[:22]).astype(kind).reshape(shape)
    path = save(joints=np.ones((3, 22, 3)), joint_names=names, fps=30)
    assert open_recording(path).joint_map.source_joints == SMPL[:22]
