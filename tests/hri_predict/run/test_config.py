"""The configuration: every mistake is one line that names the place and the remedy."""

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from hri_drivers.wires.transport import PipeEnd, pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.run import assemble
from hri_predict.run import config as configuration

ZONE = {"polygon": [[0, 0], [1, 0], [1, 1]]}
DEMO = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))


def put(data, path, value):
    *way, last = path
    for part in way:
        data = data[part]
    if value is ...:
        del data[last]
    else:
        data[last] = value


def mistake(tmp_path, text):
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        configuration.load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert "cell.yaml" in message
    return message


# where, the wrong value (... removes the key), what the line must name
MISTAKES = [
    (["rate_hz"], 0, ["rate_hz", "greater than"]),
    (["rate_hz"], -25, ["rate_hz", "greater than"]),
    (["rate_hz"], 1000, ["rate_hz", "100"]),
    (["rate_hz"], "fast", ["rate_hz", "number", "'fast'"]),
    (["rate_hz"], float("nan"), ["rate_hz"]),
    (["rate_hz"], float("inf"), ["rate_hz"]),
    (["rat_hz"], 25, ["rat_hz", "unknown key", "did you mean 'rate_hz'?"]),
    (["source"], ..., ["source", "missing"]),
    (["source"], "procedural", ["source", "block of settings"]),
    (["source"], None, ["source"]),
    (["source", "kind"], ..., ["source.kind", "procedural", "recording"]),
    (["source", "kind"], 3, ["source.kind", "procedural"]),
    (["source", "kind"], "procedurall", ["source.kind", "did you mean 'procedural'?"]),
    (["source", "noise_m"], -1, ["source", "noise_m"]),
    (["source", "nois_m"], 1, ["nois_m", "did you mean 'noise_m'?"]),
    (["source", "people", 0, "script", 0, "do"], "fly", ["source", "script", "fly"]),
    (["source", "people", 0, "heigth_m"], 1.8, ["heigth_m", "did you mean 'height_m'?"]),
    (["predictor", "name"], ..., ["predictor.name", "constant_velocity"]),
    (["predictor", "name"], "oracle", ["predictor.name", "oracle", "kalman", "zero_velocity"]),
    (["predictor", "horizon"], 1, ["predictor", "horizon", "did you mean 'horizon_s'?"]),
    (["predictor", "horizon_s"], 0, ["predictor", "horizon_s"]),
    (["people", "exits", 0, "polygon"], [[0, 0], [1, 1]], ["people.exits.0.polygon"]),
    (["people", "absent_parts"], ["tail"], ["people.absent_parts.0", "left_leg"]),
    (["robots"], [], ["robots", "at least 1"]),
    (["robots"], ..., ["robots", "missing"]),
    (["robots", 0, "room_from_robot"], ..., ["robots.0", "give either room_from_robot"]),
    (["robots", 0, "room_from_robot", "quaternion_xyzw"], [0, 0, 0, 2], ["unit quaternion"]),
    (["robots", 0, "max_speed_m_s"], -1, ["robots.0.max_speed_m_s"]),
    (["robots", 0, "motion", "kind"], "dance", ["robots.0.motion", "dance", "standing"]),
    (["robots", 0, "motion", "stale"], 1, ["stale", "did you mean 'stale_s'?"]),
    (["risk", "mode"], "bold", ["risk.mode", "iso", "predictive", "reactive", "fixed"]),
    (["risk", "mod"], "iso", ["risk.mod", "did you mean 'mode'?"]),
    (["links", 0, "kind"], "canbus", ["links.0.kind", "serial", "can"]),
    (["links", 0, "baudrate"], "quick", ["links.0", "baudrate", "'quick'"]),
    (["links", 0, "baudrat"], 9600, ["links.0", "did you mean 'baudrate'?"]),
    (["links", 1, "interface"], "socketcann", ["links.1", "socketcan"]),
    (["links", 1, "bitrate"], 0, ["links.1", "bitrate"]),
    (["links", 0, "robots"], ["armm"], ["links.0.robots", "did you mean 'arm'?"]),
    (["links", 1, "name"], "drive", ["links", "'drive'", "twice"]),
    (["alerts"], {"comand": ["x"]}, ["alerts.comand", "did you mean 'command'?"]),
    (["zones"], [{"name": "door"}], ["zones.0", "missing"]),
    (["zones"], [ZONE | {"name": f"z{i}"} for i in range(33)], ["zones", "at most 32"]),
    (["record"], 5, ["record", "string"]),
]

