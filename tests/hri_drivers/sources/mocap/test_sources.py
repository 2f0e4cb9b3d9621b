"""Sources of motion capture over real sockets, from programs in other processes."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.scene import Person, Scene
from hri_sim.people.body import Body
from hri_sim.senders.mocap_ends import PROGRAMS
from hri_sim.wires.ports import free_tcp_port, free_udp_port

pytestmark = pytest.mark.realtime

PATIENCE_S = 120.0
LONG = [pytest.mark.long]
Hear = Callable[..., Any]
Starts = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def starts() -> Iterator[Starts]:
    running: list[subprocess.Popen[bytes]] = []

    def start(kind: str, port: int, *more: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "hri_sim.senders.mocap_person", kind, "--port", str(port)]
        running.append(subprocess.Popen([*command, "--seconds", "120", *more]))
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()


def soon(ear: Any, count: int) -> list[Scene]:
    """Scenes of a program that is starting, however long that takes on a busy machine."""
    end_s = time.monotonic() + PATIENCE_S
    found: list[Scene] = []
    while len(found) < count:
        assert time.monotonic() < end_s, f"no scenes: {ear.counters}"
        ear.source.arrived.wait(0.1)
        ear.source.arrived.clear()
        while (scene := ear.source.poll(time.monotonic_ns())) is not None:
            found.append(scene)
    return found


@pytest.mark.parametrize("kind", [pytest.param(k, marks=LONG * (k != "vmc")) for k in PROGRAMS])
def test_a_program_in_another_process_is_heard_and_may_restart(
    hear: Hear, starts: Starts, kind: str
) -> None:
    turned = {"xyz": [10, 20, 0], "quaternion_xyzw": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]}
    port = free_tcp_port() if kind == "qualisys" else free_udp_port()
    where = {"command_port" if kind == "natnet" else "port": port}
    # a client of a server that starts later
    where |= {"wait_for_device": True} if kind == "qualisys" else {}
    ear = hear(kind, sees_room=True, room_from_source=turned, **where)
    first = starts(kind, port)
    scene = soon(ear, 3)[-1]
    (person,) = scene.people
    assert scene.sees_room
    joints, seen = ear.source.joint_map.map(person.positions, person.observed)
    assert seen.sum() >= 17
    np.testing.assert_allclose(joints[seen].mean(axis=0)[:2], [10, 22], atol=0.2)  # who sways
    assert ear.counters.malformed == ear.counters.refused == 0
    first.kill()
    first.wait()
    heard = ear.counters.packets
    starts(kind, port)  # another socket, which is refused until the first one is forgotten
    assert soon(ear, 40)[-1].sequence > scene.sequence
    assert ear.counters.packets > heard


def test_a_second_program_is_refused_and_while_it_sends_the_room_is_not_seen(hear: Hear) -> None:
    ear = hear("rokoko", port=0, sees_room=True)
    programs = [PROGRAMS["rokoko"](), PROGRAMS["rokoko"]()]
    body = Body(1.75)
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in programs]

    def send(number: int, k: int) -> None:
        joints = body.joints(body.standing(np.array([2.0, 0.01 * k]), 0.0))
        person = Person(1, joints, np.ones(21, np.bool_))
        (data,) = programs[number].encode(Scene(k * 10**7, k, True, (person,)))
        sockets[number].sendto(data, ("127.0.0.1", ear.port))

    for k in range(3):
        send(0, k)
    assert ear.scenes(3)[-1].sees_room
    heard = ear.source._receiver
    heard._now_s = lambda: heard._heard_s  # the clock stands still
    send(1, 3)
    ear.wait(lambda: ear.counters.refused == 1)
    send(0, 4)
    assert not ear.scenes(1)[-1].sees_room
    assert "two programs send to this port" in ear.counters.last_error
    for each in sockets:
        each.close()


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_wrong_configuration_is_refused_in_one_line(kind: str) -> None:
    cls = registry.load("sources", kind)
    for change, says in (
        ({}, "sees_room: required"),
        ({"sees_room": True, "host": "0.0.0.0"}, "allow_unauthenticated"),
        ({"sees_room": True, "host": "studio"}, "IP address"),
    ):
        data = {"kind": kind, "room_from_source": {}, "rate_hz": 60} | change
        with pytest.raises(ConfigError, match=says) as error:
            cls(validated(cls.settings_model, data, "source"))
        assert "\n" not in str(error.value)


def test_a_joint_map_without_the_root_is_refused() -> None:
    cls = registry.load("sources", "vmc")
    data = {"kind": "vmc", "room_from_source": {}, "rate_hz": 60, "sees_room": True}
    settings = validated(cls.settings_model, data | {"joint_map": "coco17"}, "source")
    with pytest.raises(ConfigError, match="no joint 'Hips'"):
        cls(settings)


def test_a_multicast_group_needs_the_network_to_be_trusted() -> None:
    cls = registry.load("sources", "zed_livelink")
    data = {"kind": "zed_livelink", "room_from_source": {}, "rate_hz": 30, "sees_room": True}
    for group, says in (("230.0.0.1", "allow_unauthenticated"), ("10.0.0.1", "multicast address")):
        with pytest.raises(ConfigError, match=says):
            validated(cls.settings_model, data | {"multicast_group": group}, "source")
