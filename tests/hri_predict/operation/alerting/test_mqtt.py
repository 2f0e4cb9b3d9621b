"""MQTT against a real broker: mosquitto, a process of its own on loopback."""

import contextlib
import getpass
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from hri_predict.operation.alerting.alert import Trial
from hri_predict.operation.alerting.hook import Hook
from hri_predict.operation.alerting.mqtt import MqttHook, MqttSender
from hri_predict.operation.alerting.sender import SendError
from tests.hri_predict.operation.alerting.servers import (
    IN_BUFFERS,
    alert,
    certificate,
    flooding_server,
    place,
    silent_server,
)
from tests.waiting import eventually, free_port

mqtt = pytest.importorskip("paho.mqtt.client", reason="needs paho-mqtt (the extra mqtt)")
ROOT = Path(__file__).resolve().parents[4]
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin") or ""
pytestmark = [
    pytest.mark.skipif(not MOSQUITTO, reason="needs the broker mosquitto (Debian: mosquitto)"),
    pytest.mark.realtime,
]


@contextlib.contextmanager
def broker(folder, *lines, port=None):
    port = port or free_port()
    config = folder / "mosquitto.conf"
    text = [f"listener {port} 127.0.0.1", "persistence false", f"user {getpass.getuser()}", *lines]
    if not any("allow_anonymous" in line for line in lines):
        text.append("allow_anonymous true")
    config.write_text("\n".join(text) + "\n")
    log = (folder / "mosquitto.log").open("ab")
    process = subprocess.Popen([MOSQUITTO, "-c", str(config)], stdout=log, stderr=log)
    try:
        eventually(lambda: listens(port) or process.poll() is not None)
        assert process.poll() is None, (folder / "mosquitto.log").read_text()
        yield port
    finally:
        process.terminate()
        process.wait(10)
        log.close()


def listens(port):
    with contextlib.suppress(OSError):
        socket.create_connection(("127.0.0.1", port), 1).close()
        return True
    return False


class Subscriber:
    """What a subscriber knows of each topic, and what came in which order."""

    def __init__(self, port):
        self.newest, self.came = {}, []
        self._ready = threading.Event()
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self._client.on_connect = lambda client, *_: client.subscribe("#", qos=1)
        self._client.on_subscribe = lambda *_: self._ready.set()
        self._client.on_message = self._take
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        assert self._ready.wait(10)

    def _take(self, _client, _data, message):
        self.newest[message.topic] = message.payload.decode()
        self.came.append((message.topic, message.payload.decode(), message.qos, message.retain))

    def close(self):
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def subscribe():
    with contextlib.ExitStack() as stack:

        def made(port):
            subscriber = Subscriber(port)
            stack.callback(subscriber.close)
            return subscriber

        yield made


def sender(folder, port, *, live=True, **settings):
    whole = {"kind": "mqtt", "host": "localhost", "port": port, "tls": False} | settings
    return MqttSender(MqttHook(**whole), place(folder, live=live))


def test_the_broker_keeps_the_newest_of_each_robot_and_the_nodes_state(tmp_path, subscribe):
    with broker(tmp_path) as port:
        mine, early = sender(tmp_path, port), subscribe(port)
        for level in ("slow", "stop"):
            assert mine.send(alert(level), 1) == "acknowledged by the broker"
        mine.send(alert("clear", "a/b#"), 0)
        eventually(lambda: len(early.came) >= 4)
        assert {qos for _, _, qos, _ in early.came} == {1}
        late = subscribe(port)
        eventually(lambda: len(late.newest) == 3)
        assert all(retain for _, _, _, retain in late.came)
        assert json.loads(late.newest["hri-predict/cell7/robots/arm"])["level"] == "stop"
        assert json.loads(late.newest["hri-predict/cell7/robots/a%2Fb%23"])["robot"] == "a/b#"
        assert late.newest["hri-predict/cell7/status"] == "online"
        mine.close()
        eventually(lambda: late.newest["hri-predict/cell7/status"] == "offline")


def test_a_node_that_dies_is_offline(tmp_path, subscribe):
    """A process that is killed says nothing; the broker does, by the last will."""
    with broker(tmp_path) as port:
        watching = subscribe(port)
        code = (
            "import sys, time; from pathlib import Path\n"
            "from tests.hri_predict.operation.alerting.test_mqtt import sender, alert\n"
            "mine = sender(Path(sys.argv[1]), int(sys.argv[2])); mine.send(alert(), 0)\n"
            "time.sleep(60)"
        )
        command = [sys.executable, "-c", code, str(tmp_path), str(port)]
        process = subprocess.Popen(command, cwd=ROOT)
        try:
            eventually(lambda: watching.newest.get("hri-predict/cell7/status") == "online", 60)
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()
        eventually(lambda: watching.newest["hri-predict/cell7/status"] == "offline")


