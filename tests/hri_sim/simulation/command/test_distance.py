"""``hri-predict simulate --distance``: a table, JSON, files, and one line for every mistake."""

import json
import sys
import time

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.cli import main
from hri_predict.run import config as configuration
from hri_sim.simulation.command.shown import counting

QUICK = ["--distance", "--activity", "talking", "--noise", "0", "--seconds", "4", "--jobs", "1",
         "--predictor", "constant_velocity"]  # fmt: skip


@pytest.fixture
def cli(monkeypatch, capsys):
    """Run a command line; gives exit status, standard output, standard error."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["hri-predict", "simulate", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return ended.value.code or 0, captured.out, captured.err

    return call


@pytest.mark.long
def test_a_table_files_and_the_same_as_json(cli, tmp_path):
    modes = ["--mode", "iso", "--mode", "foreknown"]
    status, out, err = cli(*QUICK, *modes, "--tracker", "full", "--out", tmp_path)
    assert status == 0, err
    assert "Working distance, m" in out
    assert "the controller's silence timeout" in out
    data = json.loads((tmp_path / "distance.json").read_text())
    (case,) = data["cases"]
    assert case["modes"]["foreknown"]["distance_m"] < case["modes"]["iso"]["distance_m"]
    parts = data["waterfall"]
    assert parts["total_m"] == pytest.approx(sum(parts["costs_m"].values()) + parts["rest_m"])
    names = {"distance.md", "distance.json", "speed_over_distance.png", "waterfall.png"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert "--json" not in out


@pytest.mark.long
def test_the_terms_are_those_of_a_mode_that_a_node_can_have(cli, tmp_path):
    """Zones of the true future are not made of the terms."""
    given = [*QUICK, "--tracker", "full", "--mode", "foreknown"]
    status, out, err = cli(*given, "--mode", "iso", "--json")
    assert status == 0, err
    data = json.loads(out)
    assert data["waterfall"]["mode"] == "iso"
    iso_m = data["cases"][0]["modes"]["iso"]["distance_m"]
    assert data["waterfall"]["total_m"] == pytest.approx(iso_m, abs=0.03)  # each to its own step
    status, out, err = cli(*given, "--out", tmp_path)
    assert status == 0, err
    assert "Contributions" not in out
    assert json.loads((tmp_path / "distance.json").read_text())["waterfall"] is None


@pytest.mark.long
def test_without_matplotlib_there_are_tables_alone(cli, tmp_path, no_matplotlib):
    status, _, err = cli(*QUICK, "--mode", "iso", "--tracker", "full", "--out", tmp_path)
    assert (status, err.count(no_matplotlib)) == (0, 1)
    assert {path.name for path in tmp_path.iterdir()} == {"distance.md", "distance.json"}


def test_people_left_out_without_the_data_pack_are_named_before_the_measurement(
    cli, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    status, _, err = cli("--distance", "--robot", "nowhere")  # ends before the measurement
    assert status == 2
    first, last = err.splitlines()[0], err.splitlines()[-1]
    assert first.startswith("warning: Left out: the data pack with the recordings for window")
    assert "nowhere" in last


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--episodes", "3"], "--episodes: has no effect with --distance"),
        (["--occlude"], "--occlude: has no effect with --distance"),
        (["--tracker", "coco71"], "did you mean 'coco17'"),
        (["--activity", "sleeping"], "--activity sleeping: unknown"),
        (["--robot", "amr"], "--robot amr: unknown"),
        (["--mode", "iso9"], "iso9"),
        (["live_udp.yaml"], "no path of robot arm is known"),
        (["simulate_mobile.yaml"], "its base moves"),
    ],
)
def test_mistakes_are_one_line_before_anything_is_measured(cli, arguments, message):
    status, out, err = cli(*QUICK, "--tracker", "full", *arguments)
    assert (status, out) == (2, "")
    assert message in err
    assert len(err.strip().splitlines()) == 1


def test_options_of_the_distance_are_refused_without_it(cli):
    status, _, err = cli("--activity", "window")
    assert status == 2
    assert "--activity: has no effect without --distance" in err


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(cli):
    pytest.importorskip("matplotlib")
    status, _, err = cli("--distance", "--activity", "talking", "--out", "/dev/null/report")
    assert status == 2
    assert "--out /dev/null/report: cannot be written" in err


def test_without_a_terminal_progress_is_a_line_every_few_seconds(capsys):
    with counting("people", every_s=0.05) as count:
        time.sleep(0.2)
        count(1, 3, "window, full")
        time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "people (0 s)"
    assert lines[-1] == "people: 1 of 3, last: window, full (0 s)"


def test_a_cell_without_a_path_is_refused_before_any_worker_starts(cli, monkeypatch):
    monkeypatch.setattr("hri_sim.simulation.distance.run.workers_for", None)
    status, _, err = cli(*QUICK, "--tracker", "full", "live_udp.yaml")
    assert status == 2
    assert "motion: {kind: state, plan: pick_and_place}" in err


def test_workers_of_a_cluster_must_have_the_same_files(cli, tmp_path, monkeypatch):
    """Without a check, another machine would measure another recording, path or tracker."""
    read: list[str] = []

    def workers_for(jobs, cluster, reads=()):
        read.extend(path.name for path in reads)
        raise ConfigError("ends here")

    monkeypatch.setattr("hri_sim.simulation.distance.run.workers_for", workers_for)
    text = configuration.shipped("working_distance.yaml").read_text(encoding="utf-8")
    for folder, name in (("trajectories", "pick_and_place"), ("skeletons", "coco17")):
        copy = tmp_path / f"own_{name}.yaml"
        copy.write_bytes(data_path(folder, f"{name}.yaml").read_bytes())
    cell = tmp_path / "cell.yaml"
    cell.write_text(text.replace("pick_and_place", "own_pick_and_place.yaml"), encoding="utf-8")
    rest = np.array([[x, y, 0.7] for y in (0.25, 0.1, -0.1) for x in (0.2, -0.2)])
    positions = rest + 0.1 * np.sin(np.arange(120) / 30)[:, None, None]
    np.savez(tmp_path / "arms.npz", positions=positions.astype(np.float32), fps=np.float32(30))
    status, _, err = cli(
        *("--distance", "--activity", tmp_path / "arms.npz", "--noise", "0", "--jobs", "1"),
        *("--predictor", "constant_velocity", "--tracker", tmp_path / "own_coco17.yaml", cell),
    )
    assert status == 2, err
    assert "ends here" in err
    assert set(read) == {"cell.yaml", "own_pick_and_place.yaml", "arms.npz", "own_coco17.yaml"}
