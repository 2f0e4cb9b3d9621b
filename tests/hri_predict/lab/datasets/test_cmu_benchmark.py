"""The CMU benchmark's poses, windows and errors, against the data pack's account of them."""

import json
import re

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.lab.datasets import cmu_benchmark as cmu
from hri_predict.lab.evaluation.benchmark import Protocol, constant_velocity, judge, zero_velocity
from hri_predict.predictors.neural.cmu_skeleton import (
    CMU25,
    CMU38,
    CONSTANT,
    DUPLICATES,
    MM_PER_UNIT,
    MOVING,
    OFFSETS,
)
from tests.shared import DATA

PACK = DATA / "cmu_mocap"
needs_pack = pytest.mark.skipif(not PACK.exists(), reason="needs ../shared/data/cmu_mocap")
FRAMES = {10: [1, 3, 7, 9], 25: [1, 3, 7, 9, 13, 24]}
TABLES: list[tuple[str, str, int, str]] = [
    ("Zero velocity, all windows, 10 -> 25:", "all", 25, "zero_velocity"),
    ("Zero velocity, 8 seeds, 10 -> 25:", "8-seeds", 25, "zero_velocity"),
    ("Zero velocity, all windows of the short run, 10 -> 10:", "all", 10, "zero_velocity"),
    ("Constant velocity, all windows, 10 -> 25:", "all", 25, "constant_velocity"),
    ("Constant velocity, 8 seeds, 10 -> 25:", "8-seeds", 25, "constant_velocity"),
]


def printed(heading):
    """The table below a heading of the pack's README: {action: (windows, [errors])}, and means."""
    text = (DATA / "README.md").read_text(encoding="utf-8")
    lines = text[text.index(heading) :].splitlines()[2:]
    rows = {}
    for line in lines:
        if not line.startswith("|"):
            break
        cells = [c.strip() for c in line.strip("|").split("|")]
        if re.fullmatch(r"[\d.]+", cells[-1]) and cells[0] != "action":
            windows = int(cells[1]) if cells[1] else 0
            rows[cells[0]] = (windows, [float(c) for c in cells[2:]])
    return rows


@pytest.fixture(scope="module")
def measured():
    """Scores of both baselines under each protocol, measured once."""
    found = {}
    for windows, n_out in {(w, n) for _, w, n, _ in TABLES}:
        both = {
            "zero_velocity": zero_velocity(n_out),
            "constant_velocity": constant_velocity(n_out),
        }
        found[windows, n_out] = judge(Protocol("cmu", windows, n_out), DATA, both)
    return found


@needs_pack
@pytest.mark.parametrize(("heading", "windows", "n_out", "method"), TABLES)
def test_baselines_to_the_printed_digit(heading, windows, n_out, method, measured):
    table = printed(heading)
    mean = table.pop("mean of the first 5")[1]
    scores = measured[windows, n_out][method]
    assert set(table) == set(scores)
    for action, (count, errors) in table.items():
        assert scores[action].windows == count
        assert [f"{scores[action].errors[f]:.2f}" for f in FRAMES[n_out]] == [
            f"{e:.2f}" for e in errors
        ], action
    five = np.mean([[scores[a].errors[f] for f in FRAMES[n_out]] for a in cmu.MEAN_OVER], axis=0)
    assert five == pytest.approx(mean, abs=0.011)  # printed: the mean of rounded numbers


@needs_pack
def test_error_over_the_25_joints_to_the_printed_digit(measured):
    table = printed("Zero velocity, all windows, 10 -> 25, over the 25 joints only:")
    for action, score in measured["all", 25]["zero_velocity"].items():
        errors = score.joints.mean(axis=1)[FRAMES[25]]
        assert [round(float(e), 2) for e in errors] == table[action][1], action


@needs_pack
def test_first_seeded_windows_are_the_printed_ones():
    text = (DATA / "README.md").read_text(encoding="utf-8")
    listed = re.search(r"First 8 seeds \(idx\), for checking: (.*?)\.\n", text, re.S)
    assert listed
    groups = [g.strip() for g in listed[1].replace("\n", " ").split(";")]
    checked = 0
    for group in groups:
        parts = re.fullmatch(r"([a-z ]+) ([\d ]+)", group)
        assert parts
        words, numbers = parts.groups()
        for action in words.split(" and "):
            frames = len(cmu.read_clip(PACK, f"test/{action}_1").expmaps)
            drawn = cmu.seeded_windows(frames, 50, 8)
            assert drawn.tolist() == [int(n) for n in numbers.split()]
            # 10 observed frames end where 50 do
            assert (cmu.seeded_windows(frames, 10, 8) - drawn == 40).all()
            checked += 1
    assert checked == 6


