"""A ROS domain for each test."""

import pytest

from tests.hri_drivers.ros_domains import domains

DOMAINS = domains(0)


@pytest.fixture
def domain() -> int:
    return next(DOMAINS)
