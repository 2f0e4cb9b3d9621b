"""A damaged package of others costs one line of warning, and nothing else."""

import json
import os
import sys
from types import SimpleNamespace

import pytest

from hri_predict.base import installed
from tests.packages import third_party
from tests.processes import hri_predict, python

DAMAGED = {
    "no pair": b"garbage here\n[x\n\n[console_scripts]\nnonsense\n",
    "not UTF-8": b"[console_scripts]\ncaf\xe9 = a:b\n",
}
USES = {
    "pydantic": "class A(pydantic.BaseModel): ...",
    "torch": "",
    "numba": "from numba.core import entrypoints; entrypoints.init_all()",
    "can": "import can.interfaces",
}
"""Libraries that look for plug-ins in all packages -> code that makes them do so."""


@pytest.fixture(params=[*DAMAGED.values()], ids=[*DAMAGED])
def environment(request, tmp_path) -> dict[str, str]:
    """The environment of a program that finds a damaged package on its path."""
    third_party(tmp_path, request.param)
    path = [*filter(None, [os.environ.get("PYTHONPATH")]), str(tmp_path)]
    ours = {k: v for k, v in os.environ.items() if k != "HRI_PREDICT_OWN_PROCESS"}
    return ours | {"PYTHONPATH": os.pathsep.join(path), "COLUMNS": "200"}


def test_a_command_goes_on_after_one_line_that_names_the_package(environment, tmp_path):
    done = hri_predict("predictors", env=environment, cwd=tmp_path)
    assert (done.returncode, "constant_velocity" in done.stdout) == (0, True)
    line = done.stderr.strip()
    assert "\n" not in line
    assert "warning: package 'theirs'" in line
    assert str(tmp_path) in line
    assert "reinstall" in line


@pytest.mark.parametrize("library", USES)
def test_a_process_of_ours_tolerates_it_for_every_library(environment, library, tmp_path):
    code = f"import hri_predict, {library}\n{USES[library]}\nprint('on')"
    began = environment | {"HRI_PREDICT_OWN_PROCESS": "1"}  # as the command line starts it
    done = python("-c", code, env=began, cwd=tmp_path)
    assert (done.stdout, done.stderr) == ("on\n", "")


def test_a_program_that_imports_the_library_keeps_its_own_metadata(environment, tmp_path):
    code = (
        "import os; from importlib import metadata; before = metadata.Distribution.entry_points\n"
        "import hri_predict; from hri_predict.base import installed\n"
        "names = {point.name for point in installed.entry_points()}\n"
        "assert 'kalman' in names\n"
        "assert metadata.Distribution.entry_points is before\n"
        "assert 'HRI_PREDICT_OWN_PROCESS' not in os.environ\n"
    )
    done = python("-c", code, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_damaged_metadata_does_not_hide_what_a_package_registers(environment, tmp_path):
    info = tmp_path / "theirs-1.0.dist-info"
    (info / "METADATA").write_bytes(b"Name: caf\xe9\n")
    (info / "entry_points.txt").write_text("[hri_predict.predictors]\nodd = nowhere_at_all:Odd\n")
    code = (
        "from hri_predict.contracts import registry\n"
        "assert 'odd' in registry.names('predictors')\n"
        "assert not registry.is_ours('predictors', 'odd')\n"
        "assert registry.is_ours('predictors', 'kalman')\n"
    )
    done = python("-c", code, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("about", "said"),
    [
        (
            {"url": "file:///srv/my%20clone", "dir_info": {"editable": True}},
            f"{sys.executable} -m pip install -c '/srv/my clone/constraints.txt' "
            "-e '/srv/my clone[udp,viewer]'",
        ),
        ({"url": "file:///srv/clone", "dir_info": {}}, "pip install 'hri-predict[udp,viewer]'"),
        (None, "pip install 'hri-predict[udp,viewer]'"),
    ],
)
def test_an_extra_is_installed_from_the_clone_that_runs(monkeypatch, about, said):
    text = None if about is None else json.dumps(about)
    here = SimpleNamespace(read_text=lambda _: text)
    monkeypatch.setattr(installed.metadata, "distribution", lambda _: here)
    message = "needs msgpack; install it with: pip install 'hri-predict[udp,viewer]'"
    assert installed.for_this_installation(message) == f"needs msgpack; install it with: {said}"
    assert installed.for_this_installation("pip install pyk4a") == "pip install pyk4a"
