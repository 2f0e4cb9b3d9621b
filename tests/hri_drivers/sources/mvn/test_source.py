"""MVN's stream over real sockets, from a sender written from the specification."""

import socket
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts import registry
from hri_predict.contracts.scene import Scene
from hri_sim.people.body import Body
from hri_sim.senders import mvn as mvn_sender

pytestmark = pytest.mark.realtime

Hear = Callable[..., Any]
_BODY = Body(1.75)


def joints_at(x: float, y: float) -> Floats:
    """(21, 3) of somebody who stands there, facing x."""
    return _BODY.joints(_BODY.standing(np.array([x, y]), 0.0))


def mvn_at(x: float, y: float) -> Floats:
    return mvn_sender.segments_of(joints_at(x, y))


class Mvn:
    """MVN's end of the line."""

    def __init__(self, port: int, tcp: bool = False, host: str = "127.0.0.1") -> None:
        kind = socket.SOCK_STREAM if tcp else socket.SOCK_DGRAM
        self._socket = socket.socket(socket.AF_INET, kind)
        self._socket.bind((host, 0))
        self._socket.connect(("127.0.0.1", port))

    def send(self, *datagrams: bytes) -> None:
        for data in datagrams:
            self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


def canonical(ear: Any, scene: Scene, number: int) -> dict[str, Floats]:
    """Canonical joints of a person, in the room."""
    (person,) = [p for p in scene.people if p.id == number]
    joints, observed = ear.source.joint_map.map(person.positions, person.observed)
    return {
        name: joint
        for name, joint, seen in zip(CANONICAL.joints, joints, observed, strict=True)
        if seen
    }


@pytest.mark.parametrize("protocol", ["udp", "tcp"])
def test_two_people_in_the_room(hear: Hear, protocol: str) -> None:
    # MVN's origin is at (10, 20) in the room, and its x points along the room's y
    turned = {"xyz": [10, 20, 0], "quaternion_xyzw": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]}
    ear = hear("mvn", port=0, protocol=protocol, sees_room=True, room_from_source=turned)
    mvn = Mvn(ear.port, protocol == "tcp")
    for sample in (1, 2):
        for character, place in ((0, (1.0, 2.0)), (5, (3.0, 0.0))):
            mvn.send(*mvn_sender.quaternions(sample, 1000 * sample, character, mvn_at(*place)))
        mvn.send(mvn_sender.meta_data(sample, 1000 * sample, 0, "Ann"))
    first, second = ear.scenes(2)
    assert [p.id for p in first.people] == [0]  # it knew nobody else yet
    assert [p.id for p in second.people] == [0, 5]
    assert second.sees_room
    assert (second.stamp_ns, second.sequence - first.sequence) == (2_000_000_000, 1)
    found = canonical(ear, second, 0)
    (hip,) = joints_at(1.0, 2.0)[[CANONICAL.index("l_hip")]]
    np.testing.assert_allclose(found["l_hip"], [10 - hip[1], 20 + hip[0], hip[2]], atol=1e-5)
    assert {"head_top", "l_hand", "r_hand"}.isdisjoint(found)  # MVN does not send them
    assert len(found) == 18
    ear.wait(lambda: ear.counters.ignored == 2)
    mvn.close()


def test_every_joint_is_where_mvn_has_it(hear: Hear) -> None:
    """Each segment's origin is its proximal joint; right and left are not mistaken."""
    ear = hear("mvn", port=0, sees_room=True)
    Mvn(ear.port).send(*mvn_sender.quaternions(1, 10, 0, mvn_at(1.0, 2.0)))
    found = canonical(ear, ear.scene(), 0)
    true = joints_at(1.0, 2.0)
    for name, joint in found.items():
        np.testing.assert_allclose(joint, true[CANONICAL.index(name)], atol=1e-5, err_msg=name)


