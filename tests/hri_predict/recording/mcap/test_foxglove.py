"""A recording of the node opens in Foxglove: its schemas by name, every message valid.

Oracles: the mcap library reads, jsonschema validates, and Foxglove's own message definitions
(foxglove-schemas-protobuf) say which fields there are and of which kind.
"""

import base64
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from mcap.reader import make_reader

from hri_predict.base.files import data_path
from hri_predict.recording import moment, read_messages, recording_info
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run
from hri_sim.baseline_demo import BASELINE

WELL_KNOWN = {
    "/view/scene": "foxglove.SceneUpdate",
    "/view/people": "foxglove.PosesInFrame",
    "/view/frames": "foxglove.FrameTransforms",
}


def _demo(folder: Path, **keys: Any) -> configuration.Config:
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    data["predictor"] = BASELINE
    file = folder / "press 4.yaml"
    file.write_text(yaml.safe_dump(data | keys), encoding="utf-8")
    return configuration.load(file).quiet()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Eight seconds of the demo, in which the person comes near."""
    folder = tmp_path_factory.mktemp("demo")
    run(_demo(folder), Options(factor=None, duration_s=8, record=folder / "a.mcap"))
    return folder / "a.mcap"


def _read(path: Path) -> Iterator[tuple[Any, Any, Any, Any]]:
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            yield schema, channel, message, json.loads(message.data)


@pytest.mark.long
def test_every_message_is_valid_by_its_schema(recorded):
    validators: dict[str, Any] = {}
    seen: dict[str, int] = {}
    for schema, channel, _, data in _read(recorded):
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert schema.name == WELL_KNOWN.get(channel.topic, schema.name)
        if channel.topic not in validators:
            text = json.loads(schema.data)
            jsonschema.Draft202012Validator.check_schema(text)
            validators[channel.topic] = jsonschema.Draft202012Validator(text)
        seen[channel.topic] = seen.get(channel.topic, 0) + 1
        if seen[channel.topic] % 7 == 1:  # the validator is slow
            validators[channel.topic].validate(data)
    own = {"/scene", "/received", "/status", "/advice/arm", "/node", "/clock", "/forecast"}
    assert seen.keys() == {*own, "/zones", "/sent", *WELL_KNOWN}
    assert 36 <= seen["/view/scene"] <= 44  # five per second


def test_every_schema_is_of_the_kind_that_foxglove_opens(recorded):
    """Each property of one type, objects with properties, lists of anything but lists."""
    scalar = {"boolean", "string", "number", "integer"}

    def opens(schema: dict[str, Any], at: str) -> None:
        assert schema["type"] == "object", at
        for name, field in schema["properties"].items():
            where = f"{at}.{name}"
            if "oneOf" in field:
                assert all(isinstance(each["const"], int) for each in field["oneOf"]), where
                continue
            inner = field["items"] if field["type"] == "array" else field
            assert isinstance(inner["type"], str), where  # "number or null" is refused
            if inner["type"] not in scalar:
                opens(inner, where)

    for schema, _, _, _ in _read(recorded):
        opens(json.loads(schema.data), schema.name)


def test_what_is_not_known_is_left_out_and_read_as_none(recorded):
    written = [data for _, channel, _, data in _read(recorded) if channel.topic == "/advice/arm"]
    told = [message.data for message in read_messages(recorded, ["/advice"])]
    assert not any(None in data.values() for data in written)
    assert "separation_m" not in written[0]
    assert all(len(data) == len(told[0]) for data in told)
    assert told[0]["separation_m"] is None
    for plain, filled in zip(written, told, strict=True):
        grounds = filled.pop("grounds")
        assert {k: v for k, v in filled.items() if v is not None} | (
            {} if grounds is None else {"grounds": plain["grounds"]}
        ) == plain


def test_a_line_joins_the_pair_that_the_advice_rests_on(recorded):
    pair_m: Any = None
    lengths: list[Any] = []
    for _, channel, _, data in _read(recorded):
        if channel.topic == "/advice/arm":
            pair_m = data.get("grounds", {}).get("pair_m")
        for entity in data.get("entities", ()):
            if entity["id"] == "separation arm":
                ends = [[point[k] for k in "xyz"] for point in entity["lines"][0]["points"]]
                lengths.append((math.dist(*ends), pair_m))
                shown_m = float(entity["texts"][0]["text"].partition(" m")[0])
                # rounded to a centimetre, and recorded to a millimetre
                assert shown_m == pytest.approx(max(0.0, pair_m), abs=0.0056)
    assert len(lengths) > 10
    for length, said_m in lengths:
        assert length == pytest.approx(abs(said_m), abs=0.002)  # both ends in millimetres


def _as_protobuf(data: Any) -> Any:
    """JSON of Foxglove as protobuf's own JSON: only times differ."""
    if isinstance(data, dict):
        if data.keys() == {"sec", "nsec"}:
            return f"1970-01-01T00:00:{data['sec'] % 60:02d}.{data['nsec']:09d}Z"
        found = {k: _as_protobuf(v) for k, v in data.items()}
        if "lifetime" in found:
            life = data["lifetime"]
            found["lifetime"] = f"{life['sec']}.{life['nsec']:09d}s"
        return found
    return [_as_protobuf(v) for v in data] if isinstance(data, list) else data


