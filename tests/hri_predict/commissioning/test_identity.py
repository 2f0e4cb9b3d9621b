"""What a cell was: the same however it is written, and another after each change."""

import copy
import re
import shutil
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.commissioning import identity
from hri_predict.commissioning.identity import (
    MISSING,
    dependencies,
    differences,
    flattened,
    identity_of,
)
from hri_predict.contracts import registry
from hri_predict.run import config as configuration
from hri_predict.zones.calibration import shipped_calibration
from tests.hri_predict.commissioning.cells import cell_data, load_cell, write_cell


@pytest.fixture
def own(tmp_path):
    """A cell whose robot, trajectory and calibration are files of its own folder."""
    shutil.copy(data_path("robots", "ur5e.yaml"), tmp_path / "arm.yaml")
    shutil.copy(data_path("trajectories", "pick_and_place.yaml"), tmp_path / "cycle.yaml")
    shutil.copy(shipped_calibration("constant_velocity"), tmp_path / "mine.calibration.json")
    data = cell_data()
    data["robots"][0]["model"] = "arm.yaml"
    data["robots"][0]["motion"]["plan"] = "cycle.yaml"
    data["risk"]["coverage"] = {"calibration": "mine.calibration.json"}
    return write_cell(tmp_path, data)


def changed(path: Path, change) -> list[str]:
    """What differs after ``change`` of the configuration's data, or of a file beside it."""
    before = identity_of(configuration.load(path))
    data = yaml.safe_load(path.read_text())
    change(data)
    path.write_text(yaml.safe_dump(data))
    return [str(each) for each in differences(before, identity_of(configuration.load(path)))]


def append(path: Path, text: str = "\n# another\n"):
    def change(_data):
        with path.open("a") as file:
            file.write(text)

    return change


def put(*way):
    *keys, last, value = way

    def change(data):
        for key in keys:
            data = data[key]
        data[last] = value

    return change


TEN = {
    "the risk mode": (put("risk", "mode", "iso"), 'risk.mode: "predictive" -> "iso"'),
    "a margin": (
        put("risk", "person_uncertainty_m", 0.02),
        "risk.person_uncertainty_m: 0.05 -> 0.02",
    ),
    "the rate": (put("rate_hz", 50), "rate_hz: 25.0 -> 50.0"),
    "the robot's speed": (
        put("robots", 0, "max_speed_m_s", 1.2),
        "robots.arm.max_speed_m_s: 1.0 -> 1.2",
    ),
    "the robot's place": (
        put("robots", 0, "room_from_robot", "xyz", [0, 0.1, 0]),
        "robots.arm.room_from_robot.xyz: [0.0, 0.0, 0.0] -> [0.0, 0.1, 0.0]",
    ),
    "the sensor's place": (
        put("source", "room_from_source", "xyz", [0, 0, 0.1]),
        "source.room_from_source.xyz: [0.0, 0.0, 0.0] -> [0.0, 0.0, 0.1]",
    ),
    "a link's delay": (put("links", 1, "delay_s", 0.02), "links.monitor.delay_s: 0.005 -> 0.02"),
    "the predictor": (
        put("predictor", "span_s", 0.2),
        "predictor.span_s: 0.1 -> 0.2",
    ),
}


@pytest.mark.parametrize(("change", "line"), TEN.values(), ids=TEN.keys())
def test_a_changed_key_is_named_with_both_values(change, line, tmp_path):
    assert line in changed(write_cell(tmp_path), change)


def test_an_entry_that_is_gone_or_new_is_one_line(tmp_path):
    def removed(data):
        del data["links"][1]

    def renamed(data):
        data["links"][0]["name"] = "press"

    path = write_cell(tmp_path)
    assert changed(path, removed) == ['links: ["drive", "monitor"] -> ["drive"]']
    assert changed(path, renamed) == ['links: ["drive"] -> ["press"]']


