"""``commission`` without questions: steps, state, report, ``--repeat``, and what ``check`` says."""

import json
import shutil
from typing import Any

import pytest
import yaml

from hri_predict.cli.commission import commission
from hri_predict.commissioning.report import read_report, to_data
from tests.commands import status_of
from tests.hri_predict.commissioning.cells import cell_data, write_cell

ANSWERS: dict[str, Any] = {
    "by": "Ada",
    "walk": {"seconds": 3, "virtual": True, "least_coverage": 0.01},
    "skip": {"echo": "later", "stopping": "no robot yet"},
    "notes": ["the fence is missing"],
    "signatures": [{"role": "integrator", "name": "Ada"}],
}
DEAF = [{"name": "p", "kind": "serial", "port": "/dev/none", "baudrate": 115200}]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A cell that was commissioned, as far as it goes without a clock; the folder is copied."""
    folder = tmp_path_factory.mktemp("cell")
    write_cell(folder, cell_data(risk={"mode": "iso"}))
    (folder / "answers.yaml").write_text(yaml.safe_dump(ANSWERS))
    cell, answers = folder / "cell.yaml", folder / "answers.yaml"
    assert status_of("commission", cell, "--out", folder / "out", "--answers", answers) == 0
    return folder


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "cell")


def steps_of(folder) -> Any:
    """The steps of a report, as plain data."""
    report, _ = read_report(folder / "out" / "report.json")
    return report.steps.model_dump()


def change(folder, key, value, *, section="risk"):
    path = folder / "cell.yaml"
    data = yaml.safe_load(path.read_text())
    data[section][key] = value
    path.write_text(yaml.safe_dump(data))


@pytest.mark.long
def test_it_writes_a_report_that_says_what_was_done_and_what_was_not(folder):
    report, _ = read_report(folder / "out" / "report.json")
    steps = steps_of(folder)
    outcomes = {name: step["outcome"] for name, step in steps.items()}
    assert outcomes == {
        "registration": "passed", "echo": "skipped", "stopping": "skipped", "walk": "passed",
    }  # fmt: skip
    assert report.outcome == "open"
    assert report.simulated
    assert steps["walk"]["by"] == "Ada"
    assert report.notes == ["the fence is missing"]
    assert report.config_path == "../cell.yaml"
    assert all(p["error_m"] < 0.02 for p in steps["registration"]["result"]["points"])
    assert "the fence is missing" in (folder / "out" / "report.html").read_text()


def test_it_goes_on_where_it_was_and_does_one_step_again(folder, cli):
    words = ["commission", folder / "cell.yaml", "--out", folder / "out"]
    status, _, err = cli(*words)
    assert status == 0
    assert err.count("passed before; --step") == 4
    status, _, err = cli(*words, "--step", "walk", "--skip", "walk=rain", "--note", "wet")
    assert status == 0
    report, _ = read_report(folder / "out" / "report.json")
    assert steps_of(folder)["walk"]["note"] == "rain"
    assert steps_of(folder)["registration"]["outcome"] == "passed"
    assert report.notes == ["wet"]


@pytest.mark.long
def test_the_status_is_of_the_named_step_or_of_all(folder, cli):
    answers: dict[str, Any] = {
        **ANSWERS,
        "skip": {"echo": "later", "stopping": "no robot yet", "walk": "rain"},
    }
    (folder / "answers.yaml").write_text(yaml.safe_dump(answers))
    change(folder, "person_uncertainty_m", 0.06)
    words = ["commission", folder / "cell.yaml", "--out", folder / "out"]
    words += ["--answers", folder / "answers.yaml"]
    status, out, _ = cli(*words, "--step", "walk")  # of the other three, none is of this cell
    assert status == 0
    assert "not passed: registration: done before the cell was changed; repeat it" in out
    change(folder, "room_from_source", {"xyz": [0, 0, 1]}, section="source")
    assert cli(*words, "--skip", "registration=later")[0] == 0
    answers["skip"].pop("walk")
    (folder / "answers.yaml").write_text(
        yaml.safe_dump({**answers, "walk": {**ANSWERS["walk"], "least_coverage": 1}})
    )
    assert cli(*words, "--step", "walk")[0] == 1
    status, out, _ = cli(*words, "--skip", "registration=later")
    assert status == 1
    assert "not passed: walk: failed: " in out
    assert cli(*words, "--step", "echo")[0] == 0  # though the walk has failed


def test_what_was_done_before_the_cell_changed_is_open(folder, cli):
    change(folder, "person_uncertainty_m", 0.06)
    words = ["commission", folder / "cell.yaml", "--out", folder / "out", "--step", "echo"]
    _, out, _ = cli(*words, "--skip", "echo=later", "--json")
    found = json.loads(out)
    assert found["outcome"] == "open"
    assert "walk: done before the cell was changed; repeat it" in found["open"]


def test_the_same_cell_gives_the_same_advice(folder, cli):
    assert cli("commission", "--repeat", folder / "out") == (
        0, "the recorded walk gives the same advice, tick by tick\n", "",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value", "status", "line"),
    [
        ("person_uncertainty_m", 0.0, 1, "LESS SAFE: robot arm: a higher speed limit"),
        ("person_uncertainty_m", 0.15, 0, "nothing became less safe"),
    ],
)
def test_another_configuration_is_compared(folder, cli, key, value, status, line):
    change(folder, key, value)
    found, out, _ = cli("commission", folder / "cell.yaml", "--repeat", folder / "out")
    assert found == status
    assert line in out
    assert f"changed: risk.{key}: 0.05 -> {value}" in out


def test_a_sensor_that_was_moved_cannot_be_judged_by_an_old_recording(folder, cli):
    change(folder, "room_from_source", {"xyz": [0, 0, 1]}, section="source")
    status, out, _ = cli("commission", "--repeat", folder / "out", "--json")
    assert status == 1
    assert any("walk again" in line for line in json.loads(out)["less_safe"])


@pytest.mark.parametrize(
    ("key", "known"),
    [
        ("source.sensors.left.room_from_source.xyz", False),
        ("source.sensors.left.joint_map", False),
        ("source.people.0.script", False),
        ("source.room_from_source.xyz", False),
        ("file of source.joint_map (coco17.yaml)", False),
        ("file of source.sensors.left.joint_map (own.yaml)", False),
        ("version of the code of source 'acme'", False),
        ("source.stale_s", True),
        ("source.field_of_view.polygon", True),
        ("version of the code of predictor 'acme'", True),
        ("version of hri-predict", True),
        ("risk.mode", True),
    ],
)
def test_what_only_a_new_walk_can_show_is_told_apart(key, known):
    assert commission._is_of_recording(key) is not known


@pytest.mark.parametrize("name", ["walk.mcap", "walk-advices.jsonl"])
def test_a_recording_that_was_changed_is_refused_and_check_says_so(folder, cli, name):
    with (folder / "out" / name).open("ab") as file:
        file.write(b"\n")
    status, _, err = cli("commission", "--repeat", folder / "out")
    assert status == 2
    assert f"{name}: was changed after" in err
    (folder / "cell.yaml").open("a").write("commissioning: out\n")
    status, out, _ = cli("check", folder / "cell.yaml", "--json")
    assert status == 1
    assert json.loads(out)["commissioning"]["wrong"] == [
        f"{name}: was changed after the report was written"
    ]


def test_check_says_whether_the_cell_is_as_commissioned(folder, cli):
    (folder / "cell.yaml").open("a").write("commissioning: {report: out/report.json}\n")
    status, out, _ = cli("check", folder / "cell.yaml")
    assert status == 0
    assert "the cell is unchanged" in out
    assert "made with simulated people" in out
    change(folder, "intrusion_m", 0.1)
    status, out, _ = cli("check", folder / "cell.yaml")
    assert status == 1
    assert "no longer matches: risk.intrusion_m: 0.0 -> 0.1" in out
    assert "valid, but not as commissioned" in out


def test_a_changed_cell_is_not_as_before_because_one_step_was_done_again(folder, cli):
    (folder / "cell.yaml").open("a").write("commissioning: out\n")
    change(folder, "intrusion_m", 0.1)
    words = ["commission", folder / "cell.yaml", "--out", folder / "out", "--step", "echo"]
    assert cli(*words, "--skip", "echo=later")[0] == 0
    status, out, _ = cli("check", folder / "cell.yaml")
    assert status == 1
    assert "NOT EVERY STEP WAS DONE IN THIS CELL" in out
    assert "  walk: passed before the cell was changed" in out
    assert "echo: skipped before" not in out


def test_a_simulation_does_not_commission_a_real_cell(folder, cli):
    data = yaml.safe_load((folder / "cell.yaml").read_text())
    data["links"], data["commissioning"] = DEAF, "out"
    data["source"] = {"kind": "udp", "rate_hz": 30, "room_from_source": {"xyz": [0, 0, 0]}}
    path = write_cell(folder, data)
    path_of = {"walk": {**ANSWERS["walk"], "seconds": 2}}
    (folder / "answers.yaml").write_text(yaml.safe_dump(path_of))
    shutil.rmtree(folder / "out")
    words = ["commission", path, "--out", folder / "out", "--simulate", "--step", "walk"]
    assert cli(*words, "--answers", folder / "answers.yaml")[0] == 0
    status, out, _ = cli("check", path)
    assert status == 1
    assert "  walk: passed in a simulation, and this cell is real" in out
    assert cli("commission", path, "--out", folder / "out", "--step", "walk", "--skip", "walk=x",
               "--simulate")[0] == 0  # fmt: skip
    assert cli("check", path)[0] == 0  # nothing is said to be tried


def test_a_step_that_failed_is_not_skipped_away(folder, cli):
    path = folder / "out" / "state.json"
    state = json.loads(path.read_text())
    state["steps"]["walk"] |= {"outcome": "failed", "why": ["a person vanished"]}
    path.write_text(json.dumps(state))
    words = ["commission", folder / "cell.yaml", "--out", folder / "out"]
    status, _, err = cli(*words, "--step", "walk", "--skip", "walk=no time")
    assert status == 1
    assert "walk: failed: no time\n  a person vanished" in err
    walk = steps_of(folder)["walk"]
    assert (walk["outcome"], walk["note"]) == ("failed", "no time")
    assert walk["result"] is not None
    change(folder, "intrusion_m", 0.1)  # another cell: the failure is not one of it
    assert cli(*words, "--step", "walk", "--skip", "walk=no time")[0] == 0


@pytest.mark.long
@pytest.mark.realtime
def test_run_warns_where_the_cell_is_not_as_commissioned(folder, cli):
    (folder / "cell.yaml").open("a").write("commissioning: out\n")
    status, _, err = cli("run", folder / "cell.yaml", "--duration", "0.2")
    assert (status, "commissioning" in err) == (0, False)
    change(folder, "intrusion_m", 0.1)
    status, _, err = cli("run", folder / "cell.yaml", "--duration", "0.2")
    assert status == 0
    assert "NOT THIS CELL ANY MORE: commission it again" in err


def test_check_does_not_pass_a_commissioning_that_failed(folder, cli):
    report, _ = read_report(folder / "out" / "report.json")
    walk = report.steps.walk
    assert walk is not None
    failed = walk.model_copy(update={"outcome": "failed", "why": ["somebody vanished"]})
    steps = report.steps.model_copy(update={"walk": failed})
    data = to_data(report.model_copy(update={"steps": steps}))
    (folder / "out" / "report.json").write_text(json.dumps(data))
    (folder / "cell.yaml").open("a").write("commissioning: out\n")
    status, out, _ = cli("check", folder / "cell.yaml")
    assert status == 1
    assert "NOT FIT TO BE SWITCHED ON" in out
    assert "walk: failed: somebody vanished" in out
    assert "valid, but not as commissioned" in out


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ([], "CONFIG: missing"),
        (["cell.yaml"], "--out: missing"),
        (["cell.yaml", "--out", "new", "--step", "wlak"], "did you mean 'walk'"),
        (["cell.yaml", "--out", "new", "--skip", "walk"], "give the reason"),
        (["cell.yaml", "--out", "new", "--skip", "wlak=x"], "did you mean 'walk'"),
        (["cell.yaml", "--out", "cell.yaml"], "cannot be written"),
        (["--repeat", "out", "--out", "new"], "--out: has no effect with --repeat"),
        (["--repeat", "none"], "--repeat none: no such file"),
        (
            ["cell.yaml", "--out", "new", "--step", "echo", "--skip", "echo=a", "--skip", "walk=b"],
            "--skip walk=b: has no effect with --step echo",
        ),
        (["cell.yaml", "--out", "new", "--skip", f"walk={'x' * 2001}"], "--skip: skip.walk: "),
        (["cell.yaml", "--out", "new", "--note", "x" * 2001], "--note: notes.0: "),
        (["cell.yaml", "--out", "new", "--by", "x" * 2001], "--by: by: "),
        (["other.yaml", "--out", "out"], "holds the validation of cell.yaml"),
    ],
)
def test_a_mistake_is_one_line(folder, cli, monkeypatch, words, why):
    monkeypatch.chdir(folder)
    shutil.copy("cell.yaml", "other.yaml")
    status, out, err = cli("commission", *words)
    assert (status, out) == (2, "")
    assert why in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("step", "answers", "why"),
    [
        ("registration", {}, "registration.points: 0 given"),
        ("registration", {"points": [[0, 0, 1], [1, 0, 1], [1, 1, 1]]}, "registration.every_s"),
        ("stopping", {}, "stopping.cell_is_clear: not confirmed"),
        ("stopping", {"measured": [{"robot": "amr", "speed_m_s": 1, "time_s": 1,
                                    "distance_m": 0.5}]}, "did you mean 'arm'"),
        ("echo", {"measured": {"q": {"p50_ms": 1, "p99_ms": 2, "max_ms": 3}}}, "no such link"),
        ("echo", {}, "/dev/none"),
        ("walk", {"virtual": True}, "walk.virtual"),
        ("walk", {"shadow": False}, "walk.shadow"),
    ],
)  # fmt: skip
def test_a_step_with_real_people_and_robots_refuses_what_is_missing(
    tmp_path, cli, step, answers, why
):
    data = cell_data(links=DEAF)
    data["source"] = {"kind": "udp", "rate_hz": 30, "room_from_source": {"xyz": [0, 0, 0]}}
    (tmp_path / "answers.yaml").write_text(yaml.safe_dump({step: answers}))
    status, _, err = cli(
        "commission", write_cell(tmp_path, data), "--out", tmp_path / "out", "--step", step,
        "--answers", tmp_path / "answers.yaml",
    )  # fmt: skip
    assert status == 2
    assert why in err.splitlines()[-1]
    assert not (tmp_path / "out" / "state.json").exists()


def test_stops_that_were_measured_elsewhere_are_compared(tmp_path, cli):
    stop = {"robot": "arm", "speed_m_s": 1.0, "time_s": 0.5, "distance_m": 0.1}
    (tmp_path / "answers.yaml").write_text(yaml.safe_dump({"stopping": {"measured": [stop]}}))
    status, _, err = cli(
        "commission", write_cell(tmp_path), "--out", tmp_path / "out", "--step", "stopping",
        "--answers", tmp_path / "answers.yaml",
    )  # fmt: skip
    assert status == 1
    assert "stopping: failed" in err
    assert "from braking 500 ms" in err


@pytest.mark.realtime
def test_the_echo_goes_through_a_pseudo_terminal_and_slcan(tmp_path, cli):
    (tmp_path / "answers.yaml").write_text(yaml.safe_dump({"echo": {"seconds": 3}}))
    words = ["commission", write_cell(tmp_path), "--out", tmp_path / "out", "--step", "echo"]
    cli(*words, "--answers", tmp_path / "answers.yaml")  # a busy machine may be late
    for link in steps_of(tmp_path)["echo"]["result"]["links"]:
        assert link["measured_by"] == "controller"
        assert link["echoes"] >= 10  # 25 a second, where nothing else runs
        assert 0 < link["in_node"]["p50_ms"] < 1000
        assert link["both_ways_ms"] < 1000
