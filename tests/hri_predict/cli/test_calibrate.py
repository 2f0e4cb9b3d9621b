"""``hri-predict calibrate``: a calibration made, measured, carded; one clear line for a mistake."""

import json
from functools import partial

import numpy as np
import pytest

from hri_predict.cli.calibrate.checking import _calibrated_on
from hri_predict.lab.calibration.scores import score_recordings
from hri_predict.predictors.baselines import ConstantVelocity, ConstantVelocitySettings
from hri_predict.zones.calibration import load_calibration
from tests.commands import status_of
from tests.hri_predict.short_fit import short_fit

CV = ["--predictor", "constant_velocity"]


@pytest.fixture(scope="module", autouse=True)
def _short_fit():
    with short_fit():
        yield


@pytest.fixture
def cli(cli):
    """Run the command; gives exit status, standard output, standard error."""
    return partial(cli, "calibrate")


def walking(path, seed, frames=240, fps=120.0):
    """A CMU-like recording of a random pose that is carried about, wandering."""
    rng = np.random.default_rng(seed)
    pose = np.random.default_rng(0).normal((0.0, 1.0, 0.0), 0.3, size=(38, 3))
    heading = rng.normal(0, 3 / np.sqrt(fps), frames).cumsum()
    ways = np.stack([np.sin(heading), 0 * heading, np.cos(heading)], axis=1)
    root = (ways * 1.2 / fps).cumsum(axis=0)
    np.savez(
        path,
        positions_world=(pose + root[:, None]).astype(np.float32),
        fps=np.float32(fps),
        world_ok=np.ones(frames, bool),
        floor_height=np.float32(0.0),
        rest_pose_frames=np.int32(0),
        action="walking",
        split="train",
        index=seed,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("recordings")
    for seed in range(5):
        walking(place / f"walking_{seed}.npz", seed)
    return place


@pytest.fixture(scope="module")
def made(folder, tmp_path_factory):
    """A calibration of constant velocity."""
    out = tmp_path_factory.mktemp("made") / "cv.json"
    assert status_of("calibrate", *CV, "--data", folder, "--out", out) == 0
    return out


@pytest.mark.long
def test_a_calibration_is_made_and_says_what_it_rests_on(cli, folder, tmp_path):
    out = tmp_path / "cv.json"
    status, text, err = cli(*CV, "--data", folder, "--out", out)
    assert status == 0
    told = [f"fitting the scale, {k} of 6" for k in range(1, 7)]  # no terminal: a line for each
    assert [line for line in err.splitlines() if line.startswith("fitting")] == told
    assert "5 recordings" in text
    assert "estimated; a guarantee needs" in text
    assert "94 of people who move briskly" in " ".join(text.split())  # 99 % takes 99
    calibration = load_calibration(out)
    assert calibration.predictor == "constant_velocity"
    assert calibration.steps == 30
    assert [r.name for r in calibration.recordings] == [f"walking_{k}" for k in range(5)]


@pytest.mark.long
def test_the_same_recordings_give_the_same_bytes(cli, folder, made, tmp_path):
    assert cli(*CV, "--data", folder, "--out", tmp_path / "again.json")[0] == 0
    assert (tmp_path / "again.json").read_bytes() == made.read_bytes()


@pytest.mark.long
def test_json_alone(cli, folder, tmp_path):
    status, text, _ = cli(*CV, "--data", folder, "--out", tmp_path / "cv.json", "--json")
    assert status == 0
    told = json.loads(text)
    assert told["predictor"] == "constant_velocity"
    assert len(told["recordings"]) == 5


@pytest.mark.parametrize("number", [2, pytest.param(5, marks=pytest.mark.long)])
def test_what_was_made_is_measured_and_written(cli, folder, made, tmp_path, number):
    out, card = tmp_path / "measured", tmp_path / "card.md"
    check = ["--check", "--calibration", made, "--out", out, "--card", card, "--json"]
    some = tmp_path / "some"
    some.mkdir()
    for seed in range(number):
        (some / f"walking_{seed}.npz").symlink_to(folder / f"walking_{seed}.npz")
    status, text, err = cli(*CV, "--data", some, *check)
    assert status == 0
    assert f"made from {number} of these recordings (walking_0, walking_1, " in err
    told = json.loads(text)
    assert told == json.loads((out / "zones.json").read_text())
    assert told["recordings"] == number
    assert {(c["level"], c["of"]) for c in told["coverage"]} == {
        (level, of) for level in (0.9, 0.95, 0.99) for of in ("joint", "body")
    }
    own = [c for c in told["coverage"] if c["way"] == "as calibrated" and c["of"] == "joint"]
    for entry in own:  # on the recordings that it was made of: what it states, or more
        assert min(entry["share"]) >= entry["level"] - 0.01
    assert (out / "zones.md").read_text().startswith("# Zones of constant_velocity")
    assert (out / "zones_reliability.png").read_bytes().startswith(b"\x89PNG")
    assert card.read_text().count("## Zones") == 1
    assert "*estimated* from 5 recordings" in card.read_text()


def test_a_check_without_matplotlib_has_tables_alone(cli, folder, made, tmp_path, no_matplotlib):
    out = tmp_path / "measured"
    wanted = ["--check", "--calibration", made, "--out", out]
    status, _, err = cli(*CV, "--data", folder / "walking_0.npz", *wanted)
    assert (status, err.count(no_matplotlib)) == (0, 1)
    assert sorted(path.name for path in out.iterdir()) == ["zones.json", "zones.md"]
    measured = (out / "zones.md").read_text()
    assert "Measured coverage of each joint, as calibrated, %\n" in measured
    assert "interval" not in measured  # one recording says nothing of others


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--predictor", "constant_velocty"], "constant_velocity"),
        ([*CV, "--weights", "x.safetensors"], "--weights: constant_velocity does not use weights"),
        ([*CV, "--calibration", "x.json"], "--calibration: has no effect without --check"),
        ([*CV, "--disturb"], "--disturb: has no effect without --check"),
        ([*CV, "--horizon", "0"], "--horizon 0: too short"),
        ([*CV, "--horizon", "nan"], "--horizon nan: too short"),
        ([*CV, "--horizon", "100"], "horizon_s"),
        ([*CV, "--split", "test"], "--split test: has no effect"),
        ([*CV, "--split", "tset"], "--split tset: unknown; did you mean 'test'"),
        ([*CV, "--out", "."], "--out .: exists and is not a calibration, so it is not replaced"),
        ([*CV, "--check", "--calibration", "nowhere.json"], "nowhere.json"),
        ([*CV, "--check", "--horizon", "1.2", "--calibration", "FOREIGN"], "is of predictor"),
        (["--predictor", "aggregated", "--check"], "no calibration is shipped"),
        ([*CV, "--check", "--disturb", "--horizon", "0.2"], "--disturb measures at 0.4 s"),
    ],
)
def test_a_mistake_is_one_line(cli, folder, made, tmp_path, arguments, said):
    foreign = tmp_path / "foreign.json"
    foreign.write_text(made.read_text().replace("constant_velocity", "zero_velocity", 1))
    words = [str(foreign) if a == "FOREIGN" else a for a in arguments]
    status, out, err = cli(*words, "--data", folder)
    assert status == 2
    assert out == ""
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_a_calibration_is_measured_up_to_a_shorter_horizon(cli, folder, made):
    check = ["--check", "--calibration", made, "--horizon", "0.4", "--json"]
    status, out, _ = cli(*CV, "--data", folder, *check)
    assert status == 0
    assert json.loads(out)["horizons_ms"][-1] == 400