def test_names_with_dots_hide_no_change():
    """Robot ``amr.base`` and the key ``base`` of robot ``amr`` are two things."""
    cells = [
        {"robots": [{"name": "amr", "base": {"m_s": fast}}, {"name": "amr.base", "m_s": 1.0}]}
        for fast in (1.0, 0.3)
    ]
    assert flattened(cells[0]) != flattened(cells[1])
    assert flattened({"a.b": 1}) != flattened({"a": {"b": 1}})


def test_a_change_is_told_though_another_entry_is_gone(tmp_path):
    data = cell_data()
    other = copy.deepcopy(data["robots"][0]) | {"name": "arm.left"}
    other["room_from_robot"] = {"xyz": [3, 0, 0]}
    data["robots"].append(other)

    def change(data):
        data["robots"][0]["name"] = "right"
        data["robots"][1]["max_speed_m_s"] = 0.25

    found = changed(write_cell(tmp_path, data), change)
    assert "robots.arm\\.left.max_speed_m_s: 1.0 -> 0.25" in found


def test_the_order_of_robots_counts_for_it_numbers_them(tmp_path):
    data = cell_data()
    other = copy.deepcopy(data["robots"][0]) | {"name": "other"}
    other["room_from_robot"] = {"xyz": [3, 0, 0]}
    data["robots"].append(other)
    found = changed(write_cell(tmp_path, data), lambda data: data["robots"].reverse())
    assert found == ['robots: ["arm", "other"] -> ["other", "arm"]']


def test_in_hybrid_the_calibration_is_watched_too(own):
    def touched(data):
        data["risk"]["mode"] = "hybrid"

    changed(own, touched)
    assert "risk.coverage.calibration" in identity_of(configuration.load(own)).files


@pytest.mark.parametrize(
    ("file", "key"),
    [
        ("arm.yaml", "robots.arm.model"),
        ("cycle.yaml", "robots.arm.motion.plan"),
        ("mine.calibration.json", "risk.coverage.calibration"),
    ],
)
def test_a_changed_file_is_named_with_its_key(file, key, own):
    text = "\n" if file.endswith("json") else "\n# another\n"
    (line,) = changed(own, append(own.parent / file, text))
    assert line.startswith(f"file of {key} ({file}): SHA-256 ")


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (put("robots", 0, "model", "ur6"), "robots.0.model"),
        (put("robots", 0, "motion", "plan", "nowhere"), "robots.0.motion.plan"),
        (put("links", 0, "simulate", "trajectory", "nowhere"), "links.0.simulate.trajectory"),
    ],
)
def test_an_unknown_name_is_told_with_file_line_and_key(tmp_path, change, key):
    data = cell_data()
    change(data)
    config = load_cell(tmp_path, data)
    with pytest.raises(
        ConfigError, match=rf"{re.escape(str(config.path))}:\d+: {key}: unknown"
    ) as e:
        identity_of(config)
    assert "\n" not in str(e.value)


def test_weights_and_a_joint_map_and_any_other_named_file_are_watched(tmp_path):
    (tmp_path / "people.npz").write_bytes(b"1")
    shutil.copy(data_path("skeletons", "coco17.yaml"), tmp_path / "mine.yaml")
    data = cell_data(predictor={"name": "sinn", "horizon_s": 1.2})
    data["source"]["joint_map"] = "mine.yaml"
    data["links"][0]["simulate"]["trajectory"] = "pick_and_place"
    found = identity_of(load_cell(tmp_path, data))
    assert found.files["source.joint_map"].path == str(tmp_path / "mine.yaml")
    assert found.files["predictor.weights"].path.endswith("sinn.safetensors")
    assert "links.drive.simulate.trajectory" in found.files
    data["source"]["joint_map"] = "coco17"
    shipped = identity_of(load_cell(tmp_path, data)).files["source.joint_map"]
    assert shipped.path == str(data_path("skeletons", "coco17.yaml"))


