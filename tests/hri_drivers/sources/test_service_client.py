"""A source named by its service: found by multicast DNS, and found again where it has moved to."""

import json
import os
import socket
import threading
import time
from typing import Any

import pytest
from pydantic import ValidationError
from zeroconf import ServiceInfo, Zeroconf

from hri_drivers.sources.scene_json.json_source import TCP_SOURCE, JsonSettings, JsonSource
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import SourceError
from tests.waiting import eventually

NAME = f"test{os.getpid()} camera"
POSE = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}


def settings(**more: Any) -> JsonSettings:
    data = {"kind": "json", "role": "client", "rate_hz": 30, "room_from_source": POSE}
    return JsonSettings.model_validate(data | {"service": NAME} | more)


class Camera:
    """A sender that listens at a port of its own and announces it."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.connections: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()
        self.zeroconf = Zeroconf(interfaces=["127.0.0.1"])
        port, address = self.listener.getsockname()[1], socket.inet_aton("127.0.0.1")
        info = ServiceInfo(TCP_SOURCE, f"{NAME}.{TCP_SOURCE}", port, addresses=[address])
        self.zeroconf.register_service(info)

    def _accept(self) -> None:
        while True:
            try:
                self.connections.append(self.listener.accept()[0])
            except OSError:
                return

    def say(self, text: bytes) -> None:
        for connection in self.connections:
            connection.sendall(text)

    def close(self) -> None:
        for connection in (self.listener, *self.connections):
            connection.close()
        self.zeroconf.close()


@pytest.mark.long
@pytest.mark.realtime
def test_it_is_found_and_found_again_at_another_port() -> None:
    camera = Camera()
    source = JsonSource(settings(), clock=MonotonicClock())
    source.open(time.monotonic_ns())
    try:
        for times in (0, 1):
            eventually(lambda c=camera: source.connected and c.connections)  # type: ignore[misc]
            assert source.counters.reconnects == times
            packets = source.counters.packets
            camera.say(json.dumps({"anything": 1}).encode() + b"\n")
            eventually(lambda packets=packets: source.counters.packets > packets)  # type: ignore[misc]
            if times == 0:
                camera.close()
                eventually(lambda: not source.connected)  # by its connection, not by its record
                camera = Camera()
    finally:
        source.close()
        camera.close()


@pytest.mark.realtime
def test_nobody_of_that_name_is_an_error_that_names_it() -> None:
    source = JsonSource(settings(service={"name": NAME, "timeout_s": 0.2}), clock=MonotonicClock())
    with pytest.raises(SourceError, match=f"no _hri-source._tcp named '{NAME}' answered"):
        source.open(0)


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(ValidationError, match="needs 'role: client'"):
        settings(role="server")
    with pytest.raises(ValidationError, match="allow_unauthenticated"):
        settings(service={"name": "camera", "interfaces": ["192.168.1.5"]})