def test_well_known_messages_have_the_fields_of_foxglove(recorded):
    json_format = pytest.importorskip("google.protobuf.json_format")
    pytest.importorskip("foxglove_schemas_protobuf")
    from foxglove_schemas_protobuf import FrameTransforms_pb2, PosesInFrame_pb2, SceneUpdate_pb2

    kinds = {
        "foxglove.SceneUpdate": SceneUpdate_pb2.SceneUpdate,
        "foxglove.PosesInFrame": PosesInFrame_pb2.PosesInFrame,
        "foxglove.FrameTransforms": FrameTransforms_pb2.FrameTransforms,
    }
    checked = set()
    for schema, _, _, data in _read(recorded):
        if schema.name in kinds:  # an unknown field or another type raises
            message = json_format.ParseDict(_as_protobuf(data), kinds[schema.name]())
            if data.get("entities") != []:  # nobody is there yet
                assert message.ByteSize() > 0
            if schema.name not in checked:
                checked.add(schema.name)
                _same_fields(json.loads(schema.data), message.DESCRIPTOR)
    assert checked == set(kinds)


def _same_fields(schema: dict[str, Any], descriptor: Any) -> None:
    """The schema has the fields of the protobuf message, all the way down."""
    if descriptor.full_name in ("google.protobuf.Timestamp", "google.protobuf.Duration"):
        assert schema["properties"].keys() == {"sec", "nsec"}
        return
    assert schema["title"] == descriptor.full_name
    assert schema["properties"].keys() == {field.name for field in descriptor.fields}
    for field in descriptor.fields:
        part = schema["properties"][field.name]
        if part.get("type") == "array":
            part = part["items"]
        if field.message_type is not None:
            _same_fields(part, field.message_type)
        if field.enum_type is not None:
            values = {each["title"]: each["const"] for each in part["oneOf"]}
            assert values == {v.name: v.number for v in field.enum_type.values}


def test_the_picture_shows_people_zones_and_the_robot_in_the_colour_of_its_level(recorded):
    levels = {m.node_ns: m.data["level"] for m in read_messages(recorded, ["/advice/arm"])}
    for told in read_messages(recorded, ["/view/scene"]):
        entities = {each["id"]: each for each in told.data["entities"]}
        robot = entities.get("robot arm")
        if robot is not None and levels[told.node_ns] == "STOP":
            assert robot["spheres"][0]["color"]["r"] == pytest.approx(0xD7 / 255)
            assert "STOP 0.00 m/s" in robot["texts"][0]["text"]
            break
    else:
        pytest.fail("the robot was never stopped")
    last = {each["id"]: each for each in told.data["entities"]}
    assert len(last["person 1"]["lines"][0]["points"]) == 40  # 20 bones
    assert last["zone 1"]["cylinders"]
    x, y, z = (last["robot arm"]["spheres"][0]["pose"]["position"][k] for k in "xyz")
    assert max(abs(x), abs(y), abs(z)) < 0.5  # it begins at its base


