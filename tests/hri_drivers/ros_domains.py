"""ROS domains, of which each test has its own: nodes of one do not hear those of another."""

import itertools
import os
from collections.abc import Iterator

_WORKERS, _EACH = 4, 24


def domains(first: int) -> Iterator[int]:
    """Domains of this process, from ``first`` + 1 to ``first`` + 96, again and again.

    Those of a worker of pytest-xdist differ from those of the others.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % _WORKERS
    begin = first + 1 + _EACH * worker
    # two runs on one machine seldom begin with the same
    shift = os.getpid() % _EACH
    return itertools.cycle(begin + (shift + k) % _EACH for k in range(_EACH))
