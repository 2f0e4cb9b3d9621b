"""A ROS domain for each test."""

import itertools
import os

import pytest

DOMAINS = itertools.count(1 + os.getpid() % 90)


@pytest.fixture
def domain() -> int:
    return next(DOMAINS)
