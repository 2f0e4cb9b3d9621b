"""Controllers for the tests; all end with the test."""

from collections.abc import Callable, Iterator

import pytest

from tests.hri_drivers.links.rtde.rtde_robot import Robot


@pytest.fixture
def robot() -> Iterator[Callable[..., Robot]]:
    """Starts made-up controllers."""
    started: list[Robot] = []

    def start(*options: str, port: int = 0) -> Robot:
        started.append(Robot(*options, port=port))
        return started[-1]

    yield start
    for each in started:
        each.kill()
