"""The protection that docs/guides/fleet.md shows holds: its files are run as they stand there."""

import re
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_drivers.sources.live import sender_joints
from hri_drivers.sources.scene_stream.codec import open_datagram
from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.scene_stream.zenoh_source import ZenohSourceSettings
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.errors import LinkError
from hri_predict.protocol.keyed import KeyedSender
from hri_predict.protocol.messages import NodeState, Status
from hri_predict.protocol.reasons import Reason

ROOT = Path(__file__).parents[1]
DOC = (ROOT / "docs" / "guides" / "fleet.md").read_text(encoding="utf-8")
SECRET = b"0123456789abcdef" * 2
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=0, predictor=0, cycle=1)


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", DOC, re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The files that the page tells to make, here instead of in /etc, at a port that is free."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    (script,) = blocks("sh")
    subprocess.run(["sh", "-ec", script], cwd=tmp_path, check=True, capture_output=True)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    router, press = (
        text.replace("/etc/hri-predict", str(tmp_path)).replace("7447", port)
        for text in blocks("json5")
    )
    (tmp_path / "router.json5").write_text(router)
    (tmp_path / "press.json5").write_text(press)
    (tmp_path / "office.json5").write_text(press.replace("press", "office"))
    bare = re.sub(r"(connect_certificate|connect_private_key|enable_mtls).*", "", press)
    (tmp_path / "nobody.json5").write_text(bare)
    return tmp_path


def configured(folder: Path, who: str) -> ZenohSettings:
    return ZenohSettings(zenoh_config=str(folder / f"{who}.json5"))


@pytest.mark.realtime
def test_each_machine_speaks_for_its_own_cell_alone(folder: Path) -> None:
    router = open_session(configured(folder, "router"))
    viewer = ZenohLink.observer(configured(folder, "office"), None)
    viewer.open()
    senders = {
        who: ZenohTransport(configured(folder, machine), f"hri/plant/{cell}/")
        for who, machine, cell in (
            ("office as press", "office", "press"),
            ("press as mill", "press", "mill"),
            ("press as press", "press", "press"),
        )
    }
    coded, heard = KeyedSender(), list[str]()
    for transport in senders.values():
        transport.open()
    deadline = time.monotonic() + 20
    while not heard:  # the one that is permitted speaks last, so the others had their chance
        assert time.monotonic() < deadline
        for transport in senders.values():
            transport.write(coded.encode(STATUS))
        heard = [unit.key for unit in viewer.read(0.05)]
    time.sleep(0.2)
    heard += [unit.key for unit in viewer.read(0.0)]
    assert set(heard) == {"plant/press/status"}
    with pytest.raises(LinkError, match="no answer"):
        open_session(configured(folder, "nobody"))
    for transport in (viewer, *senders.values()):
        transport.close()
    router.close()


@pytest.mark.realtime
def test_the_tracker_that_the_page_shows_is_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cell.key").write_bytes(SECRET)
    (tmp_path / "cell.key").chmod(0o600)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(ROOT / "drivers" / "python")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    endpoint = f"tcp/127.0.0.1:{port}"
    router = open_session(ZenohSettings(mode="router", listen=[endpoint], connect=[]))
    heard: list[bytes] = []
    subscriber = router.declare_subscriber(
        "hri/plant/press/scene", lambda sample: heard.append(sample.payload.to_bytes())
    )
    deadline = time.monotonic() + 20
    while not heard:  # what is put before the router knows of the client may be lost
        assert time.monotonic() < deadline
        names: dict[str, Any] = {}
        exec(blocks("python")[0].replace("7447", port).replace("1800", "3"), names)
        time.sleep(0.2)
        names["session"].close()
    subscriber.undeclare()
    router.close()
    header, _ = open_datagram(heard[0], Key(SECRET, "cell.key"))
    shown = ZenohSourceSettings.model_validate(yaml.safe_load(blocks("yaml")[2])["source"])
    assert (header.people, header.joints) == (1, len(sender_joints(shown, None).source_joints))


def test_the_links_that_the_page_shows_are_valid() -> None:
    shown = [yaml.safe_load(text) for text in blocks("yaml")]
    assert [ZenohLinkSettings.model_validate(y["links"][0]).cell for y in shown[:2]] == [
        "press"
    ] * 2
    assert ZenohSourceSettings.model_validate(shown[2]["source"]).key_file == "cell.key"
