"""No surroundings of a process make a command end with a traceback: encodings, closed files, ..."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from hri_predict.base.files import data_path
from tests.commands import children, root
from tests.hri_predict.cli import environments
from tests.hri_predict.cli.environments import ENVIRONMENTS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="forks")
DEMO = str(data_path("demo.yaml"))


def commands(group=None, words=()):
    """All command lines that there are, without arguments."""
    for name, command in children(group or root()).items():
        yield [*words, name]
        yield from commands(command, (*words, name))


def cheap_calls(folder):
    """A call of most commands that ends soon: what works, and what is refused."""
    folder.mkdir()
    out = str(folder / "new.yaml")
    return [
        ["check", DEMO],
        ["predictors"],
        ["predictors", "--json"],
        ["init"],
        ["init", out, "--simulated", "--yes"],
        ["register", DEMO, "--out", out],
        ["commission", DEMO],
        ["service", DEMO],
        ["config", "schema"],
        ["config", "document", "--check"],
        ["explain", str(folder / "none.mcap")],
        ["view", str(folder / "none.mcap")],
        ["report", str(folder / "none.mcap")],
        ["convert", str(folder / "none.bvh"), str(folder / "out.csv")],
        ["evidence", str(folder / "none")],
        ["alerts", DEMO],
        ["listen", "can:virtual:none", "--seconds", "0.1"],
        ["no-such-command"],
    ]


DAILY = ("ascii", "nothing open", "full disk")
"""Of the environments, those that are hardest to please."""
OTHERS = tuple(each for each in ENVIRONMENTS if each not in DAILY)
SPOIL_IMPORTS = ("no temporary folder", "no home")


def judge(folder, runs, packages):
    """Run command lines in environments; ``packages`` are imported before, once."""
    done = subprocess.run(
        [sys.executable, environments.__file__, str(folder), *packages],
        input=json.dumps(runs), stdout=subprocess.PIPE, text=True, check=True, timeout=1200,
    )  # fmt: skip
    for (name, line), (status, out, errors) in zip(runs, json.loads(done.stdout), strict=True):
        where = f"{name}: {line}: {status}\n{out[-300:]}\n{errors[-2000:]}"
        assert "Traceback" not in errors, where
        assert status in (0, 1, 2), where  # neither CRASHED nor killed
        if status == 2 and name in ("full disk", "latin-1", "ascii", "no stdin"):
            assert errors.startswith(("error: ", "warning: ", "written: ", "Usage", " ")), where


@pytest.mark.timeout(900)
@pytest.mark.parametrize("names", [DAILY, pytest.param(OTHERS, marks=pytest.mark.long)])
def test_help_ends_without_a_traceback(names, tmp_path):
    every = list(commands())
    assert len(every) > 30
    lines = [["--help"], *([*line, "--help"] for line in every)]
    judge(tmp_path, [(name, line) for name in names for line in lines], ["rich.markdown"])


@pytest.mark.long
@pytest.mark.timeout(900)
def test_cheap_calls_end_without_a_traceback(tmp_path):
    names = [name for name in ENVIRONMENTS if name not in SPOIL_IMPORTS]
    runs = [(name, line) for name in names for line in cheap_calls(tmp_path / name)]
    judge(tmp_path, runs, ["rich.markdown", "torch", "numba", "onnxruntime"])


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", SPOIL_IMPORTS)
def test_cheap_calls_import_what_they_need_without_a_traceback(name, tmp_path):
    judge(tmp_path, [(name, line) for line in cheap_calls(tmp_path / "calls")], [])


@pytest.mark.long
@pytest.mark.parametrize(
    "environment",
    [
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"},
        {"PYTHONIOENCODING": "latin-1"},
    ],
)
@pytest.mark.parametrize("arguments", [["check", DEMO], ["demo", "--speed", "max"]])
def test_real_processes_write_what_their_encoding_lacks_as_numbers(environment, arguments):
    done = subprocess.run(
        [sys.executable, "-m", "hri_predict", *arguments],
        capture_output=True, env=os.environ | environment, check=False, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
    done.stdout.decode(environment["PYTHONIOENCODING"])


@pytest.mark.long
def test_a_path_that_is_not_utf_8_is_read_and_printed(tmp_path):
    bad = os.path.join(os.fsencode(tmp_path), b"caf\xe9")
    os.mkdir(bad)
    path = os.path.join(bad, b"cell.yaml")
    shutil.copy(os.fsencode(DEMO), path)
    missing = os.path.join(bad, b"none.mcap")
    for arguments, status in (([b"check", path], 0), ([b"explain", missing], 2),
                              ([b"check", missing], 2), ([b"service", path], 0)):  # fmt: skip
        done = subprocess.run(
            [os.fsencode(sys.executable), b"-m", b"hri_predict", *arguments],
            capture_output=True, check=False, timeout=600,
        )  # fmt: skip
        assert done.returncode == status, done.stderr
        assert b"Traceback" not in done.stderr
        done.stdout.decode()
        done.stderr.decode()


OPTIONAL = (
    "websockets", "viser", "cv2", "matplotlib", "paho", "zenoh", "rclpy", "asyncua", "scipy",
    "pymodbus", "onnx", "dask", "distributed", "rosbags", "ai_edge_litert",
)  # fmt: skip
WITHOUT_EXTRAS = f"""
import sys
for name in {OPTIONAL}:
    sys.modules[name] = None
from tests.commands import children, root
def every(group, words=()):
    for name, command in children(group).items():
        print(*words, name)
        every(command, (*words, name))
every(root())
"""


def test_every_command_has_a_help_without_any_extra():
    """``make demo`` installs no other extra than ``accel``."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_EXTRAS], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    shown = done.stdout.splitlines()
    assert {"bench links", "bench", "demo", "try"} <= set(shown)
