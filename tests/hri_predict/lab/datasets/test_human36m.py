"""Human3.6M, on small files made in its usual layout."""

import json
import shutil
import warnings

import numpy as np
import pytest
import torch

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.lab.datasets.cmu_benchmark import to_model
from hri_predict.lab.datasets.human36m import (
    read_take,
    read_takes,
    seeded_windows,
)
from hri_predict.lab.evaluation.benchmark import Protocol, judge, open_tests, zero_velocity
from hri_predict.lab.training.windows.benchmark import HumanData, HumanSamples
from hri_predict.predictors.neural.human_skeleton import (
    HUMAN22,
    HUMAN32,
    OFFSETS_MM,
    PARENTS,
    SCORED,
)


def rotation(vector):
    """Rodrigues' formula, one vector at a time."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def chained(maps):
    """One frame's joints, by row vectors as the published kinematics have them."""
    turned, places = [], []
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            turned.append(np.eye(3))
            places.append(np.zeros(3))
            continue
        turned.append(rotation(maps[joint]) @ turned[parent])
        places.append(OFFSETS_MM[joint] @ turned[parent] + places[parent])
    return np.array(places)


@pytest.fixture
def dataset(tmp_path):
    """S5 with two takes each of two actions, and S1 and S11 that must not be tested on."""
    rng = np.random.default_rng(2)
    both = ("walking", "eating")
    for subject, actions in (("S5", both), ("S1", ("walking",)), ("S11", both)):
        (tmp_path / subject).mkdir()
        for action in actions:
            for take, frames in ((1, 400), (2, 380)):
                path = tmp_path / subject / f"{action}_{take}.txt"
                values = np.cumsum(rng.normal(scale=0.01, size=(frames, 99)), axis=0)
                np.savetxt(path, values, delimiter=",", fmt="%.7f")
    return tmp_path


def test_every_second_frame_by_the_published_kinematics(dataset):
    path = dataset / "S5" / "walking_1.txt"
    take = read_take(path)
    stored = np.loadtxt(path, delimiter=",")
    assert take.name == "S5/walking_1"
    assert take.action == "walking"
    assert take.positions.shape == (200, 32, 3)
    for frame in (0, 77, 199):
        expected = chained(stored[2 * frame, 3:].reshape(32, 3))
        np.testing.assert_allclose(take.positions[frame], expected, atol=1e-9)


def test_root_is_excluded_and_22_joints_are_scored(dataset):
    path = dataset / "S5" / "walking_1.txt"
    stored = np.loadtxt(path, delimiter=",")
    before = read_take(path).positions
    stored[:, :6] += 1.0
    np.savetxt(path, stored, delimiter=",", fmt="%.7f")
    np.testing.assert_allclose(read_take(path).positions, before, atol=1e-9)
    assert len(SCORED) == len(HUMAN22.joints) == 22
    moving = before[:, SCORED].std(axis=0).max(axis=1)
    assert (moving > 0).all()
    for joint in set(range(32)) - set(SCORED):  # still, or where a scored one or its like is
        gap = np.abs(before[:, joint, None] - before[:, SCORED]).max(axis=(0, 2)).min()
        assert before[:, joint].std(axis=0).max() < 1e-9 or gap < 1e-9


def test_zero_velocity_over_all_windows_of_subject_5(dataset):
    protocol = Protocol("human36m", "all", 25)
    scores = judge(protocol, dataset, {"zero": zero_velocity(25)})["zero"]
    assert set(scores) == {"walking", "eating"}
    takes = read_takes(dataset)["eating"]
    total = []
    for take in takes:
        joints = take.positions[:, SCORED]
        for start in range(len(joints) - 34):
            moved = joints[start + 10 : start + 35] - joints[start + 9]
            total.append(np.linalg.norm(moved, axis=-1).mean(axis=-1))
    assert scores["eating"].windows == len(total) == (200 - 34) + (190 - 34)
    np.testing.assert_allclose(scores["eating"].errors, np.mean(total, axis=0))


def test_training_fits_others_than_it_is_judged_on(dataset):
    chosen = HumanSamples(HumanData(root=dataset), 10, 25)
    assert (chosen.shape.skeleton, chosen.shape.framed) == (HUMAN22, True)
    assert chosen.window_count == (200 - 34) + (190 - 34)  # of S1
    takes = [to_model(t.positions[:, SCORED]) for t in read_takes(dataset, ["S1"])["walking"]]
    window = chosen.batch(np.random.default_rng(0), 1)
    joined = torch.cat([window.history, window.future], 1)[0].numpy()
    gaps = [np.abs(t[i : i + 35] - joined).max() for t in takes for i in range(len(t) - 34)]
    assert min(gaps) < 1e-6
    assert sum(len(s.history) for s in chosen.validation()) == 2 * 64
    refit = HumanSamples(HumanData(root=dataset, refit=True), 10, 25)
    assert refit.window_count == 3 * chosen.window_count
    with pytest.raises(
        ConfigError, match=r"data\.actions posing: no recording shows it; available"
    ):
        HumanSamples(HumanData(root=dataset, actions=["walking", "posing"]), 10, 25)


def test_training_names_the_subjects_that_are_missing(dataset, caplog):
    HumanSamples(HumanData(root=dataset), 10, 25)
    assert f"data.root {dataset}: trained without subjects S6, S7, S8, S9" in caplog.text


def test_training_from_a_folder_without_any_subject_names_the_folder(tmp_path):
    with pytest.raises(ConfigError, match=r"S1 or S6 .*\.txt there .*; give the folder"):
        HumanSamples(HumanData(root=tmp_path), 10, 25)


