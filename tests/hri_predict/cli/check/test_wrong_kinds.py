"""A folder or another device where a file or a serial device is meant: check and run refuse it."""

import pytest

from hri_predict.base.errors import HriPredictError
from hri_predict.cli.check.check import examine
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run
from tests.silent_server import cell_with

LIVE = {
    "kind": "serial_skeleton",
    "room_from_source": {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]},
    "rate_hz": 30,
}


def link(**keys):
    return {"links": [{"name": "m"} | keys]}


CASES = [
    ({"state": "/dev/zero"}, "state.path: /dev/zero cannot be used: is a device, not a file"),
    ({"state": "/"}, "state.path: / cannot be used: is a folder, not a file"),
    ({"state": "/dev/zero/x"}, "/dev/zero is a device, not a folder"),
    ({"alerts": {"file": "/dev/zero"}}, "alerts.file /dev/zero: is a device, not a file"),
    ({"alerts": {"file": "/"}}, "alerts.file /: is a folder, not a file"),
    ({"evidence": {"folder": "/dev/zero"}}, "evidence.folder /dev/zero: is a device"),
    (link(kind="can", interface="slcan", channel="/"), "links.0: / is not a serial device"),
    (link(kind="can", interface="slcan", channel="/dev/zero@9600"), "not a serial device"),
    (link(kind="can", interface="socketcan", channel="/"), "/ is not a CAN interface"),
    (link(kind="serial", port="/", baudrate=115200), "links.0.port: / is not a serial device"),
    (link(kind="serial", port="/etc/passwd", baudrate=115200), "not a serial device"),
    ({"source": LIVE | {"port": "/dev/null"}}, "source.port: /dev/null is not a serial device"),
]


COMMANDS = {
    "check": lambda path: examine(configuration.load(path)),
    "run": lambda path: run(configuration.load(path), Options(keep_state=True, duration_s=0.1)),
}


@pytest.mark.parametrize(("changes", "said"), CASES)
@pytest.mark.parametrize("command", COMMANDS)
def test_it_is_refused_in_one_line(tmp_path, changes, said, command):
    path = cell_with(tmp_path, **({"links": []} | changes))
    with pytest.raises(HriPredictError) as refused:
        COMMANDS[command](path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_is_missing_may_come(tmp_path):
    changes = {"state": "new/state.json", "evidence": {"folder": "new/kept"}} | link(
        kind="serial", port="/dev/ttyACM77", baudrate=115200
    )
    examine(configuration.load(cell_with(tmp_path, **changes)))
