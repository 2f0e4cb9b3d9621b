"""The zenoh source: what a user's program puts under the key arrives, if it is authentic."""

import importlib.util
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from hri_drivers.sources.scene_stream.zenoh_source import ZenohSource, ZenohSourceSettings
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.clock import MonotonicClock
from hri_predict.contracts.scene import Scene
from hri_predict.protocol.keyed import Keyed

SENDER_FILE = Path(__file__).parents[4] / "drivers" / "python" / "hri_sender.py"
POSE = {"xyz": [0, 0, 1], "quaternion_xyzw": [0, 0, 0, 1]}


@pytest.fixture
def endpoint() -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    router = open_session(ZenohSettings(mode="router", listen=[address]))
    yield address
    router.close()


def make_source(endpoint: str, **more: Any) -> ZenohSource:
    data = {"kind": "zenoh", "cell": "press", "connect": [endpoint], "rate_hz": 30}
    data |= {"room_from_source": POSE} | more
    return ZenohSource(ZenohSourceSettings.model_validate(data), clock=MonotonicClock())


def users_program() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hri_sender", SENDER_FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sent_until(source: ZenohSource, endpoint: str, condition: Any, **key: Any) -> None:
    """Send as a user's program does, scene after scene, until ``condition()``."""
    joints = list(source.joint_map.source_joints)
    sender = users_program().SceneSender("127.0.0.1", 9, joints, **key)
    transport = ZenohTransport(ZenohSettings(connect=[endpoint]), "hri/site/press/")
    transport.open()
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline, "did not happen"
        people = [(7, np.full((len(joints), 3), 0.5))]
        for datagram in sender.encode(people, True, time.time_ns()):
            transport.write(Keyed("scene", datagram))
        time.sleep(0.02)
    transport.close()


def heard(source: ZenohSource, scenes: list[Scene]) -> bool:
    scene = source.poll(time.monotonic_ns())
    if scene is not None:
        scenes.append(scene)
    return len(scenes) >= 2


def test_scenes_arrive_in_the_room(endpoint: str) -> None:
    source, scenes = make_source(endpoint), list[Scene]()
    source.open(0)
    try:
        sent_until(source, endpoint, lambda: heard(source, scenes))
    finally:
        source.close()
    assert [p.id for p in scenes[0].people] == [7]
    np.testing.assert_allclose(scenes[0].people[0].positions[0], [0.5, 0.5, 1.5])


def test_with_a_key_only_who_has_it_is_heard(endpoint: str, tmp_path: Path) -> None:
    right, wrong = tmp_path / "right.key", tmp_path / "wrong.key"
    for path, content in ((right, "ab" * 32), (wrong, "cd" * 32)):
        path.write_text(content)
        path.chmod(0o600)
    source, scenes = make_source(endpoint, key_file=str(right)), list[Scene]()
    source.open(0)
    try:
        refused = source.counters
        sent_until(source, endpoint, lambda: refused.unauthenticated > 2, key_file=str(wrong))
        assert source.poll(time.monotonic_ns()) is None
        sent_until(source, endpoint, lambda: heard(source, scenes), key_file=str(right))
    finally:
        source.close()


def test_the_network_is_not_heard_unprotected() -> None:
    with pytest.raises(ValidationError, match="set 'key_file'"):
        make_source("tcp/10.0.0.5:7447")
    assert make_source("tcp/10.0.0.5:7447", allow_unauthenticated=True)
