"""The JSON schema agrees with the node, judged by an independent validator."""

import copy

import jsonschema
import pytest
import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.cli.settings_page.schema import schema, undescribed
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.run import config as configuration

CELLS = sorted(path.name for path in data_path().glob("*.yaml"))


@pytest.fixture(scope="module")
def validator():
    found = schema()
    jsonschema.Draft7Validator.check_schema(found)
    return jsonschema.Draft7Validator(found)


def cell(name="demo.yaml"):
    return yaml.safe_load(data_path(name).read_text(encoding="utf-8"))


def test_cells_are_shipped():
    assert len(CELLS) >= 12


@pytest.mark.parametrize("name", CELLS)
def test_every_shipped_configuration_is_valid(validator, name):
    assert [error.message for error in validator.iter_errors(cell(name))] == []


# where, and the wrong value (... removes the key); the node refuses each of them, too
WRONG = [
    ([], "rat_hz", 25),
    ([], "rate_hz", "fast"),
    ([], "rate_hz", 1000),
    ([], "rate_hz", True),
    ([], "source", ...),
    ([], "robots", []),
    (["source"], "kind", ...),
    (["source"], "kind", "procedurall"),
    (["source"], "kind", "udp"),
    (["source"], "nois_m", 1),
    (["source"], "faults", [{"kind": "vanish", "pearson": 1}]),
    (["source"], "faults", [{"kind": "bit_errors"}]),
    (["source", "people", 0, "script", 0], "do", "fly"),
    (["source", "people", 0, "script", 0], "tu", [1, 2]),
    (["predictor"], "name", "oracle"),
    (["predictor"], "horizon", 1),
    (["robots", 0], "max_speed_m_s", -1),
    (["robots", 0], "max_speed_m_s", ...),
    (["robots", 0, "motion"], "kind", "dance"),
    (["robots", 0, "motion"], "stale", 1),
    (["robots", 0, "room_from_robot"], "xyz", [0, 0]),
    (["risk"], "mode", "bold"),
    (["links", 0], "kind", "canbus"),
    (["links", 0], "baudrat", 9600),
    (["links", 0], "baudrate", "quick"),
    (["links", 0], "interface", "slcan"),
    (["links", 0, "simulate"], "roll", "drive"),
    (["links", 1], "interface", ...),
    ([], "state", {"pth": "a"}),
    ([], "evidence", 3),
]


@pytest.mark.parametrize(("way", "key", "value"), WRONG, ids=str)
def test_what_the_node_refuses_the_schema_refuses(validator, tmp_path, way, key, value):
    data = copy.deepcopy(cell())
    block = data
    for part in way:
        block = block[part]
    if value is ...:
        del block[key]
    else:
        block[key] = value
    assert not validator.is_valid(data)
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(ConfigError):
        _build(configuration.load(path))


def test_faults_at_a_simulated_controller_are_those_of_a_link(validator):
    data = cell()
    data["links"][0]["simulate"]["faults"] = [{"kind": "drop", "probability": 0.1}]
    assert validator.is_valid(data)
    data["links"][0]["simulate"]["faults"] = [{"kind": "vanish"}]
    assert not validator.is_valid(data)


def _build(config):
    """Faults and simulated controllers are checked when they are built."""
    from hri_predict.cli.check.check import examine

    examine(config)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("state", "latches.json"),
        ("record", "monday.mcap"),
        ("record", {"folder": "kept", "keep_days": 7}),
        ("evidence", {"folder": "kept", "before_s": 2}),
        ("evidence", "kept"),
        ("discovery", {}),
        ("commissioning", "reports"),
        ("links", [{"name": "a", "kind": "can", "interface": "pcan", "channel": 0}]),
    ],
)
def test_what_the_node_accepts_the_schema_accepts(validator, tmp_path, key, value):
    data = cell() | {key: value}
    assert [error.message for error in validator.iter_errors(data)] == []
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    configuration.load(path)


def test_every_key_has_a_description():
    """Add ``description=`` to the ``Field`` of each key that is listed."""
    assert list(undescribed(schema())) == []


def test_a_key_without_description_is_found(monkeypatch):
    class Bare(PredictorSettings):
        strength: int = 3

    _register(monkeypatch, {"bare": Bare})
    assert list(undescribed(schema())) == ["predictors.bare.strength"]


def _register(monkeypatch, models):
    """A third party's predictors; a model of ``None`` cannot be imported."""
    names, load = registry.names, registry.load

    def loaded(kind, name):
        if kind != "predictors" or name not in models:
            return load(kind, name)
        if models[name] is None:
            raise ConfigError("predictor 'gone' needs a package that is not installed: gone")
        return type("Own", (), {"settings_model": models[name]})

    monkeypatch.setattr(
        registry, "names", lambda kind: names(kind) + (list(models) if kind == "predictors" else [])
    )
    monkeypatch.setattr(registry, "load", loaded)


def test_a_third_partys_part_has_its_own_keys(monkeypatch):
    class Own(PredictorSettings):
        strength: int = 3

    _register(monkeypatch, {"own": Own, "gone": None})
    theirs = jsonschema.Draft7Validator(schema())
    assert theirs.is_valid(cell() | {"predictor": {"name": "own", "strength": 4}})
    assert not theirs.is_valid(cell() | {"predictor": {"name": "own", "strenght": 4}})
    assert theirs.is_valid(cell() | {"predictor": {"name": "gone", "anything": 4}})
    assert not theirs.is_valid(cell() | {"predictor": {"name": "sinn", "strength": 4}})


def test_parts_of_this_package_are_ours():
    assert all(registry.is_ours("links", name) for name in ("can", "serial", "zenoh"))
