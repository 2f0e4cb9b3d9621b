"""The command line, in process: help, JSON, and one clear line for every mistake."""

import copy
import json
from typing import Any

import numpy as np
import pytest
import yaml

from hri_predict.base.files import data_path
from hri_predict.cli import run
from tests.shared import DATA

DEMO = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
DEMO["predictor"] = {"name": "constant_velocity", "horizon_s": 1.2}  # a network starts slowly
COMMANDS = [
    "demo", "run", "check", "conformance", "replay", "listen", "predictors",
    "bench", "bench faults", "bench links", "bench fleet", "bench memory",
    "urdf", "ablate", "card", "protocol files", "protocol dbc",
    "protocol document", "protocol c-header",
]  # fmt: skip


@pytest.fixture
def mistake(cli):
    """Run a command line that must fail: the one line that it says."""

    def call(*arguments):
        status, out, err = cli(*arguments)
        assert status == 2
        assert out == ""
        assert len(err.splitlines()) == 1, err
        assert err.startswith("error: ")
        assert len(err) < 700
        return err

    return call


@pytest.fixture
def write(tmp_path):
    """Write the demo's configuration with changes [(way, value), ...]; ``...`` removes a key."""

    def call(*changes):
        data = copy.deepcopy(DEMO)
        for way, value in changes:
            *outer, last = way
            place = data
            for part in outer:
                place = place[part]
            if value is ...:
                del place[last]
            else:
                place[last] = value
        path = tmp_path / "cell.yaml"
        path.write_text(yaml.safe_dump(data), encoding="utf-8")
        return path

    return call


# -- help


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help(cli, command):
    status, out, err = cli(*command.split(), "--help")
    assert status == 0
    assert err == ""
    assert f"hri-predict {command}".strip() in " ".join(out.split())
    if command:
        assert "Example: hri-predict" in out


def test_without_a_command_help_is_printed_and_it_fails(cli):
    status, out, err = cli()
    assert status == 2
    assert "replay" in out + err
    assert "error" not in err


def test_every_command_is_listed(cli):
    _, out, _ = cli("--help")
    assert all(command.split()[0] in out for command in COMMANDS)


