"""The node's own stream over real sockets, from the sender that users copy."""

import logging
import socket
import time

import numpy as np
import pytest

from hri_drivers.sources.scene_stream.codec import encode
from hri_drivers.sources.scene_stream.udp_source import UdpSettings
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from tests.hri_drivers.sources.scene_streaming import KEY, SECRET, hri_sender, person, scene

pytestmark = pytest.mark.realtime

POSE = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
JOINTS = list(CANONICAL.joints)


class Wire:
    """A socket to the source's port."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.address = ("127.0.0.1", port)
        self.session = time.time_ns()

    def send(self, sequence: int, people: int = 1, key: object = None) -> list[bytes]:
        sent = scene(sequence, people, len(JOINTS), time.time_ns(), session=self.session)
        datagrams = encode(sent, JOINTS, key)  # type: ignore[arg-type]
        self.send_bytes(*datagrams)
        return datagrams

    def send_bytes(self, *datagrams: bytes) -> None:
        for data in datagrams:
            self.socket.sendto(data, self.address)


@pytest.fixture
def key_file(tmp_path):
    path = tmp_path / "cell.key"
    path.write_bytes(SECRET)
    path.chmod(0o600)
    return str(path)


@pytest.fixture
def wire():
    wires = []

    def connected(ear):
        wires.append(Wire(ear.port))
        return wires[-1]

    yield connected
    for one in wires:
        one.socket.close()


@pytest.mark.parametrize("keyed", [False, True])
def test_what_the_copied_sender_sends_is_heard(hear, key_file, keyed):
    key = key_file if keyed else None
    ear = hear("udp", port=0, key_file=key)
    sender = hri_sender().SceneSender("127.0.0.1", ear.port, JOINTS, key)
    body = person(5, len(JOINTS), hidden=2)
    sender.send([(5, [None, *body.positions[1:]])])  # None, and NaN
    sender.send([])
    sender.send([], sees_room=False)
    scenes = ear.scenes(3)
    sender.close()
    assert [(s.sequence, len(s.people), s.sees_room) for s in scenes] == [
        (0, 1, True), (1, 0, True), (2, 0, False),
    ]  # fmt: skip
    (seen,) = scenes[0].people
    np.testing.assert_array_equal(seen.observed, body.observed)
    np.testing.assert_allclose(seen.positions, body.positions)
    assert abs(scenes[0].stamp_ns - time.time_ns()) < 60e9
    assert (ear.counters.packets, ear.counters.scenes) == (3, 3)


def test_the_demonstration_person_is_one_whole_body(hear):
    ear = hear("udp", port=0)
    module = hri_sender()
    assert module.CANONICAL == JOINTS
    sender = module.SceneSender("127.0.0.1", ear.port, module.CANONICAL)
    sender.send([(1, module.swaying(0.3))])
    (seen,) = ear.scene().people
    sender.close()
    apart = np.linalg.norm(seen.positions[:, None] - seen.positions[None], axis=-1)
    assert seen.observed.all()
    assert (apart <= CANONICAL.reach).all()


def test_what_is_forged_damaged_or_played_again_is_counted_and_not_heard(hear, key_file, wire):
    ear = hear("udp", port=0, key_file=key_file)
    line = wire(ear)
    recorded = line.send(0, key=KEY)
    line.send_bytes(*recorded)  # again
    line.send(1)  # without a key
    line.send_bytes(recorded[0][:-1] + bytes([recorded[0][-1] ^ 1]), b"garbage", b"x" * 9000)
    line.send(2, key=KEY)
    assert [s.sequence for s in ear.scenes(2)] == [0, 2]
    counters = ear.counters
    assert (counters.replayed, counters.unauthenticated, counters.malformed) == (1, 2, 2)
    assert (counters.packets, counters.scenes, counters.lost) == (7, 2, 1)


def test_a_recording_is_refused_after_a_restart_of_the_node(hear, key_file, wire):
    first = hear("udp", port=0, key_file=key_file)
    line = wire(first)
    recorded = [data for i in range(3) for data in line.send(i, key=KEY)]
    first.scenes(3)
    first.source.close()
    again = hear("udp", port=0, key_file=key_file, max_skew_s=0.001)
    line.address = ("127.0.0.1", again.port)
    time.sleep(0.01)
    line.send_bytes(*recorded)
    again.wait(lambda: again.counters.replayed == 3)
    assert again.counters.scenes == 0


def test_multicast(hear, wire):
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()
    try:
        ear = hear("udp", port=port, multicast_group="239.255.77.1")
    except SourceError as error:
        pytest.skip(f"no multicast here: {error}")
    sender = hri_sender().SceneSender("239.255.77.1", port, JOINTS, interface="127.0.0.1")
    sender.send([])
    assert ear.scene().people == ()
    sender.close()


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"host": "0.0.0.0"}, "accepts network input, and any program could claim"),
        ({"host": "::"}, "set 'key_file', or 'allow_unauthenticated: true'"),
        ({"host": "tracker.local"}, "must be an IP address"),
        ({"multicast_group": "10.0.0.1"}, "must be an IPv4 multicast address"),
        ({"host": "::1", "multicast_group": "239.0.0.1"}, "multicast needs an IPv4 'host'"),
        ({"port": 70000}, "less than or equal to 65535"),
        ({"key": "secret"}, "did you mean 'key_file'"),
        ({"max_skew_s": 0}, "greater than or equal to 0.001"),
    ],
)
def test_a_wrong_configuration_is_refused_in_one_line(settings, why):
    data = {"kind": "udp", "room_from_source": POSE, "rate_hz": 30} | settings
    with pytest.raises(ConfigError, match=why) as caught:
        validated(UdpSettings, data, "cell.yaml: source")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "settings",
    [{"host": "localhost"}, {"host": "127.3.2.1"}, {"host": "::1"},
     {"host": "0.0.0.0", "key_file": "cell.key"},
     {"host": "192.168.0.2", "allow_unauthenticated": True}],
)  # fmt: skip
def test_a_right_configuration_is_accepted(settings):
    data = {
        "kind": "udp",
        "room_from_source": POSE,
        "rate_hz": 30,
        "min_latency_s": 0.02,
    } | settings
    accepted = validated(UdpSettings, data, "cell.yaml: source")
    warned = bool(accepted.notes)  # shown by ``check``
    assert warned == ("allow_unauthenticated" in settings)


def test_a_latency_of_zero_is_noted():
    data = {"kind": "udp", "room_from_source": POSE, "rate_hz": 30}
    (note,) = validated(UdpSettings, data, "source").notes
    assert "min_latency_s is 0: zones are too small by 1.6 m/s times" in note


def test_a_port_that_is_taken_is_named(hear):
    ear = hear("udp", port=0)
    with pytest.raises(SourceError, match=f"127.0.0.1:{ear.port}: in use by another program"):
        hear("udp", port=ear.port)


def test_an_address_that_is_not_ours_is_named(hear):
    with pytest.raises(SourceError, match="not an address of this machine; correct 'host'"):
        hear("udp", port=0, host="192.0.2.1", allow_unauthenticated=True)


def test_a_missing_key_is_found_before_anything_is_opened(hear, tmp_path):
    with pytest.raises(SourceError, match=r"key_file .*gone\.key: cannot be read"):
        hear("udp", port=0, key_file=str(tmp_path / "gone.key"))


def test_the_secret_is_never_logged(hear, key_file, wire, caplog):
    with caplog.at_level(logging.DEBUG):
        ear = hear("udp", port=0, key_file=key_file)
        line = wire(ear)
        line.send(0)
        ear.wait(lambda: ear.counters.unauthenticated == 1)
        ear.source.close()
    assert SECRET.decode() not in caplog.text
    assert SECRET.decode() not in str(ear.counters.last_error)
