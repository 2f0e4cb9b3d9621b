"""``hri-predict simulate``: tables, files, JSON, and one clear line for every mistake."""

import json
import sys

import numpy as np
import pytest

from hri_predict.cli import main
from hri_sim.simulation.request import OcclusionRow


@pytest.fixture
def small(tmp_path):
    """Arguments: one approach of a second's recording of arms, by a cheap predictor."""
    rest = np.array([[x, y, 0.7] for y in (0.25, 0.1, -0.1) for x in (0.2, -0.2)])
    positions = rest + 0.1 * np.sin(np.arange(45) / 30)[:, None, None]
    path = tmp_path / "arms.npz"
    np.savez(path, positions=positions.astype(np.float32), fps=np.float32(30))
    return ["--predictor", "constant_velocity", "--data", path, "--episodes", "1"]


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
def test_tables_files_and_resumed_json(cli, small, tmp_path):
    out = tmp_path / "loop"
    status, text, err = cli(*small, "--mode", "iso", "--mode", "predictive", "--out", out)
    assert status == 0, err
    assert "unprotected" in text
    files = {"simulate.md", "simulate.json", "simulate.png", "risk_productivity.png"}
    assert files <= {path.name for path in out.iterdir()}
    arguments = ["--mode", "iso", "--mode", "predictive", "--out", out, "--resume", "--json"]
    status, text, err = cli(*small, *arguments)
    assert status == 0, err
    data = json.loads(text)
    assert data == json.loads((out / "simulate.json").read_text())
    assert [r["mode"] for r in data["results"]] == ["iso", "predictive", "unprotected"]
    assert data["whole_node"] == {"episodes": 2, "disagreements": []}
    assert data["asked"]["recordings"] == ["arms"]


@pytest.mark.long
def test_without_matplotlib_there_are_tables_alone(cli, small, tmp_path, no_matplotlib):
    status, _, err = cli(*small, "--mode", "iso", "--out", tmp_path / "loop")
    assert (status, err.count(no_matplotlib)) == (0, 1)
    kinds = {path.suffix for path in (tmp_path / "loop").iterdir()}
    assert {".md", ".json"} <= kinds
    assert ".png" not in kinds


def test_without_the_data_pack_the_alternatives_are_named(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, err = cli("--episodes", "1")
    assert status == 2
    assert "the data pack with recordings of people is not in ../shared/data" in err
    assert "--data procedural" in err
    assert "no such file" not in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--resume"], "--out"),
        (["--mode", "iso", "--mode", "iso"], "given twice"),
        (["--mode", "ISO9"], "mode"),
        (["--predictor", "nobody"], "nobody"),
        (["--data", "nowhere"], "no such file"),
        (["--coverage", "0.5"], "level"),
        (["nowhere.yaml"], "no such file"),
        (["demo.yaml"], "approach"),
        (["--predictor", "sinn="], "--predictor sinn=: write NAME or NAME=WEIGHTS"),
        (["--predictor", "kalman=w"], "does not use weights"),
        (["--predictor", "kalman", "--calibration", "none.json"], "none.json"),
        (["--split", "tset"], "--split tset: unknown; did you mean 'test'"),
        (["--split", "test_motion"], "--split test_motion: has no effect on procedural"),
        (["--joint-map", "coco17"], "--joint-map: has no effect on procedural people alone"),
        (["--data", "procedural", "--data", "procedural"], "procedural is named twice"),
        (["--episodes", "0"], "episodes"),
        (["--people", "9"], "people"),
        (["--cameras", "2"], "--cameras: has no effect without --occlude"),
        (["--free-space"], "--free-space: has no effect without --occlude"),
        (["--first", "3"], "--first: has no effect without --occlude"),
        (["--rates", "30"], "--rates: has no effect without --occlude"),
        (["--occlude", "--data", "walk.npz"], "--data: has no effect with --occlude"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(cli, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    known = [] if "--data" in arguments else ["--data", "procedural"]
    status, out, err = cli(*arguments, *known)
    assert status == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert message in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mode", "bogus"], "--mode bogus: unknown (iso, predictive, hybrid, reactive, fixed)"),
        (["--mode", "foreknown"], "--mode foreknown: unknown"),
        (["--predictor", "sinn=w"], "--predictor sinn=w: not with --occlude"),
        (["live_udp.yaml"], "links: every link needs a 'simulate:' block"),
        (["--rates", "0.01"], "rates"),
        (["--rates", "nan"], "rates"),
        (["--rates", "1000"], "rates"),
        *(
            ([flag, *value], f"{flag}: has no effect with --occlude")
            for flag, *value in [
                ("--coverage", "0.9"), ("--people", "2"), ("--split", "test"), ("--resume",),
                ("--joint-map", "coco17"), ("--tracker", "coco17"), ("--noise", "0.01"),
                ("--wander", "0.01"), ("--out", "runs"),
            ]
        ),
    ],
)  # fmt: skip
def test_a_mistake_with_occlude_is_one_line_and_status_2(cli, arguments, message):
    status, out, err = cli("--occlude", "--episodes", "1", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert message in err


@pytest.mark.parametrize(
    ("more", "predictor"),
    [((), "average"), (("--predictor", "constant_velocity"), "constant_velocity")],
)
def test_the_table_of_occluded_episodes_names_the_predictor(cli, monkeypatch, more, predictor):
    row = OcclusionRow(
        index=0, mode="iso", contacts=0, contacts_standing=0, permitted=0.1, lost=0.5
    )
    monkeypatch.setattr("hri_sim.simulation.occluded.simulate", lambda request, count: [row])
    given = ["--occlude", "--episodes", "1", "--mode", "iso", *more]
    status, out, err = cli(*given)
    assert status == 0, err
    assert f"predictor {predictor}" in " ".join(out.split())
    _, out, _ = cli(*given, "--json")
    assert json.loads(out)["request"]["predictor"] == predictor


def test_a_recording_named_twice_is_refused(cli, tmp_path):
    path = tmp_path / "walk.npz"
    path.write_bytes(b"x")
    status, _, err = cli("--data", path, "--data", path)
    assert status == 2
    assert "named twice" in err


def test_a_cluster_that_is_not_there_is_one_line(cli, small, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    monkeypatch.setattr("hri_predict.base.work.cluster.CONNECT_S", 0.3)
    status, text, err = cli(*small, "--cluster", "tcp://127.0.0.1:9")
    assert (status, text) == (2, "")
    assert "no Dask scheduler answers there" in err
    assert len(err.strip().splitlines()) == 1


def test_jobs_have_no_effect_with_a_cluster(cli, small):
    status, _, err = cli(*small, "--cluster", "tcp://127.0.0.1:9", "--jobs", "2")
    assert status == 2
    assert "--jobs: has no effect with --cluster" in err