def test_euler_angles_centimetres_and_y_up_are_the_same_person(hear: Hear) -> None:
    ear = hear("mvn", port=0, sees_room=True, type="euler")
    Mvn(ear.port).send(*mvn_sender.eulers(1, 10, 0, mvn_at(1.0, 2.0)))
    found = canonical(ear, ear.scene(), 0)
    wanted = joints_at(1.0, 2.0)[CANONICAL.index("r_knee")]
    np.testing.assert_allclose(found["r_knee"], wanted, atol=1e-5)


def test_axes_are_configured_where_mvn_streams_y_up(hear: Hear) -> None:
    """MVN's y-up option of type 02: x forward, y up, z to the right."""
    ear = hear("mvn", port=0, sees_room=True, axes=["x", "-z", "y"])
    there = mvn_at(1.0, 2.0)
    yup = np.column_stack([there[:, 0], there[:, 2], -there[:, 1]])
    Mvn(ear.port).send(*mvn_sender.quaternions(1, 10, 0, yup))
    found = canonical(ear, ear.scene(), 0)
    np.testing.assert_allclose(
        found["r_knee"], joints_at(1.0, 2.0)[CANONICAL.index("r_knee")], atol=1e-5
    )


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_wrong_units_do_not_see_the_room(hear: Hear, scale: float) -> None:
    ear = hear("mvn", port=0, sees_room=True)
    Mvn(ear.port).send(*mvn_sender.quaternions(1, 10, 0, mvn_at(1.0, 2.0) * scale))
    assert not ear.scene().sees_room
    assert "correct 'units'" in ear.counters.last_error


def test_without_a_suit_for_everybody_the_room_is_not_seen(hear: Hear) -> None:
    ear = hear("mvn", port=0, sees_room=False)
    Mvn(ear.port).send(*mvn_sender.quaternions(1, 10, 0, mvn_at(1.0, 2.0)))
    scene = ear.scene()
    assert not scene.sees_room
    assert len(scene.people) == 1


def test_fewer_samples_streamed_than_taken_are_counted_one_by_one(hear: Hear) -> None:
    ear = hear("mvn", port=0, sees_room=True, sample_rate_hz=240, stamp="sample_counter")
    mvn = Mvn(ear.port)
    for sample in (1002, 1006, 1014):
        mvn.send(*mvn_sender.quaternions(sample, 0, 0, mvn_at(1.0, 2.0)))
    first, second, third = ear.scenes(3)
    assert second.sequence - first.sequence == 1
    assert third.sequence - second.sequence == 2
    assert round((second.stamp_ns - first.stamp_ns) / 1e6, 3) == 16.667
    assert ear.counters.lost == 1


def test_a_recording_that_begins_anew_is_a_restart(hear: Hear) -> None:
    ear = hear("mvn", port=0, sees_room=True)
    mvn = Mvn(ear.port)
    for sample in (9000, 9001, 0, 1):
        mvn.send(*mvn_sender.quaternions(sample, sample * 16, 0, mvn_at(1.0, 2.0)))
    heard = ear.scenes(4)
    numbers = [scene.sequence - heard[0].sequence for scene in heard]
    assert numbers == [0, 1, 2, 3]
    assert ear.counters.restarts == 1


def test_the_wrong_stream_says_what_to_tick(hear: Hear) -> None:
    ear = hear("mvn", port=0, sees_room=True)
    Mvn(ear.port).send(*mvn_sender.eulers(1, 10, 0, mvn_at(0.0, 0.0)), b"noise")
    ear.wait(lambda: ear.counters.malformed == 1)
    Mvn(ear.port).send(*mvn_sender.eulers(2, 20, 0, mvn_at(0.0, 0.0)))
    ear.wait(lambda: ear.counters.ignored == 2)
    assert "select Position + Orientation (Quaternion)" in ear.counters.last_error


