"""The daily tests that cost most, in ``slow.txt``: they run with the long ones.

``python -m tests.slow`` runs all tests that are not marked ``long``, one after another, measures
each, and writes ``slow.txt`` anew, so that the others keep within ``BUDGET_S`` on two cores. Tests
in real time count by the time that passes, the others by processor time. Each file of tests keeps
its cheapest test in the day, if that costs less than ``KEPT_S``, and ``ALWAYS`` all of theirs.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TABLE = Path(__file__).with_name("slow.txt")
BUDGET_S = {"realtime": 75.0, "others": 165.0}
"""Sum over all tests that stay in the day; two run at a time."""
KEPT_S = 2.0
ALWAYS = (
    # They judge each change, whatever it is about.
    "tests/test_layout.py",
    "tests/test_english.py",
    "tests/test_readme.py::test_command",
    # They alone find a break of ``tests.broken``.
    "tests/hri_predict/cli/test_real_time.py::test_listen_hears_the_node_from_its_start_to_its_end",
    "tests/hri_predict/library/test_spread.py::test_nine_tenths_of_a_normal_distribution",
    "tests/hri_sim/fault_table/test_incident.py::test_a_story_in_which_all_goes_well_holds",
)
"""Tests that stay in the day whatever they cost, by the start of their names."""
_MEASURED = "SLOW_MEASURED"


@cache
def slow_tests() -> frozenset[str]:
    """The names of ``slow.txt``: node ids without parameters."""
    return frozenset(TABLE.read_text("utf-8").split())


@cache
def slow_files() -> frozenset[str]:
    """The files that hold these tests, relative to the root."""
    return frozenset(name.split("::")[0] for name in slow_tests())


def function_of(item: pytest.Item) -> str:
    """The node id of a test without its parameters."""
    return item.nodeid.split("[")[0]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note what a test cost, its fixtures included."""
    before, began = _processor_s(), time.monotonic()
    result = yield
    passed, used = time.monotonic() - began, _processor_s() - before
    real = item.get_closest_marker("realtime") is not None
    kind, cost = ("realtime", passed) if real else ("others", used)
    with Path(os.environ[_MEASURED]).open("a", encoding="utf-8") as file:
        file.write(f"{kind} {cost:.3f} {function_of(item)}\n")
    return result


def _processor_s() -> float:
    spent = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in spent)


def too_slow(costs: Iterable[tuple[str, str, float]]) -> list[str]:
    """The most expensive functions, without which the others keep within the budgets.

    ``costs``: kind and name of a function, and the seconds of one of its tests.
    """
    total: dict[str, float] = defaultdict(float)
    kinds = {}
    for kind, name, cost_s in costs:
        total[name] += cost_s
        kinds[name] = kind
    dearest = sorted(total, key=lambda name: (-total[name], name))
    cheapest = {name.split("::")[0]: name for name in dearest}
    kept = {name for name in cheapest.values() if total[name] < KEPT_S}
    found = []
    for kind, budget_s in BUDGET_S.items():
        own = [name for name in dearest if kinds[name] == kind]
        left_s = sum(total[name] for name in own)
        for name in own:
            if left_s > budget_s and name not in kept and not name.startswith(ALWAYS):
                found.append(name)
                left_s -= total[name]
    return found


def main(arguments: list[str]) -> int:
    """Measure, or with a file's name take what it holds, and write the table."""
    if arguments:
        lines = Path(arguments[0]).read_text("utf-8").splitlines()
    else:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "measured"
            before = TABLE.read_text("utf-8")
            TABLE.write_text("", encoding="utf-8")  # so that all of them run
            command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.slow", "-m", "not long"]
            status = subprocess.run(command, env={**os.environ, _MEASURED: str(file)}, cwd=ROOT)
            TABLE.write_text(before, encoding="utf-8")
            if status.returncode != 0:
                return status.returncode
            lines = file.read_text("utf-8").splitlines()
    parts = (line.split(" ", 2) for line in lines)
    slow = sorted(too_slow((kind, name, float(cost)) for kind, cost, name in parts))
    TABLE.write_text("\n".join(slow) + "\n", encoding="utf-8")
    print(f"{len(slow)} functions are slow")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
