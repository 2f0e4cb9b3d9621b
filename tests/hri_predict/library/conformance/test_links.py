"""Every registered link keeps its contract, and one that breaks it is caught."""

import pickle
import time
from importlib.util import find_spec
from typing import Any

import pytest

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.library.conformance.checks import run_checks
from hri_predict.library.conformance.links import CHECKS, LinkPart, check_link
from hri_predict.protocol.messages import Advice, at_encoding
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters

READ = {
    "heartbeat": "i=100",
    "automatic": True,
    "joints": [{"position": f"i={n}", "velocity": f"i={n + 50}"} for n in range(6)],
}
REGISTERS = READ | {
    "heartbeat": 100,
    "joints": [{"position": 2 * n, "velocity": 2 * n + 20} for n in range(6)],
}
LINKS: list[tuple[str, dict[str, Any]]] = [
    ("serial", {"port": "/dev/ttyNONE"}),
    ("can", {"interface": "virtual", "channel": "x"}),
    ("can", {"interface": "virtual", "channel": "x", "fd": True}),
    ("can", {"interface": "virtual", "channel": "x", "extended": True, "base_id": 0x1000}),
    ("zenoh", {"cell": "a"}),
    ("modbus", {}),
    ("opcua", {}),
    ("modbus_client", {"host": "127.0.0.1", "max_state_age_s": 0.1, "registers": REGISTERS}),
    ("opcua_client", {"host": "127.0.0.1", "max_state_age_s": 0.1, "nodes": READ}),
    ("rtde", {"host": "127.0.0.1", "full_speed_m_s": 1.0, "max_age_s": 0.4}),
    ("ros2", {"full_speed_m_s": 1.0}),
]
FOREIGN = {
    "rtde",
    "modbus",
    "opcua",
    "modbus_client",
    "opcua_client",
}  # speak a third-party protocol: what our frames prove is skipped


@pytest.mark.parametrize(("name", "data"), LINKS)
def test_every_link_keeps_its_contract(name, data):
    packages = {"zenoh": "zenoh", "modbus": "pymodbus", "opcua": "asyncua"}
    package = packages.get(name.removesuffix("_client"))
    if package is not None and find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    model = registry.load("links", name).settings_model
    findings = check_link(name, validated(model, {"name": "l", "kind": name, **data}, name))
    assert [f for f in findings if f.verdict == "fail"] == []
    if name in FOREIGN:
        return
    stream = "finds messages in a stream"  # a CAN frame, a payload of zenoh or ROS 2 come whole
    assert {f.check for f in findings if f.verdict == "skipped"} <= {stream}
    if name == "serial":
        assert all(f.verdict == "pass" for f in findings)


def test_every_link_is_checked_here():
    assert set(registry.names("links")) == {name for name, _ in LINKS}


class Blocking(SerialLink):
    """Takes long twenty times: more than one call in a hundred."""

    long = 20

    def post(self, message):
        super().post(message)
        if self._writer is not None and self.long:
            self.long -= 1
            time.sleep(0.06)


class Forgetful(SerialLink):
    """Drops every third message, and tells nobody."""

    posted = 0

    def post(self, message):
        self.posted += 1
        if self.posted % 3:
            super().post(message)


class OldestWins(SerialLink):
    def post(self, message):
        if len(self._slots) < 3:
            super().post(message)
        else:
            self.counters.superseded += 1


class Hasty(SerialLink):
    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self._transport.open()


class Ageless(SerialLink):
    def _encoded(self, message, now_ns):
        return self._codec.encode(message)


class Mute(SerialLink):
    def _send(self, unit, now_ns):
        told, self.on_sent = self.on_sent, None
        super()._send(unit, now_ns)
        self.on_sent = told


class Stubborn(SerialLink):
    def stop(self):
        assert self.connected, "not connected"
        super().stop()


class Pickles:
    """Encodes without a CRC, and decodes whatever comes."""

    def __init__(self) -> None:
        self.counters = ReceiveCounters()

    def carries(self, message):
        return True

    def encode(self, message):
        return [pickle.dumps(message)]

    def feed(self, unit):
        return [pickle.loads(unit)]

    decode = feed

    def watch(self, own):
        pass

    def reset(self):
        pass

    def count(self, counters):
        pass

    def worst_s(self, message):
        return 1e-3

    def unit_s(self, unit):
        return 1e-3

    def raw(self, unit):
        return unit

    def size(self, unit):
        return len(unit)


class Unprotected(SerialLink):
    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self._codec = Pickles()

    @staticmethod
    def receiver(settings):
        return Pickles()


class Weightless(SerialLink):
    @staticmethod
    def load(settings, rate_hz, robots=(0,), shapes=()):
        load = SerialLink.load(settings, rate_hz, robots, shapes)
        load.load = 0.0
        return load


class Echoless(SerialLink):
    def _encoded(self, message, now_ns):
        message = at_encoding(message, now_ns)
        assert not isinstance(message, Advice) or message.echo is None
        return self._codec.encode(message)


class Heedless(SerialLink):
    """Does not know what it sent itself."""

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self._codec.watch(OwnFrames())


class Suspicious(SerialLink):
    """Takes its own echo for another's."""

    def _encoded(self, message, now_ns):
        units = super()._encoded(message, now_ns)
        self._own = OwnFrames()
        self._codec.watch(self._own)
        return units


@pytest.mark.parametrize(
    ("cls", "check"),
    [
        (Heedless, "tells a second sender"),
        (Suspicious, "does not hear itself"),
        (Blocking, "never blocks in post"),
        (Forgetful, "accounts for every message"),
        (OldestWins, "sends the newest"),
        (Hasty, "opens nothing until started"),
        (Ageless, "says how old it is"),
        (Echoless, "hears the controller"),
        (Mute, "tells the recorder"),
        (Stubborn, "stops twice"),
        (Unprotected, "believes nothing damaged"),
        (Unprotected, "survives noise"),
        (Unprotected, "finds messages in a stream"),
        (Weightless, "knows its load"),
    ],
)
def test_a_link_that_breaks_its_contract_is_caught(cls: Any, check: str):
    settings = SerialLinkSettings(name="l", port="/dev/ttyNONE")
    findings = run_checks(CHECKS, LinkPart(cls, settings))
    failed = {f.check: f.detail for f in findings if f.verdict == "fail"}
    assert check in failed
    assert failed[check]
