"""What ``check --listen`` advises is done, and then people stand and are of human size."""

import json
import re
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hri_drivers.sources.scene_json.json_source import JsonSettings, JsonSource
from hri_drivers.sources.scene_json.websocket_source import WebSocketSettings, WebSocketSource
from hri_predict.base.geometry import transform
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.check import sensor
from hri_predict.contracts.joint_map import METRES_PER_UNIT, axes_rotation
from hri_predict.people.body.axes import all_axes
from hri_sim.baseline_demo import baseline_demo
from hri_sim.people.body import Body

_WHO = Body(1.75)
POSE = Pose(xyz=[0.4, -0.2, 1.1], quaternion_xyzw=[0.0, 0.13, 0.0, 0.9915])
BODY: Any = _WHO.joints(_WHO.standing(np.array([2.5, 0.6]), 2.0))
FROM_ROOM: Any = np.linalg.inv(POSE.matrix())
SEEN = transform(FROM_ROOM, BODY)  # in the sensor's frame: metres, z up
KINDS: dict[str, Any] = {
    "json": (JsonSettings, JsonSource),
    "websocket": (WebSocketSettings, WebSocketSource),
}
CAPTURES = 20


class Sensor:
    """A source that is fed instead of opened; see ``hri_predict.cli.register.sight.Sensor``."""

    captured_ns = arrived_ns = ()

    def __init__(self, source, lines):
        self.source, self._lines = source, lines

    def everybody(self, seconds):
        bodies = []
        for line in self._lines:
            self.source._hear(line)
            (person,) = self.source.poll(self.source.next_ns()).people
            bodies.append(self.source.joint_map.map(person.positions, person.observed))
        return {1: tuple(map(np.array, zip(*bodies, strict=True)))}, len(bodies)


@pytest.fixture(params=KINDS)
def heard(request, monkeypatch):
    """What ``--listen`` finds where a sender states these units and axes."""
    settings, make = KINDS[request.param]
    values = {
        "kind": request.param,
        "rate_hz": 30.0,
        "joint_map": "canonical",
        "room_from_source": POSE.model_dump(),
    }
    if request.param == "websocket":
        values["url"] = "ws://127.0.0.1:9"
    config = baseline_demo()
    config = replace(config, source=settings.model_validate(values))

    def call(raw, units, axes, left_handed=False):
        people = [{"id": 1, "joints": dict(zip(JOINTS, raw.tolist(), strict=True))}]
        scene = {
            "format": "hri-scene/1",
            "sees_room": True,
            "units": units,
            "axes": list(axes),
            "left_handed": left_handed,
            "people": people,
        }
        lines = [
            json.dumps(scene | {"sequence": k, "stamp_s": k / 30}).encode() for k in range(CAPTURES)
        ]

        @contextmanager
        def fed(source):
            yield Sensor(make(settings.model_validate(values)), lines)

        monkeypatch.setattr(sensor, "opened", fed)
        monkeypatch.setattr(sensor.assemble, "build_source", lambda config: None)
        return sensor.listen(config, 1.0)

    return call


@pytest.mark.parametrize("declared", [["x", "y", "z"], ["z", "-x", "-y"], ["z", "x", "y"]])
@pytest.mark.parametrize("true", [axes for axes, _ in all_axes(1.0)][::3], ids=",".join)
def test_axes_for_a_sender_that_states_other_ones(heard, declared, true):
    raw = SEEN @ axes_rotation(true)
    found = heard(raw, "m", declared)
    if not found["refused"]:
        return  # only the heading is wrong: no body shows that
    named = re.search(r"axes: \[(.+?)\] in each scene that the sender writes", found["remedy"])
    assert named is not None, found["remedy"]
    again = heard(raw, "m", named[1].split(", "))
    assert (again["refused"], again["judged"]) == ([], 1)


@pytest.mark.parametrize("declared", [["x", "y", "z"], ["z", "x", "y"]])
@pytest.mark.parametrize("true", [axes for axes, _ in all_axes(-1.0)][::5], ids=",".join)
def test_left_handed_senders(heard, declared, true):
    raw = SEEN @ axes_rotation(true, left_handed=True)
    found = heard(raw, "m", declared)
    named = re.search(r"axes: \[(.+?)\] with left_handed: true into each scene", found["remedy"])
    assert named is not None, found["remedy"]
    again = heard(raw, "m", named[1].split(", "), left_handed=True)
    assert (again["refused"], again["judged"]) == ([], 1)


@pytest.mark.parametrize("declared", ["m", "mm"])
@pytest.mark.parametrize("true", ["m", "mm", "cm", "inch", "ft"])
def test_units(heard, declared, true):
    raw = SEEN / METRES_PER_UNIT[true]
    if np.abs(raw).max() * METRES_PER_UNIT[declared] > 900:  # beyond any room: refused as such
        raw = raw - [raw[0, 0], raw[0, 1], 0]
    found = heard(raw, declared, ["x", "y", "z"])
    if true == declared:
        assert found["refused"] == []
        return
    assert found["refused"] == ["not of human size"]
    if factor := re.search(
        r"multiply its coordinates by (\S+) and state units: m", found["remedy"]
    ):
        again = heard(raw * float(factor[1]), "m", ["x", "y", "z"])
    else:
        assert f"units: {true} instead of {declared}; let the sender state it" in found["remedy"]
        again = heard(raw, true, ["x", "y", "z"])
    assert "not of human size" not in again["refused"]


def found(pattern, text):
    match = re.search(pattern, text)
    assert match is not None, text
    return match[1]


@pytest.mark.parametrize("height", [-0.6, 1.5])
def test_height(heard, height):
    raw = transform(FROM_ROOM, BODY + np.array([0, 0, height]))
    remedy = heard(raw, "m", ["x", "y", "z"])["remedy"]
    xyz = json.loads(found(r"room_from_source.xyz: (\[.+?\]) puts them", remedy))
    assert xyz == pytest.approx([0.4, -0.2, 1.1 - height], abs=0.05)  # ankles are at 7 to 9 cm
    floor_m = float(found(r"people.floor_m, if it is (\S+)", remedy))
    assert floor_m == pytest.approx(height, abs=0.05)