def test_mvn_comes_back_over_tcp(hear: Hear) -> None:
    ear = hear("mvn", port=0, protocol="tcp", sees_room=True)
    mvn = Mvn(ear.port, tcp=True)
    (data,) = mvn_sender.quaternions(1, 10, 0, mvn_at(0.0, 0.0))
    mvn.send(data, mvn_sender.quaternions(2, 20, 0, mvn_at(0.0, 0.0))[0][:100])
    ear.scene()
    mvn.close()  # in the middle of a datagram
    ear.wait(lambda: ear.counters.disconnects == 1)
    Mvn(ear.port, tcp=True).send(*mvn_sender.quaternions(3, 30, 0, mvn_at(0.0, 0.0)))
    ear.scene()
    assert ear.counters.reconnects == 1
    assert ear.counters.malformed == 0


def test_a_second_machine_is_refused_and_hides_the_room(hear: Hear) -> None:
    try:
        socket.create_server(("127.0.0.2", 0)).close()
    except OSError:
        pytest.skip("this system has no 127.0.0.2")
    ear = hear("mvn", port=0, sees_room=True)
    mvn, other = Mvn(ear.port), Mvn(ear.port, host="127.0.0.2")
    mvn.send(*mvn_sender.quaternions(1, 10, 0, mvn_at(1.0, 2.0)))
    assert ear.scene().sees_room
    other.send(*mvn_sender.quaternions(9000, 90_000, 0, mvn_at(3.0, 0.0)))
    ear.wait(lambda: ear.counters.refused == 1)
    assert "two programs send to this port" in ear.counters.last_error
    another_port = Mvn(ear.port)  # for another person of the same MVN
    another_port.send(*mvn_sender.quaternions(2, 20, 0, mvn_at(1.0, 2.0)))
    scene = ear.scene()
    assert not scene.sees_room
    assert scene.stamp_ns == 20_000_000
    assert (ear.counters.refused, ear.counters.restarts) == (1, 0)


def test_over_tcp_a_second_machine_hides_the_room(hear: Hear) -> None:
    try:
        socket.create_server(("127.0.0.2", 0)).close()
    except OSError:
        pytest.skip("this system has no 127.0.0.2")
    ear = hear("mvn", port=0, protocol="tcp", sees_room=True)
    mvn = Mvn(ear.port, tcp=True)
    mvn.send(*mvn_sender.quaternions(1, 10, 0, mvn_at(1.0, 2.0)))
    assert ear.scene().sees_room
    other = Mvn(ear.port, tcp=True, host="127.0.0.2")
    other.send(mvn_sender.time_code(9000, 0))
    ear.wait(lambda: ear.counters.ignored == 1)
    mvn.send(*mvn_sender.quaternions(2, 20, 0, mvn_at(1.0, 2.0)))
    assert not ear.scene().sees_room
    assert "two programs send to this port" in ear.counters.last_error
    other.close()


def test_a_port_that_is_taken_says_what_to_do(hear: Hear) -> None:
    for protocol in ("udp", "tcp"):
        first = hear("mvn", port=0, protocol=protocol, sees_room=True)
        with pytest.raises(SourceError, match="another program"):
            hear("mvn", port=first.port, protocol=protocol, sees_room=True)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({}, "sees_room: required"),
        ({"sees_room": True, "host": "0.0.0.0"}, "allow_unauthenticated"),
        ({"sees_room": True, "host": "somewhere"}, "IP address"),
        ({"sees_room": True, "sample_rate_hz": 30}, "less than rate_hz"),
        ({"sees_room": True, "axes": ["x", "y", "-z"]}, "left-handed"),
        ({"sees_room": True, "joint_map": "coco17"}, "23 segments"),
    ],
)
def test_a_wrong_configuration_is_refused_in_one_line(settings: dict[str, Any], says: str) -> None:
    cls = registry.load("sources", "mvn")
    data = {"kind": "mvn", "room_from_source": {}, "rate_hz": 60} | settings
    with pytest.raises(ConfigError, match=says) as error:
        cls(validated(cls.settings_model, data, "source"))
    assert "\n" not in str(error.value)
