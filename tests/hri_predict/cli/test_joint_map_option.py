"""``--joint-map``: taken by every command that opens recordings, with the same words."""

import json

import numpy as np
import pytest

from hri_predict.recording import open_recording

ARMS = ("l_shoulder", "l_elbow", "l_wrist", "r_shoulder", "r_elbow", "r_wrist")
COMMANDS = {
    "replay": ["RECORDING", "--speed", "max", "--no-links"],
    "evaluate": ["--data", "RECORDING", "--predictor", "zero_velocity"],
    "calibrate": ["--data", "RECORDING", "--predictor", "zero_velocity"],
    "simulate": ["--data", "RECORDING", "--predictor", "zero_velocity", "--episodes", "1"],
    "train": ["CONFIG", "--data", "FOLDER", "--set", "data.fit=[a.csv]"],
    "convert": ["RECORDING", "OUTPUT"],
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A table of arms that nobody's rule knows, with the map for it."""
    monkeypatch.chdir(tmp_path)
    rest = np.array([[0.2, y, 0.9 - 0.2 * k] for y in (0.2, -0.2) for k in range(3)])
    head = ",".join(f"P{k}_{axis}" for k in range(6) for axis in "xyz")
    rows = [f"time_s,{head}"]
    for frame in range(100):
        moved = rest + 0.1 * np.sin(frame / 10)
        rows.append(f"{frame / 50:.3f}," + ",".join(f"{v:.4f}" for v in moved.ravel()))
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    mapped = "\n".join(f"  {joint}: P{k}" for k, joint in enumerate(ARMS))
    (tmp_path / "own.yaml").write_text(
        f"name: own\nreference: a test\nunits: m\naxes: [x, y, z]\n"
        f"joints: [P0, P1, P2, P3, P4, P5]\nmap:\n{mapped}\n",
        encoding="utf-8",
    )
    return tmp_path


@pytest.fixture
def cli(folder, cli):
    """Run a command on the table; gives exit status, standard output, standard error."""
    given = {
        "RECORDING": folder / "a.csv",
        "FOLDER": folder,
        "OUTPUT": folder / "b.mcap",
        "CONFIG": "configs/training/stb_real.yaml",
    }

    def call(command, *more):
        words = [given.get(word, word) for word in (*COMMANDS[command], *more)]
        return cli(command, *words)

    return call


@pytest.mark.parametrize("command", COMMANDS)
def test_a_map_that_is_not_there_is_one_line_in_every_command(cli, command):
    status, out, err = cli(command, "--joint-map", "nowhere.yaml")
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    assert "joint map nowhere.yaml: cannot be read: No such file" in err
    assert err.count("\n") == 1
    _, _, err = cli(command, "--joint-map", "coco71")
    assert "no joint map 'coco71'; did you mean 'coco17'?" in err


@pytest.mark.parametrize("command", ["evaluate", "calibrate", "simulate", "replay"])
def test_names_that_no_rule_knows_ask_for_a_map(cli, command):
    status, _, err = cli(command)
    assert status == 2
    assert "no joint matches l_shoulder" in err
    assert "--joint-map FILE" in err


@pytest.mark.long
def test_with_the_users_map_recordings_are_evaluated_simulated_and_replayed(cli):
    status, out, err = cli("evaluate", "--joint-map", "own.yaml", "--json")
    assert status == 0, err
    assert set(json.loads(out)["results"][0]["actions"]) == {"a"}
    status, _, err = cli("simulate", "--joint-map", "own.yaml", "--mode", "iso", "--json")
    assert status == 0, err
    status, _, err = cli("replay", "--joint-map", "own.yaml", "--predictor", "zero_velocity")
    assert status == 0, err


def test_with_the_users_map_a_recording_keeps_its_joints_in_another_format(cli, folder):
    status, _, err = cli("convert", "--joint-map", "own.yaml", "--to", "mcap")
    assert status == 0, err
    assert open_recording(folder / "b.mcap").joint_map.mapped.sum() == len(ARMS)