# -- the command line itself


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["frobnicate"], ["frobnicate", "see hri-predict --help"]),
        (["run"], ["config", "see hri-predict run --help"]),
        (["run", "a.yaml", "--frobnicate"], ["--frobnicate", "see hri-predict run --help"]),
        (["run", "a.yaml", "--duration", "long"], ["--duration"]),
        (["run", "a.yaml", "--record"], ["--record", "see hri-predict run --help"]),
        (["replay", "a.npz", "b.yaml"], ["--config b.yaml", "see hri-predict replay --help"]),
        (["replay", "b.yaml", "a.npz"], ["--config b.yaml"]),
        (["run", "a.yaml", "--duration", "-1"], ["--duration -1"]),
        (["run", "a.yaml", "--duration", "nan"], ["--duration nan"]),
        (["run", "configs/demo.yaml", "--duration", "inf"], ["--duration inf"]),
        (["run", "configs/demo.yaml", "--duration", "1e300"], ["--duration 1e+300"]),
        (["replay", "a.npz", "--speed", "0"], ["--speed 0", "max"]),
        (["replay", "a.npz", "--speed", "-2"], ["--speed -2", "max"]),
        (["replay", "a.npz", "--speed", "inf"], ["--speed inf"]),
        (["replay", "a.npz", "--speed", "quick"], ["--speed quick", "max"]),
        (["replay", "a.npz", "--place", "1,2"], ["--place 1,2", "x,y,yaw"]),
        (["replay", "a.npz", "--place", "1,2,nan"], ["--place 1,2,nan", "finite"]),
        (["demo", "--fault", "dorp@1+1"], ["dorp", "did you mean 'drop'?"]),
        (["demo", "--speed", "max", "--record", "/no/such/folder/a.mcap"], ["/no/such/folder"]),
        (["demo", "--speed", "max", "--record", "/dev/full"], ["/dev/full", "No space left"]),
        (["listen", "drive"], ["listen drive", "serial:PORT", "can:INTERFACE:CHANNEL"]),
        (["listen", "serial:/dev/no-such-port"], ["/dev/no-such-port", "not found"]),
        (["listen", "can:nope:can0"], ["can:nope:can0", "nope", "socketcan"]),
        (["listen", "serial:/dev/ttyS0", "--seconds", "nan"], ["--seconds nan"]),
        (["listen", "serial:/dev/ttyS0", "--baudrate", "0"], ["baudrate"]),
        (["bench", "faults", "--only", "no such"], ["--only no such"]),
        (["bench", "memory", "--hours", "0"], ["--hours 0"]),
        (["bench", "links", "--only", "no such"], ["--only no such", "serial pty 115200"]),
        (["bench", "links", "--seconds", "nan"], ["--seconds nan"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_wrong_command_line_is_one_line(mistake, arguments, named):
    line = mistake(*arguments)
    for part in named:
        assert part in line


# -- configurations

# ``run/test_config.py`` has what loading finds; here are the others, which other stages find
CONFIG_MISTAKES: dict[str, tuple[list[Any], list[str]]] = {
    "wrong type": ([(["rate_hz"], "fast")], ["rate_hz", "'fast'"]),
    "link over capacity": (
        [(["links", 1, "bitrate"], 50_000)],
        ["link 'monitor'", "load", "raise the bit rate"],
    ),
    "delay budget past the horizon": (
        [(["predictor", "horizon_s"], 0.4)],
        ["predictor.horizon_s", "T_r", "T_s", "0.400"],
    ),
    "unknown robot model": (
        [(["robots", 0, "model"], "ur5x")],
        [": robots.0.model: ", "'ur5x'", "did you mean 'ur5'?", "ur5e"],
    ),
    "unknown trajectory": (
        [(["links", 0, "simulate", "trajectory"], "dance")],
        ["dance", "pick_and_place"],
    ),
    "person out of reach": (
        [(["source", "people", 0, "script", 2, "to"], [9, 9, 9])],
        ["source.people.0.script.2"],
    ),
    "misspelt simulation": (
        [(["links", 0, "simulate"], {"role": "drive", "perod_s": 0.01})],
        ["did you mean 'period_s'"],
    ),
    "no drive": ([(["links", 0, "simulate"], {"role": "monitor"})], ["0 simulated drives"]),
    "misspelt fault": ([(["links", 0, "faults"], [{"kind": "dropp"}])], ["did you mean 'drop'"]),
    "no port": (
        [(["links", 0, "simulate"], None), (["links", 0, "port"], "")],
        ["links.0.port: "],
    ),
    "no channel": (
        [(["links", 1, "simulate"], None), (["links", 1, "channel"], "")],
        ["links.1.channel: "],
    ),
}


@pytest.mark.parametrize("name", CONFIG_MISTAKES)
@pytest.mark.parametrize("command", ["check", "run"])
def test_a_wrong_configuration_is_one_line(mistake, write, command, name):
    changes, named = CONFIG_MISTAKES[name]
    if command == "check" and name == "unknown trajectory":
        pytest.skip("check starts no mock controller")
    line = mistake(command, write(*changes))
    for part in named:
        assert part in line


def test_an_unknown_predictor_on_the_command_line_lists_those_there_are(mistake, tmp_path):
    line = mistake("replay", write_npz(tmp_path / "a.npz"), "--predictor", "oracle")
    assert "oracle" in line
    assert "constant_velocity" in line


def test_a_robot_file_with_a_broken_chain(mistake, write, tmp_path):
    robot = yaml.safe_load(data_path("robots", "ur5e.yaml").read_text(encoding="utf-8"))
    robot["joints"][2]["parent"] = "nowhere"
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(robot))
    line = mistake("check", write((["robots", 0, "model"], "arm.yaml")))
    assert "arm.yaml" in line
    assert "nowhere" in line


STATED = {"silence_timeout_s": 0.06, "reaction_s": 0.02}  # else ``run`` warns


def test_an_absent_serial_port(mistake, write):
    config = write(
        (["links", 0, "simulate"], ...),
        (["links", 0, "port"], "/dev/no-such-port"),
        (["links"], [{"name": "drive", "kind": "serial", "port": "/dev/no-such-port"} | STATED]),
    )
    line = mistake("run", config, "--duration", "1")
    assert "/dev/no-such-port" in line
    assert "not found" in line


def test_an_absent_can_device(mistake, write):
    link = {"name": "bus", "kind": "can", "interface": "slcan", "channel": "/dev/no-such-can"}
    config = write((["links"], [link | STATED]))
    assert "/dev/no-such-can" in mistake("run", config, "--duration", "1")


# -- recordings


def write_npz(path, frames=40, joints=38):
    """A recording in the data pack's form (a guess is enough: it is made to be spoilt)."""
    source = DATA / "cmu_mocap" / "test" / "walking_1.npz"
    if not source.exists():
        pytest.skip("needs ../shared/data")
    with np.load(source, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, array in arrays.items():
        if array.ndim and array.shape[0] > 100:
            arrays[name] = array[:frames]
    np.savez(path, **arrays)
    return path


def replay(mistake, path, *more):
    line = mistake("replay", path, "--speed", "max", *more)
    assert path.name in line
    return line


@pytest.mark.parametrize("suffix", ["npz", "bvh", "mcap"])
def test_a_missing_recording(mistake, tmp_path, suffix):
    assert "no such file" in replay(mistake, tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", ["npz", "bvh", "mcap"])
@pytest.mark.parametrize("content", [b"", b"neither this nor that"])
def test_a_recording_that_is_none(mistake, tmp_path, suffix, content):
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(content)
    replay(mistake, path)


def test_a_recording_of_an_unknown_kind(mistake, tmp_path):
    path = tmp_path / "a.docx"
    path.write_bytes(b"PK")
    assert "npz" in replay(mistake, path)
    replay(mistake, tmp_path)


# -- JSON


@pytest.mark.long
def test_json_is_alone_on_standard_output(cli, monkeypatch):
    """The demo's beginning, as fast as possible; its alerts go to standard error."""
    monkeypatch.setattr(run, "DEMO_S", 9.0)
    status, out, err = cli("demo", "--speed", "max", "--json")
    assert status == 0
    data = json.loads(out)  # one value and nothing else
    assert out.count("\n") == 1
    assert data["contacts"] == data["contacts_standing"] == 0
    assert data["stops"] >= 1
    assert "-> stop: arm: " in err
    assert {c["name"] for c in data["controllers"]} == {"drive", "monitor"}


def test_predictors(cli):
    status, out, _ = cli("predictors", "--json")
    rows = json.loads(out)
    assert status == 0
    assert {"constant_velocity", "kalman", "zero_velocity"} <= {row["name"] for row in rows}
    assert all(row["about"] for row in rows)
    status, out, _ = cli("predictors")
    assert status == 0
    assert "kalman" in out


@pytest.mark.parametrize(
    ("name", "links"),
    [
        ("demo.yaml", ["drive", "monitor"]),
        ("assembly.yaml", ["drive", "monitor"]),
        ("simulate.yaml", ["drive"]),
    ],
)
def test_check_of_what_is_shipped(cli, name, links):
    if name == "assembly.yaml" and not DATA.is_dir():
        pytest.skip("needs ../shared/data")
    status, out, err = cli("check", data_path(name), "--json")
    assert (status, err) == (0, "")
    data = json.loads(out)
    assert data["reaction_time_s"] == pytest.approx(sum(data["delay_budget_s"].values()))
    assert data["until_stopped_s"]["arm"] <= data["horizon_s"]
    assert [link["name"] for link in data["links"]] == links
    for link in data["links"]:
        assert link["load"] == pytest.approx(sum(link["details"].values()))
        assert 0 < link["load"] < 1
        assert link["spare"] >= 0


def test_check_in_words(cli, write):
    status, out, _ = cli("check", write())
    assert status == 0
    for part in (
        "controller: reaction_s",
        "T_r: reaction time, capture to braking",
        "stopping from full speed",
        "monitor",
        ": ok",
    ):
        assert part in out