def test_files_that_the_node_writes_and_keys_are_not(tmp_path):
    for name in ("alerts.jsonl", "day.mcap", "state.json", "scene.key"):
        (tmp_path / name).write_text("x")
    (tmp_path / "hook.token").write_text("secret")
    hook = {"kind": "webhook", "url": "https://localhost/", "token_file": "hook.token"}
    data = cell_data(
        alerts={"file": "alerts.jsonl", "to": [hook]},
        record="day.mcap",
        state={"path": "state.json"},
    )
    data["source"] = {
        "kind": "udp",
        "room_from_source": {"xyz": [0, 0, 0]},
        "rate_hz": 30,
        "key_file": "scene.key",
    }
    found = identity_of(load_cell(tmp_path, data)).files
    paths = {file.path for file in found.values()}
    assert not [path for path in paths if path.startswith(str(tmp_path))]
    assert not [key for key in found if key.startswith("alerts.")]


def test_how_it_is_written_makes_no_difference(tmp_path):
    path = write_cell(tmp_path)
    before = identity_of(configuration.load(path))
    data = yaml.safe_load(path.read_text())
    turned = dict(reversed(list(data.items())))
    turned |= {"rate_hz": 25.0, "commissioning": "somewhere"}
    path.write_text("# a comment\n" + yaml.safe_dump(turned, sort_keys=False))
    after = identity_of(configuration.load(path))
    assert differences(before, after) == []
    assert before.hash == after.hash


def test_another_version_and_a_missing_file_are_named(tmp_path):
    now = identity_of(load_cell(tmp_path))
    then = now.model_copy(update={"versions": now.versions | {"hri-predict": "0.0.1"}})
    (line,) = map(str, differences(then, now))
    assert line.startswith("version of hri-predict: 0.0.1 -> ")
    key = next(iter(now.files))
    gone = now.files[key].model_copy(update={"sha256": MISSING})
    (line,) = map(str, differences(now, now.model_copy(update={"files": now.files | {key: gone}})))
    assert line.endswith("-> missing")


def test_a_change_deep_in_a_long_value_is_not_hidden(tmp_path):
    polygon = [[-6, -6], [6, -6], [6, 6], [0, 6.5], [-1, 6.4], [-2, 6.3], [-3, 6.2], [-6, 6]]
    data = cell_data()
    data["people"]["exits"] = [{"polygon": polygon}]
    before = identity_of(load_cell(tmp_path, data))
    polygon[-1] = [-6, 6.01]
    (found,) = differences(before, identity_of(load_cell(tmp_path, data)))
    assert found.old != found.new


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text("ab.\\", min_size=1, max_size=3), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(plain, plain)
def test_only_equal_data_is_equal_when_flat(a, b):
    assert (flattened({"x": a}) == flattened({"x": b})) == (a == b)


def test_changed_code_of_a_third_party_is_a_difference(own, monkeypatch):
    codes = {"predictors": "1a"}
    monkeypatch.setattr(registry, "code_of", lambda settings: codes["predictors"])
    monkeypatch.setattr(registry, "code_of_part", lambda kind, name: codes.get(kind))
    before = identity_of(configuration.load(own))
    codes |= {"predictors": "1b", "sources": "2"}
    found = [str(each) for each in differences(before, identity_of(configuration.load(own)))]
    assert found == [
        "version of the code of predictor 'constant_velocity': 1a -> 1b",
        "version of the code of source 'procedural': (none) -> 2",
    ]


def two_sensors(**of_front):
    """A cell with two sensors."""
    sensor = {"kind": "udp", "room_from_source": {"xyz": [0, 0, 0]}, "rate_hz": 30}
    sensors = {"back": sensor | {"port": 9870}, "front": sensor | {"port": 9872} | of_front}
    return cell_data(source={"kind": "merged", "sensors": sensors})


