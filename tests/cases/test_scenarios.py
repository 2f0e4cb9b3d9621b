"""Scenarios in which a moving robot touched a person: a script fails where one does."""

import os
from pathlib import Path

import pytest

from tests.cases import CASES
from tests.processes import python

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = CASES / "scenarios"
pytestmark = pytest.mark.skipif(not SCENARIOS.is_dir(), reason=f"needs {SCENARIOS}")
NAMES = sorted(path.name for path in SCENARIOS.glob("c*.py"))


@pytest.mark.long
@pytest.mark.timeout(900)  # the whole node, up to thirty times
@pytest.mark.parametrize("name", NAMES or [pytest.param("", marks=pytest.mark.skip("no scripts"))])
def test_no_moving_robot_touches_a_person(name):
    paths = os.pathsep.join(map(str, (ROOT, ROOT / "drivers", ROOT / "sim")))
    environment = os.environ | {"PROJECT": str(ROOT), "PYTHONPATH": paths}
    done = python(name, cwd=SCENARIOS, env=environment | {"PYTHONDONTWRITEBYTECODE": "1"})
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