@needs_pack
def test_skeleton_is_the_packs():
    pack = json.loads((PACK / "skeleton.json").read_text(encoding="utf-8"))
    assert list(CMU38.joints) == pack["joints"]
    assert list(CMU38.parents) == pack["parents"]
    assert pack["offsets_asf_units"] == OFFSETS.tolist()
    assert pack["benchmark_mm_per_asf_unit"] == MM_PER_UNIT
    assert list(MOVING) == pack["benchmark_joints_25"]
    assert list(CMU25.parents) == pack["benchmark_parents_25"]
    assert list(CONSTANT) == pack["benchmark_constant_joints"]
    assert {str(a): b for a, b in DUPLICATES.items()} == pack["benchmark_duplicates"]
    assert {k: list(v) for k, v in CMU25.parts.items()} == pack["body_parts_25_positions"]
    assert {k: list(v) for k, v in CMU38.parts.items()} == pack["body_parts"]
    assert sorted(map(list, CMU38.left_right_pairs)) == sorted(pack["left_right_pairs"])


def test_duplicates_err_as_their_twins_and_constant_joints_do_not():
    true = np.zeros((1, 1, 25, 3))
    predicted = true.copy()
    predicted[0, 0, MOVING.index(32)] = (3.0, 4.0, 0.0)  # a wrist: 33 and 36 lie on it
    errors = cmu.joint_errors(predicted, true)[0, 0]
    assert {j: e for j, e in enumerate(errors) if e} == {32: 5.0, 33: 5.0, 36: 5.0}


def test_benchmark_pose_ignores_the_root_and_bends_by_the_stored_vector_reversed():
    maps = np.zeros((2, 38, 3))
    maps[:, 0] = (0.3, -0.2, 0.9)
    maps[1, 22] = (0.0, 0.0, np.pi / 2)  # left elbow, whose forearm points left (x)
    rest, bent = cmu.Clip("test/x_1", "x", maps).positions()
    assert rest[0] == pytest.approx([0, 0, 0])
    elbow, wrist = CMU38.index("LeftForeArm"), CMU38.index("LeftHand")
    assert rest[wrist] - rest[elbow] == pytest.approx([70 * 3.35554, 0, 0])
    assert bent[wrist] - bent[elbow] == pytest.approx([0, -70 * 3.35554, 0])  # minus z turns down
    assert bent[elbow] == pytest.approx(rest[elbow])


def test_windows_of_short_recordings():
    assert cmu.all_windows(35, 10, 25).tolist() == [0]
    assert cmu.all_windows(34, 10, 25).size == 0
    with pytest.raises(RecordingError, match="--windows all"):
        cmu.seeded_windows(75, 10, 8)
    assert set(cmu.seeded_windows(82, 50, 80)) == set(range(7))


MAPS = np.full((9, 117), 0.1)
WRONG = {
    "lacks 'expmap'": {"positions": np.zeros((4, 3))},
    "'expmap' is float64 of shape (9, 96)": {"expmap": np.zeros((9, 96))},
    "'expmap' is <U3": {"expmap": MAPS.astype("U3")},
    "'expmap' is complex128": {"expmap": MAPS + 1j},
    "'expmap' is bool": {"expmap": MAPS > 0},
    "empty (no frames)": {"expmap": MAPS[:0]},
    "NaN or infinite in frame 3": {"expmap": np.where(np.arange(9)[:, None] == 3, np.nan, MAPS)},
    "beyond 1e+06": {"expmap": MAPS * 1e300},
    "not a NumPy archive": None,
}


@pytest.mark.parametrize("told", WRONG)
def test_wrong_recordings_are_refused_in_one_line(tmp_path, told):
    (tmp_path / "test").mkdir()
    path = tmp_path / "test" / "walking_1.npz"
    content = WRONG[told]
    if content is None:
        path.write_bytes(b"PK not really")
    else:
        np.savez(path, **content)
    with pytest.raises(RecordingError, match=r"walking_1\.npz: " + f".*{re.escape(told)}") as error:
        cmu.read_clip(tmp_path, "test/walking_1")
    assert "\n" not in str(error.value)


def test_a_folder_without_test_recordings_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="give the folder that holds"):
        cmu.data_root(tmp_path)
