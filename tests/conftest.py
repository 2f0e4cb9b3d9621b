"""For all tests: they run side by side, and on machines that are busy with other things."""

import gc
import os
import signal
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import cache

import pytest
from hypothesis import HealthCheck, settings

from tests.slow import function_of, slow_tests
from tests.together import LONG, REAL_TIME, names

# each process computes on one core; before torch and numpy are imported, and inherited
os.environ.setdefault("OMP_NUM_THREADS", "1")

# the tests themselves are a million objects: look through them less often
gc.set_threshold(100_000, 50, 50)

# a shell without job control ignores Ctrl-C for what it starts in the background, and so would
# every process that a test starts and ends by it
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A property is checked with the same examples in each run, EXAMPLES of them, so that a commit that
# passed passes again; RANDOM_EXAMPLES=1 draws others each time, as `make test-random` does. How
# long an example takes, or takes to make, says nothing about the code here.
settings.register_profile(
    "patient",
    settings(),
    max_examples=int(os.environ.get("EXAMPLES", "15")),
    derandomize="RANDOM_EXAMPLES" not in os.environ,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("patient")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow tests as long; find tests that ``tests.together`` would not run."""
    for item in items:
        if function_of(item) in slow_tests():
            item.add_marker(pytest.mark.long)
    missed = _missed((i for i in items if i.get_closest_marker("realtime")), REAL_TIME)
    missed += _missed((i for i in items if _long(i)), LONG)
    if missed:
        raise pytest.UsageError(f"tests.together would not find {', '.join(missed)}")
    if share := os.environ.pop("SHARE", None):  # not for tests that a test runs
        items[:] = _share(items, *map(int, share.split("/")))


def _share(items: list[pytest.Item], first: int, of: int) -> list[pytest.Item]:
    """Return each ``of``-th, as their names fall."""
    return [item for item in items if zlib.crc32(item.nodeid.encode()) % of == first % of]


def _long(item: pytest.Item) -> bool:
    checks_property = getattr(getattr(item, "obj", None), "is_hypothesis_test", False)
    return checks_property or item.get_closest_marker("long") is not None


def _missed(items: Iterable[pytest.Item], words: tuple[str, ...]) -> list[str]:
    return sorted(str(path) for path in {item.path for item in items} if not names(path, words))


@pytest.fixture(scope="module")
def built_once() -> Iterator[None]:
    """Predictors of the same settings are one: to build a network takes half a second."""
    from hri_predict.predictors.building import predictor_of
    from hri_predict.run import assemble

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(assemble, "predictor_of", cache(predictor_of))
        yield


@pytest.fixture
def no_matplotlib(monkeypatch: pytest.MonkeyPatch) -> str:
    """Hide matplotlib, as on an installation without extras; the line that says so."""
    from hri_predict.base.installed import for_this_installation

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.delitem(sys.modules, "hri_predict.base.figures", raising=False)
    return for_this_installation(
        "plots need matplotlib; install it with: pip install 'hri-predict[plots]'"
    )


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command line; gives exit status, standard output, standard error."""
    from tests.commands import status_of

    def call(*arguments: object) -> tuple[int, str, str]:
        status = status_of(*arguments)
        out, err = capsys.readouterr()
        return status, out, err

    return call