def test_after_a_loss_the_broker_hears_what_holds_now_before_online(tmp_path, subscribe):
    port = free_port()
    mine = sender(tmp_path, port, timeout_s=2)
    mine.tend_s = 0.1
    hook = Hook(mine._settings, mine)
    with broker(tmp_path, port=port):
        hook.start()
        hook.put(alert("slow"))
        hook.put(alert("slow", "gantry"))
        eventually(lambda: hook.report()["delivered"] == 2)
    eventually(lambda: not mine._client or not mine._client.is_connected())
    eventually(lambda: hook.report()["failures"] > 0)
    with broker(tmp_path, port=port):
        watching = subscribe(port)
        eventually(lambda: watching.newest.get("hri-predict/cell7/status") == "online")
        hook.put(alert("stop"))
        eventually(lambda: "stop" in watching.newest["hri-predict/cell7/robots/arm"])
        assert "slow" in watching.newest["hri-predict/cell7/robots/gantry"]
        topics = [topic for topic, *_ in watching.came]
        assert topics.index("hri-predict/cell7/status") > topics.index(
            "hri-predict/cell7/robots/gantry"
        )
        hook.stop()
        hook.join(10)
        eventually(lambda: watching.newest["hri-predict/cell7/status"] == "offline")
    assert hook.report()["dropped"] == 0


def test_a_password_and_tls(tmp_path, subscribe):
    made, key = certificate(tmp_path)
    passwords = tmp_path / "passwords"
    maker = shutil.which("mosquitto_passwd") or "mosquitto_passwd"
    subprocess.run([maker, "-c", "-b", str(passwords), "cell", "hunter2"], check=True)
    (tmp_path / "secret").write_text("hunter2")
    (tmp_path / "wrong").write_text("hunter3")
    lines = [f"certfile {made}", f"keyfile {key}"]
    lines += ["allow_anonymous false", f"password_file {passwords}"]
    tls = {"tls": True, "username": "cell", "password_file": "secret"}
    with broker(tmp_path, *lines) as port:
        sender(tmp_path, port, ca_file="server.pem", **tls).send(alert(), 0)
        wrong = tls | {"password_file": "wrong"}
        with pytest.raises(SendError, match="the broker refuses: Not authorized"):
            sender(tmp_path, port, ca_file="server.pem", **wrong).send(alert(), 0)
        with pytest.raises(SendError, match="certificate is not trusted"):
            sender(tmp_path, port, **tls).send(alert(), 0)


def test_a_broker_without_tls_is_told_apart_and_the_remedy_works(tmp_path):
    with broker(tmp_path) as port:
        with pytest.raises(SendError, match="a broker without TLS needs 'tls: false'"):
            sender(tmp_path, port, tls=True).send(alert(), 0)
        sender(tmp_path, port, tls=False).send(alert(), 0)


def test_a_trial_tells_nothing_of_robots_or_of_the_node(tmp_path, subscribe):
    with broker(tmp_path) as port:
        watching = subscribe(port)
        trial = sender(tmp_path, port, live=False, topic="plant/3")
        trial.send(Trial(at=None), 0)
        trial.close()
        eventually(lambda: "plant/3/test" in watching.newest)
        late = subscribe(port)
        time.sleep(0.2)
        assert late.newest == {}  # nothing is kept
        assert list(watching.newest) == ["plant/3/test"]


@pytest.mark.parametrize("word", [b"", b"\x00"])
def test_a_broker_that_never_answers_is_left(word, tmp_path):
    with silent_server(word) as port:
        begun = time.monotonic()
        with pytest.raises(SendError):
            sender(tmp_path, port, timeout_s=0.5).send(alert(), 0)
        assert time.monotonic() - begun < 5  # ten times the limit: a busy machine


@pytest.mark.parametrize(
    ("first", "then"),
    [
        (b"", b"\x30\x04\x00\x01ab" * 10_000),  # messages that nobody asked for
        (b"\x30\xff\xff\xff\x7f", b"z" * 65_536),  # one of 256 MB
    ],
)
def test_a_broker_that_sends_without_an_end_is_cut_off(first, then, tmp_path):
    with flooding_server(b"\x20\x02\x00\x00" + first, then) as (port, taken):
        with pytest.raises(SendError, match="packets that were not requested"):
            sender(tmp_path, port, timeout_s=1).send(alert(), 0)
        assert taken[0] < IN_BUFFERS


def test_nobody_there_is_said(tmp_path):
    with pytest.raises(SendError, match="cannot connect: Connection refused"):
        sender(tmp_path, free_port()).send(alert(), 0)


def test_a_broken_connection_is_let_go_so_that_the_broker_says_offline(tmp_path, subscribe):
    with broker(tmp_path) as port:
        watching = subscribe(port)
        mine = sender(tmp_path, port)
        mine.send(alert(), 0)
        mine._drop()  # as after an answer that did not come
        eventually(lambda: watching.newest.get("hri-predict/cell7/status") == "offline")
        mine.tend()
        eventually(lambda: watching.newest["hri-predict/cell7/status"] == "online")
        mine.close()