def test_a_recording_is_not_replaced_by_its_calibration(cli, folder):
    before = (folder / "walking_0.npz").read_bytes()
    status, _, err = cli(*CV, "--data", folder, "--out", folder / "walking_0.npz")
    assert status == 2
    assert ": exists and is not a calibration, so it is not replaced" in err
    assert (folder / "walking_0.npz").read_bytes() == before


@pytest.mark.parametrize("text", ["", "[]", '{"version": 3}', '{"predictor": "sinn"}'])
def test_another_json_is_not_replaced_by_a_calibration(cli, folder, tmp_path, text):
    other = tmp_path / "state.json"
    other.write_text(text)
    status, _, err = cli(*CV, "--data", folder, "--out", other)
    assert status == 2
    assert ": exists and is not a calibration, so it is not replaced" in err
    assert other.read_text() == text


def test_a_copy_is_no_second_recording(cli, folder, tmp_path):
    (tmp_path / "copy_1.npz").write_bytes((folder / "walking_0.npz").read_bytes())
    status, _, err = cli(*CV, "--data", folder, "--data", tmp_path / "copy_1.npz")
    assert status == 2
    assert "is a copy of" in err


def test_what_was_calibrated_on_is_known_by_its_content(folder, made, tmp_path):
    renamed, namesake = tmp_path / "other_1.npz", tmp_path / "walking_1.npz"
    renamed.write_bytes((folder / "walking_0.npz").read_bytes())
    walking(namesake, 50)  # as long as the one that was used
    built = ConstantVelocity(ConstantVelocitySettings(name="constant_velocity", horizon_s=0.2))
    scores = score_recordings(built, [renamed, namesake])
    calibration = load_calibration(made)
    assert _calibrated_on(calibration, scores) == {"other_1"}
    # of recordings without digests the name must do
    data = json.loads(made.read_text())
    for recording in data["recordings"]:
        del recording["digest"]
    old = tmp_path / "old.json"
    old.write_text(json.dumps(data))
    assert _calibrated_on(load_calibration(old), scores) == {"walking_1"}


def test_two_folders_of_the_same_names_are_different_recordings(cli, tmp_path):
    for day in range(2):
        (tmp_path / f"day_{day}").mkdir()
        for index in range(2):
            walking(tmp_path / f"day_{day}" / f"walking_{index}.npz", 10 * day + index)
    out = tmp_path / "cv.json"
    status, text, err = cli(*CV, "--data", tmp_path, "--out", out)
    assert status == 0, err
    assert "4 recordings" in text
    used = load_calibration(out).recordings
    assert [r.name for r in used] == [
        f"day_{day}/walking_{index}.npz" for day in range(2) for index in range(2)
    ]
    assert len({r.digest for r in used}) == 4


def test_too_few_recordings_are_refused(cli, folder, tmp_path):
    single = folder / "walking_0.npz"
    status, _, err = cli(*CV, "--data", single, "--out", tmp_path / "cv.json")
    assert status == 2
    assert "too few recordings (1)" in err
    assert not (tmp_path / "cv.json").exists()


@pytest.mark.long
def test_a_recording_that_is_too_short_is_named_and_left_out(cli, folder, tmp_path):
    short = tmp_path / "glimpse_1.npz"
    walking(short, 9, frames=20)
    out = tmp_path / "cv.json"
    status, _, err = cli(*CV, "--data", folder, "--data", short, "--out", out)
    assert status == 0, err
    assert err.splitlines()[0] == (
        f"warning: recording {short}: no person is seen for 0.72 s without a break; left out"
    )
    assert "glimpse_1" not in [r.name for r in load_calibration(out).recordings]
    status, _, err = cli(*CV, "--data", short, "--out", out)
    assert status == 2
    assert "no other recording is left; give others" in err
