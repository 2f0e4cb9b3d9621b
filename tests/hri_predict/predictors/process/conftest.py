"""A package of somebody else, whose predictor misbehaves as it is told."""

import importlib
import sys

import numpy as np
import pytest

from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts import registry
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.process.remote import Job
from hri_predict.predictors.process.runner import ProcessRunner
from tests.packages import third_party

J = len(CANONICAL.joints)

ODD = '''
import asyncio, logging, os, time
from pathlib import Path
import numpy as np
from hri_predict.contracts.predictor import Forecast, PredictorSettings
from hri_predict.base.skeleton import CANONICAL

class OddSettings(PredictorSettings):
    does: str = "good"
    once: str = ""      # a file: it misbehaves while there is none, and makes it then
    reads: str = ""
    def files(self):
        return (Path(self.reads),) if self.reads else ()

class Odd:
    """Does as it is told."""
    settings_model = OddSettings
    def __init__(self, settings, skeleton=CANONICAL):
        self.skeleton, self.rate_hz, self.history_steps, self.horizon_steps = skeleton, 25.0, 5, 4
        self.settings = settings
        if settings.does == "no start":
            raise ValueError("there is no sky")
        if settings.does == "no start, at length":
            raise ValueError("there is no sky " * 20_000)
        if settings.does == "no process":
            os._exit(7)
        if settings.once and os.path.exists(settings.once):  # it is not the first to start
            if settings.does == "start hangs":
                time.sleep(1000)
            if settings.does == "start spins":
                while True:
                    pass
            if settings.does == "start works":  # a fifth of a core, in one call after the other
                end = time.monotonic() + 4.0
                while time.monotonic() < end:
                    until = time.thread_time() + 0.02
                    while time.thread_time() < until:
                        pass
                    time.sleep(0.1)
        logging.getLogger("odd").warning("the sky is %s", "near")
    def predict(self, history, observed):
        people = len(history)
        positions = history[:, -1:] + np.arange(1, 5)[:, None, None]
        good = Forecast(positions, None)
        does, once = self.settings.does, self.settings.once
        if once:
            if os.path.exists(once):
                return good
            Path(once).touch()
        if does == "std":
            return Forecast(positions, np.full((people, 4, len(CANONICAL.joints)), 0.5))
        if does == "raise":
            raise RuntimeError("out of memory")
        if does == "nan":
            return Forecast(np.full(positions.shape, np.nan), None)
        if does == "wrong shape":
            return Forecast(positions[0], None)
        if does == "exit":
            raise SystemExit(0)
        if does == "cancel":
            raise asyncio.CancelledError
        if does == "die":
            os._exit(3)
        if does == "print":
            print("hello", flush=True)
        if does == "hang":
            time.sleep(1000)
        if does == "spin":
            while True:
                pass
        if does == "slow":
            time.sleep(0.05)
        return good
'''


@pytest.fixture
def odd(tmp_path, monkeypatch):
    """The package on the path, found by its entry point."""
    folder = tmp_path / "theirs"
    third_party(folder, "[hri_predict.predictors]\nodd = odd_people_s:Odd\n", odd_people_s=ODD)
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
    yield folder
    sys.modules.pop("odd_people_s", None)


def settings_of(name="odd", **given):
    return validated(registry.predictor_settings(name), {"name": name, **given}, "predictor")


@pytest.fixture
def started(odd):
    """A function that starts a runner with the predictor that is told what to do."""
    runners = []

    def start(deadline_s=0.25, people=4, **given):
        runner = ProcessRunner(Job(settings=settings_of(**given), people=people), deadline_s)
        runners.append(runner)
        runner.wait_until_ready()
        return runner

    yield start
    for runner in runners:
        runner.stop()


def snapshot(people, seed=0, steps=5):
    history = np.random.default_rng(seed).normal(size=(people, steps, J, 3))
    return PeopleSnapshot(
        now_ns=0,
        ids=tuple(range(people)),
        history=history,
        observed=np.ones((people, steps, J), bool),
        capture_ns=np.zeros(people, np.int64),
        last_positions=history[:, -1],
        joint_age_s=np.zeros((people, J)),
        lost=(),
        reasons=(),
        newest_capture_ns=0,
        captures=1,
        counters={},
    )