ZONE = {"polygon": [[0, 0], [1, 0], [1, 1]]}


@pytest.mark.parametrize(("where", "value", "named"), MISTAKES, ids=str)
def test_each_mistake_is_one_line(tmp_path, where, value, named):
    data = copy.deepcopy(DEMO)
    put(data, where, value)
    message = mistake(tmp_path, yaml.safe_dump(data))
    for part in named:
        assert part in message


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "keys and values"),
        ("- a\n- b\n", "found list"),
        ("rate_hz: [1, 2\nsource: x", "not valid YAML at line"),
        ("rate_hz: &a [*a]", "line 1"),
        ("\t rate_hz: 3", "not valid YAML at line 1"),
        ("[" * 1500, "not valid YAML"),
    ],
    ids=["empty", "list", "unclosed", "recursive", "tab", "deep"],
)
def test_what_is_no_configuration_is_one_line(tmp_path, text, named):
    assert named in mistake(tmp_path, text)


def test_what_is_no_text_is_one_line(tmp_path):
    (tmp_path / "cell.yaml").write_bytes(b"rate_hz: \xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8"):
        configuration.load(tmp_path / "cell.yaml")


def test_a_missing_file_is_told_what_is_shipped(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ConfigError, match=r"did you mean 'demo.yaml'.*name one of the \d+ in .*, such as demo.yaml"
    ):
        configuration.load(tmp_path / "dmo.yaml")
    with pytest.raises(ConfigError, match="is a folder"):
        configuration.load(tmp_path)
    (tmp_path / "configs").mkdir()
    with pytest.raises(ConfigError, match="no such file"):  # never another of the same name
        configuration.load(tmp_path / "demo.yaml")


@pytest.mark.parametrize("name", ["demo.yaml", "assembly.yaml", "simulate.yaml"])
def test_shipped_configurations_load_by_name_from_anywhere(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    config = configuration.load(configuration.find(data_path(name)))
    assert config.text.startswith("#")
    assert config.links[0].name == "drive"


def test_a_users_own_file_goes_before_the_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demo.yaml").write_text(yaml.safe_dump(DEMO | {"rate_hz": 50}))
    assert configuration.load(Path("demo.yaml")).node.rate_hz == 50
    assert configuration.load(Path("configs/demo.yaml")).node.rate_hz == 25


def test_yaml_says_nothing_of_the_default_predictor_but_it_is_there(tmp_path):
    data = {k: v for k, v in DEMO.items() if k not in ("predictor", "links")}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(data))
    config = configuration.load(tmp_path / "cell.yaml")
    assert config.predictor.name == "constant_velocity"
    assert config.links == ()


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("dorp@1+1", "drop"),
        ("drop@x+1", "drop"),
        ("drop@1+1:probabilty=0.5", "probability"),
        ("nolink:drop@1+1", "nolink"),
        ("drive:nan@1+1", "nan"),
        ("drive:drop@1+1:probability=2", "probability"),
    ],
)
def test_a_wrong_fault_is_one_line(fault, named):
    with pytest.raises(ConfigError) as caught:
        build_with(fault)
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def build_with(fault):
    faulty = configuration.load(data_path("demo.yaml")).with_faults([fault])
    transports: dict[str, PipeEnd[Any]] = {link.name: pipe()[0] for link in faulty.links}
    assemble.build(faulty, VirtualClock(0), transports=transports)


def test_faults_go_where_they_are_put():
    config = configuration.load(data_path("demo.yaml"))
    faulty = config.with_faults(["drop@1+2", "monitor:freeze@3+1"])
    assert len(faulty.source.faults) == 1
    assert [len(link.faults) for link in faulty.links] == [0, 1]
    assert not config.source.faults


@pytest.mark.parametrize("text", ["foo:vanish@1+1", "foo:vanish", "drve:drop:probability=0.5"])
def test_a_fault_of_a_link_that_is_not_there_names_those_there_are(text):
    config = configuration.load(data_path("demo.yaml"))
    with pytest.raises(ConfigError, match=r"no link '(foo|drve)'.*available: drive, mon"):
        config.with_faults([text])


def test_two_zones_of_one_name_are_refused(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(DEMO | {"zones": [ZONE | {"name": "door"}] * 2}))
    config = configuration.load(path)
    wires: dict[str, PipeEnd[Any]] = {link.name: pipe()[0] for link in config.links}
    with pytest.raises(ConfigError, match="zones: two zones are named 'door'"):
        assemble.build(config, VirtualClock(), transports=wires)
