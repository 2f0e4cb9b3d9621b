"""Scenes to a node."""

import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest

from hri_drivers.camera import sending
from hri_drivers.camera.sending import Sender
from hri_drivers.sources.scene_stream.codec import Refused, decode_body, open_datagram
from hri_drivers.sources.scene_stream.key_file import read_key
from hri_drivers.sources.sent import SentPerson
from hri_predict.base.errors import ConfigError

MS = 1_000_000
JOINTS = [f"joint {k}" for k in range(33)]


@pytest.fixture
def node():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(30)
        yield listener


def person(number=5):
    positions = np.arange(99.0).reshape(33, 3) / 8  # whole in float32
    observed = np.ones(33, np.bool_)
    observed[3] = False
    return SentPerson(number, positions, observed)


def receive(node, key=None):
    header, body = open_datagram(node.recv(2000), key)
    return decode_body(header, body)


def test_a_scene_arrives_as_it_was_sent(node):
    sender = Sender("127.0.0.1", node.getsockname()[1], JOINTS)
    sender.send((person(),), sees_room=True, stamp_ns=time.monotonic_ns() - 80 * MS)
    scene = receive(node)
    assert (scene.sequence, scene.sees_room) == (0, True)
    assert 80 * MS <= time.time_ns() - scene.stamp_ns < 60_000 * MS
    np.testing.assert_array_equal(scene.people[0].observed, person().observed)
    seen = person().observed
    np.testing.assert_array_equal(scene.people[0].positions[seen], person().positions[seen])


def test_captures_that_were_missed_are_a_gap(node):
    sender = Sender("127.0.0.1", node.getsockname()[1], JOINTS)
    for missed in (0, 2, 0):
        sender.send((), sees_room=False, stamp_ns=0, missed=missed)
    assert [receive(node).sequence for _ in range(3)] == [0, 3, 4]
    assert sender.scenes == 3


@pytest.mark.parametrize(("step_ms", "way"), [(-3_600_000, "back"), (90_000, "forward")])
def test_a_clock_that_is_set_is_followed_counted_and_said(node, step_ms, way, monkeypatch, capsys):
    clock = SimpleNamespace(time_ns=lambda: 10**18, monotonic_ns=lambda: 5_000 * MS)
    monkeypatch.setattr(sending, "time", clock)
    sender = Sender("127.0.0.1", node.getsockname()[1], JOINTS)
    sender.send((), sees_room=False, stamp_ns=4_900 * MS)
    clock.time_ns = lambda: 10**18 + step_ms * MS
    for stamp_ms in (4_930, 4_960):
        sender.send((), sees_room=False, stamp_ns=stamp_ms * MS)
    stamps = [receive(node).stamp_ns - 10**18 for _ in range(3)]
    assert stamps == [-100 * MS, (step_ms - 70) * MS, (step_ms - 40) * MS]
    assert sender.clock_steps == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f"clock was set {way} by {abs(step_ms) / 1000:.3g} s" in line


def test_with_a_key_only_its_holder_believes(node, tmp_path):
    path = tmp_path / "cell.key"
    path.write_text("k" * 64)
    path.chmod(0o600)
    sender = Sender("127.0.0.1", node.getsockname()[1], JOINTS, read_key(str(path)))
    sender.send((), sees_room=False, stamp_ns=0)
    sender.send((), sees_room=False, stamp_ns=0)
    assert receive(node, read_key(str(path))).sequence == 0
    with pytest.raises(Refused):
        receive(node)


@pytest.mark.parametrize(
    ("host", "message"),
    [("node.example", "not an IP address"), ("192.0.2.1", "need --key-file"), ("", "not an IP")],
)
def test_a_wrong_host_is_refused(host, message):
    with pytest.raises(ConfigError, match=message):
        Sender(host, 47_800, JOINTS)


def test_refusals_of_the_system_are_counted():
    sender = Sender("127.0.0.1", 47_800, JOINTS)
    sender.close()
    sender.send((), sees_room=False, stamp_ns=0)
    assert sender.unsent == 1