def test_training_without_the_subject_that_validates_is_refused(dataset):
    shutil.rmtree(dataset / "S11")
    with pytest.raises(ConfigError, match=r"data\.root .*: no recording of S11 to train with"):
        HumanSamples(HumanData(root=dataset), 10, 25)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "sizes", "error"),
    [
        ("trajectorycnn", ["options.channels=4", "options.blocks=1"], "mpjpe"),
        ("kdformer", ["options.layers=1"], "euler"),
    ],
)
def test_a_network_is_trained_on_it_and_judged(dataset, tmp_path, cli, *, name, sizes, error):
    def hri_predict(*arguments):
        status, out, err = cli(*arguments)
        assert status == 0, err
        return out

    small = ["judgement=human36m", *sizes, "train.epochs=1", "train.windows_per_epoch=32"]
    changes = [part for each in (*small, f"out={tmp_path / 'run'}") for part in ("--set", each)]
    hri_predict("train", f"configs/training/papers/{name}.yaml", "--data", dataset, *changes)
    weights = tmp_path / "run" / f"{name}.safetensors"
    asked = ["--benchmark", "human36m", "--data", dataset, "--windows", "8-seeds", "--json"]
    found = json.loads(hri_predict("evaluate", *asked, "--predictor", f"{name}={weights}"))
    assert found["error"] == error
    assert found["results"][0]["method"] == name
    assert set(found["results"][0]["actions"]) == {"walking", "eating"}


def test_seeded_windows_are_the_ones_that_papers_list():
    """Those of ``walking`` and ``eating``, as lists that go round have them."""
    drawn = seeded_windows([1296, 1192], 50)
    assert [d.tolist() for d in drawn] == [[1087, 1145, 660, 201], [955, 332, 304, 54]]
    drawn = seeded_windows([1580, 1108], 50)
    assert [d.tolist() for d in drawn] == [[1426, 1087, 1329, 1145], [374, 156, 955, 332]]
    assert seeded_windows([1296, 1192], 10)[0].tolist() == [1127, 1185, 700, 241]


@pytest.mark.parametrize("windows", ["all", "8-seeds"])
def test_takes_that_are_too_short_are_named(dataset, windows):
    for take in (1, 2):
        np.savetxt(dataset / "S5" / f"eating_{take}.txt", np.ones((40, 99)), delimiter=",")
    with pytest.raises(RecordingError, match=r"S5/eating_\*\.txt: .*20"):
        list(open_tests(Protocol("human36m", windows, 25), dataset))


def test_eight_seeds_of_each_action(dataset):
    tests = list(open_tests(Protocol("human36m", "8-seeds", 25), dataset))
    assert [t.history.shape for t in tests] == [(8, 10, 22, 3)] * 2


def test_256_seeds_go_on_where_8_end(dataset):
    eight, all_of_them = (seeded_windows([1296, 1192], 50, w) for w in ("8-seeds", "256-seeds"))
    assert [len(d) for d in all_of_them] == [128, 128]
    for few, many in zip(eight, all_of_them, strict=True):
        np.testing.assert_array_equal(many[:4], few)
    tests = list(open_tests(Protocol("human36m", "256-seeds", 25), dataset))
    assert [t.history.shape for t in tests] == [(256, 10, 22, 3)] * 2


def test_maps_are_the_stored_ones_of_all_joints_and_the_root_turns(dataset):
    path = dataset / "S5" / "walking_1.txt"
    stored = np.loadtxt(path, delimiter=",")
    np.testing.assert_array_equal(read_take(path).maps, stored[::2, 3:].reshape(-1, 32, 3))
    tests = list(open_tests(Protocol("human36m", "8-seeds", 25, "euler"), dataset))
    assert [t.history.shape for t in tests] == [(8, 50, 32, 3)] * 2
    assert HUMAN32.parents == PARENTS
    source = HumanSamples(HumanData(root=dataset, space="rotations"), 50, 25)
    assert (source.shape.skeleton, source.shape.joints) == (HUMAN32, 32)
    window = source.batch(np.random.default_rng(0), 1)
    joined = torch.cat([window.history, window.future], 1)[0].numpy()
    takes = [take.maps for take in read_takes(dataset, ["S1"])["walking"]]
    gaps = [np.abs(t[i : i + 75] - joined).max() for t in takes for i in range(len(t) - 74)]
    assert min(gaps) < 1e-6


def test_mistakes_are_named_in_one_line(dataset):
    with pytest.raises(ConfigError, match=r"80-seeds: Human3\.6M is evaluated with all, 8-seeds"):
        list(open_tests(Protocol("human36m", "80-seeds", 25), dataset))
    with pytest.raises(ConfigError, match=r"S5/<action>_<n>\.txt"):
        read_takes(dataset / "S1")
    with pytest.raises(RecordingError, match="more than 166 frames"):
        seeded_windows([160, 400], 10)
    (dataset / "S5" / "eating_3.txt").write_text("1,2,3\n4,5,6\n")
    with pytest.raises(RecordingError, match=r"eating_3\.txt: 3 columns"):
        read_takes(dataset)
    for text, told in (
        ("", "no frames"),
        ("nan," * 98 + "1\n", "NaN"),
        ("1e300," * 98 + "1\n", "1e"),
    ):
        (dataset / "S5" / "eating_3.txt").write_text(text)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(RecordingError, match=rf"eating_3.*{told}"):
                read_takes(dataset)
    (dataset / "S5" / "eating_3.txt").write_text("walking, but no number\n")
    with pytest.raises(RecordingError, match="comma-separated"):
        read_takes(dataset)
