"""Compiled loops: the same results, nothing written outside the cache, and none needed."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hri_predict.base.machine.compiled import why_not_compiled
from tests.processes import python

KERNEL = """
import numpy as np
from hri_predict.base.machine.compiled import is_compiled, kernel, part

@part
def squared(x):
    return x * x

def _loops(rows):
    total = 0.0
    for i in range(rows.shape[0]):
        total += squared(rows[i])
    return total

def _arrays(rows):
    return float((rows * rows).sum())

sum_of_squares = kernel(_loops, _arrays)
if __name__ == "__main__":
    print(is_compiled(), sum_of_squares(np.arange(4.0)))
"""


def run(folder: Path, **environment: str) -> str:
    (folder / "loops.py").write_text(KERNEL, encoding="utf-8")
    whole = {**os.environ, "HOME": str(folder / "home"), **environment}
    whole.pop("XDG_CACHE_HOME", None)
    done = python("loops.py", cwd=folder, env=whole, check=True)
    return done.stdout.strip()


@pytest.mark.long
def test_numba_computes_and_keeps_its_copy_in_the_cache_alone(tmp_path):
    pytest.importorskip("numba", reason="extra accel is not installed")
    cache = tmp_path / "cache"
    assert run(tmp_path, HRI_PREDICT_CACHE=str(cache)) == "True 14.0"
    assert list(cache.rglob("*.nbi"))
    outside = {p.name for p in tmp_path.rglob("*") if cache not in p.parents}
    assert outside <= {"cache", "loops.py"}
    assert run(tmp_path, HRI_PREDICT_CACHE=str(cache)) == "True 14.0"  # from the copy


@pytest.mark.long
def test_without_a_cache_nothing_is_written(tmp_path):
    pytest.importorskip("numba", reason="extra accel is not installed")
    assert run(tmp_path, HRI_PREDICT_CACHE="") == "True 14.0"
    assert {p.name for p in tmp_path.rglob("*")} == {"loops.py"}


@pytest.mark.long
def test_a_cache_that_cannot_be_written_is_not_needed(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert run(tmp_path, HRI_PREDICT_CACHE=str(blocked)).endswith(" 14.0")


def test_arrays_compute_where_numba_is_turned_off(tmp_path):
    assert run(tmp_path, HRI_PREDICT_COMPILED="0") == "False 14.0"


MOVED = """
from typing import NamedTuple

from hri_predict.base.machine.compiled import is_compiled, kernel
from loops import _loops

class NAME(NamedTuple):
    x: float

total = kernel(_loops, lambda rows: -1.0)
if __name__ == "__main__":
    print(is_compiled(), total(NAME(3.0)))
"""
TAKES_X = """
def _loops(row):
    return row.x * 2.0
"""


@pytest.mark.long
def test_a_kept_copy_whose_types_have_moved_is_made_again(tmp_path):
    """As after an update: the loops' file is the same, and the type has another name."""
    pytest.importorskip("numba", reason="extra accel is not installed")
    (tmp_path / "loops.py").write_text(TAKES_X)
    environment = {**os.environ, "HRI_PREDICT_CACHE": str(tmp_path / "cache")}
    for name in ("Before", "After", "After"):
        (tmp_path / "caller.py").write_text(MOVED.replace("NAME", name))
        code = "import caller; print(caller.is_compiled(), caller.total(caller.NAME(3.0)))"
        done = python("-c", code.replace("NAME", name), cwd=tmp_path, env=environment, check=True)
        assert done.stdout.strip() == "True 6.0"
        assert done.stderr == ""


FAILING = """
import logging
from hri_predict.base.machine.compiled import kernel

def _loops(x):
    return {}.nothing(x)  # numba knows no such thing

first, second = kernel(_loops, lambda x: x + 1), kernel(_loops, lambda x: x + 2)
if __name__ == "__main__":
    logging.basicConfig()
    print(first(1), first(2), second(1))
"""


@pytest.mark.long
def test_a_loop_that_cannot_be_compiled_falls_back_to_arrays_with_one_line(tmp_path):
    pytest.importorskip("numba", reason="extra accel is not installed")
    (tmp_path / "failing.py").write_text(FAILING, encoding="utf-8")
    environment = {**os.environ, "HRI_PREDICT_CACHE": ""}
    done = python("failing.py", cwd=tmp_path, env=environment, check=True)
    assert done.stdout.split() == ["2", "3", "3"]
    assert done.stderr.count("compiled loops fail") == 1


def test_it_says_why_arrays_compute(monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_COMPILED", "0")
    assert why_not_compiled() == "HRI_PREDICT_COMPILED is 0"
    monkeypatch.setenv("HRI_PREDICT_COMPILED", "1")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    assert "pip install 'hri-predict[accel]'" in why_not_compiled()


def test_numba_does_not_bring_scipy_which_is_there_for_others():
    pytest.importorskip("numba", reason="extra accel is not installed")
    pytest.importorskip("scipy", reason="nothing brings it here")
    code = (
        "import sys\n"
        "from hri_predict.base.machine.compiled import is_compiled\n"
        "assert is_compiled()\n"
        "import numba\n"
        "assert numba.njit(lambda x: 2.0 * x)(1.0) == 2.0\n"
        "assert 'scipy.linalg' not in sys.modules\n"
        "import scipy.linalg.cython_blas\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