def test_a_moment_tells_what_was_known_and_why(recorded):
    info = recording_info(recorded)
    assert (info.cell, info.robots[0][0]) == ("press_4", "arm")
    assert not info.has_utc  # a virtual run
    stops = [
        m for m in read_messages(recorded, ["/advice"]) if m.data["reason"] == "PERSON_APPROACHING"
    ]
    then = moment(recorded, stops[0].utc_ns)
    assert then.advice["arm"].data == stops[0].data
    grounds = then.advice["arm"].data["grounds"]
    assert grounds["person"] == 1
    assert grounds["robot_capsule"] in info.robots[0][1]
    total = sum(grounds["terms_m"].values())
    assert total == pytest.approx(grounds["protective_m"], abs=6e-4)  # six terms, each to 0.1 mm
    assert then.zones is not None
    assert then.scene is not None
    assert then.node is not None
    assert then.node.data["links"]["drive"]["connected"]
    assert then.node.data["node"]["scenes_in"] > 100
    assert then.status is not None
    assert then.status.data["people"] == 1
    assert then.received.keys() == {"drive", "monitor"}


def test_a_part_is_read_without_the_rest(recorded):
    whole = list(read_messages(recorded, ["/scene"]))
    start_ns, end_ns = whole[100].utc_ns, whole[150].utc_ns
    part = list(read_messages(recorded, ["/scene"], start_utc_ns=start_ns, end_utc_ns=end_ns))
    assert part == whole[100:150]


@pytest.mark.long
def test_two_virtual_runs_give_the_same_bytes_also_into_a_folder(tmp_path):
    found = []
    for run_number in (1, 2):
        cell = tmp_path / str(run_number)
        cell.mkdir()
        folder = cell / "kept"
        record = {"folder": "kept", "max_minutes": 0.05, "sent": True}
        options = Options(factor=None, duration_s=7)
        summary = run(_demo(cell, record=record), options)
        assert summary.recording is not None
        found.append({path.name: path.read_bytes() for path in folder.glob("*.mcap")})
        assert summary.recording["files"] == len(found[-1]) == 3
    assert found[0] == found[1]
    assert min(found[0]).startswith("press_4-19700101T000001Z")


@pytest.mark.long
def test_what_was_sent_is_left_out_of_folders_by_default(tmp_path):
    record = {"folder": "kept", "zones_hz": 0, "poses_hz": 1, "view_hz": 0}
    run(_demo(tmp_path, record=record), Options(factor=None, duration_s=5))
    (path,) = (tmp_path / "kept").glob("*.mcap")
    count: dict[str, int] = {}
    for message in read_messages(path):
        count[message.topic] = count.get(message.topic, 0) + 1
    assert not {"/sent", "/zones", "/view/scene", "/view/people"} & count.keys()
    assert count["/forecast"] <= 5
    assert count["/scene"] >= 140


def test_the_bytes_that_were_sent_are_there(recorded):
    sent = [m.data for m in read_messages(recorded, ["/sent"])]
    assert all(base64.b64decode(each["data"]) for each in sent)
    assert {each["link"] for each in sent} == {"drive", "monitor"}


def test_the_layout_shows_what_a_recording_has(recorded):
    text = (Path(__file__).parents[4] / "docs" / "foxglove-layout.json").read_text("utf-8")
    layout = json.loads(text)
    panels = layout["configById"]
    assert set(_leaves(layout["layout"])) == set(panels)
    fields: dict[str, dict[str, Any]] = {}
    for schema, channel, _, _ in _read(recorded):
        fields.setdefault(channel.topic, json.loads(schema.data)["properties"])
    shown = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert len(shown) >= 9
    for value in shown:
        topic, _, name = value.rpartition(".")
        assert name in fields[topic], value
    assert panels["3D!cell"]["topics"].keys() <= WELL_KNOWN.keys()
    assert panels["RawMessages!advice"]["topicPath"] in fields


def _leaves(split: Any) -> list[str]:
    return [split] if isinstance(split, str) else _leaves(split["first"]) + _leaves(split["second"])