def test_changed_code_of_one_of_several_sensors_is_a_difference(tmp_path, monkeypatch):
    codes: dict[str, str | None] = {"udp": None}
    monkeypatch.setattr(registry, "code_of_part", lambda kind, name: codes.get(name))
    config = load_cell(tmp_path, two_sensors())
    before = identity_of(config)
    codes["udp"] = "2"
    found = [str(each) for each in differences(before, identity_of(config))]
    assert found == ["version of the code of source 'udp': (none) -> 2"]


def test_the_joint_map_of_one_of_several_sensors_is_watched(tmp_path):
    files = identity_of(load_cell(tmp_path, two_sensors(joint_map="coco17"))).files
    shipped = str(data_path("skeletons", "coco17.yaml"))
    assert files["source.sensors.front.joint_map"].path == shipped
    (tmp_path / "mine.yaml").write_bytes(Path(shipped).read_bytes())
    files = identity_of(load_cell(tmp_path, two_sensors(joint_map="mine.yaml"))).files
    assert files["source.sensors.front.joint_map"].path == str(tmp_path / "mine.yaml")


def test_how_one_of_several_sensors_is_written_makes_no_difference(tmp_path):
    before = identity_of(load_cell(tmp_path, two_sensors()))
    same = two_sensors(min_latency_s=0, room_from_source={"xyz": [0.0, 0.0, 0.0]})
    assert differences(before, identity_of(load_cell(tmp_path, same))) == []
    moved = two_sensors(room_from_source={"xyz": [0, 0, 0.1]})
    assert [str(each) for each in differences(before, identity_of(load_cell(tmp_path, moved)))] == [
        "source.sensors.front.room_from_source.xyz: [0.0, 0.0, 0.0] -> [0.0, 0.0, 0.1]"
    ]


@pytest.mark.parametrize("library", ["numba", "llvmlite", "numpy"])
def test_a_library_that_computes_advice_is_watched_also_if_absent(library, monkeypatch):
    real = identity.version

    def without(name):
        if name == library:
            raise PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(identity, "version", without)
    assert identity.versions()[library] == MISSING
    monkeypatch.setattr(identity, "version", lambda name: "1")
    assert identity.versions()[library] == "1"


def test_whether_loops_are_compiled_is_watched(monkeypatch):
    for why, compiled in (("numba is not installed", "no"), ("", "yes")):
        monkeypatch.setattr(identity, "why_not_compiled", lambda why=why: why)
        assert identity.versions()["compiled loops"] == compiled


def test_files_of_the_current_folder_do_not_count(tmp_path, monkeypatch):
    """Texts such as a robot's name may be the names of files where ``check`` is run."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "else").mkdir()
    path = write_cell(tmp_path / "cell")
    before = identity_of(configuration.load(path))
    (tmp_path / "else" / cell_data()["robots"][0]["name"]).write_text("x")
    monkeypatch.chdir(tmp_path / "else")
    assert differences(before, identity_of(configuration.load(path))) == []


@pytest.mark.parametrize("found", [MISSING, "unreadable: Permission denied"])
def test_a_file_that_cannot_be_read_is_never_taken_as_unchanged(tmp_path, found):
    now = identity_of(load_cell(tmp_path))
    key = next(iter(now.files))
    gone = now.files | {key: now.files[key].model_copy(update={"sha256": found})}
    unread = now.model_copy(update={"files": gone})
    (line,) = map(str, differences(unread, unread))
    assert line.endswith(f": {found} -> {found}")
    (line,) = map(str, differences(now, unread))
    assert re.search(rf": SHA-256 [0-9a-f]{{12}} -> {found}$", line)


def test_files_in_a_list_are_watched(tmp_path):
    (tmp_path / "a.bin").write_text("x")
    config = load_cell(tmp_path)
    flat = {"source.maps": ["none", ["a.bin"]], "source.weights": "a.bin"}
    found = dependencies(config, flat)
    for key in ("source.maps.1.0", "source.weights"):
        assert found[key] == tmp_path / "a.bin"
    assert "source.maps.0" not in found
