"""Controllers and nodes of different protocol versions do not take each other's word."""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hri_predict.protocol.can import CanReceiver
from hri_predict.protocol.messages import Schema
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.robot_state import ROBOT_STATE
from hri_predict.protocol.serial import SerialReceiver
from tests.hri_drivers.c.agree import units
from tests.hri_drivers.c.test_rule import LINKS, Line

OLD = [Schema(1, 0xD680A301), Schema(2, 0xDB28BBAC)]  # the last ones of these versions
C = Path(__file__).resolve().parents[3] / "drivers" / "c"


@pytest.fixture(scope="module", params=OLD, ids=lambda schema: f"version {schema.version}")
def old_schema(request: pytest.FixtureRequest) -> Schema:
    """What an old version's Schema says."""
    old: Schema = request.param
    return old


@pytest.fixture(scope="module")
def old_driver(tmp_path_factory: pytest.TempPathFactory, old_schema: Schema) -> Path:
    """The driver with the library, built for an old version: what it demands of a Schema."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) here")
    folder = tmp_path_factory.mktemp("old")
    for path in (*C.glob("*.[ch]"), Path(__file__).with_name("driver.c")):
        shutil.copy(path, folder)
    header = folder / "hri_predict.h"
    text = header.read_text(encoding="ascii")
    version, number = f"{old_schema.version}u", f"0x{old_schema.hash:08X}u"
    text, versions = re.subn(r"(#define HRI_SCHEMA_VERSION ).*", rf"\g<1>{version}", text)
    text, hashes = re.subn(r"(#define HRI_SCHEMA_HASH ).*", rf"\g<1>{number}", text)
    assert (versions, hashes) == (1, 1)
    header.write_text(text, encoding="ascii")
    program = folder / "driver"
    sources = sorted(map(str, folder.glob("*.c")))
    subprocess.run(["cc", "-std=c99", "-o", str(program), *sources], check=True)
    return program


@pytest.mark.parametrize("link", LINKS)
def test_a_controller_of_an_old_version_says_that_it_heard_another_schema(
    old_driver: Path, old_schema: Schema, link: str
) -> None:
    one = Line(old_driver, link).started().ask().wait(20).state().advise().ask()
    assert one.answers() == [(0, "other schema")] * 2
    assert Line(old_driver, link).say(old_schema).state().advise().answer()[0] > 0


@pytest.mark.parametrize("link", LINKS)
def test_a_controller_stops_under_a_node_of_an_old_version(
    build: Callable[..., Path], old_schema: Schema, link: str
) -> None:
    program = build(Path(__file__).with_name("driver.c"))
    one = Line(program, link).say(OURS).state().advise().ask().say(old_schema).advise().ask()
    assert one.answers() == [(900, "advice"), (0, "other schema")]


STATE_V1 = bytes.fromhex("61 34 12 00 08 80" + "E8 03" * 6 + "FF FF" * 6)
"""A RobotState of version 1: six joints, the seventh not available."""


@pytest.mark.parametrize("link", LINKS)
def test_a_state_of_version_1_is_malformed_or_incomplete(link: str) -> None:
    """A controller does not say its version; its states must not be read at other places."""
    receiver: Any = SerialReceiver() if link == "serial" else CanReceiver(link == "fd")
    heard = []
    for counter in range(3):
        payload = STATE_V1 if link != "fd" else STATE_V1 + bytes(15)
        for unit in units(ROBOT_STATE, link, ROBOT_STATE.number, counter, payload):
            heard += receiver.feed(unit)
    assert heard == []
    assert receiver.counters.malformed + receiver.counters.incomplete > 0
