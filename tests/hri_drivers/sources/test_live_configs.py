"""The shipped configurations of live sources are what the node takes."""

import importlib.util

import pytest

from hri_drivers.sources.live import LiveSource
from hri_predict.base.files import data_path
from hri_predict.run import assemble
from hri_predict.run import config as configuration

NEEDS = {"live_ros2.yaml": "rclpy", "live_ros4hri.yaml": "hri_msgs", "live_zed.yaml": "zed_msgs"}
"""Packages of an extra that a developer's environment may lack."""
LIVE = sorted(
    path.name
    for path in data_path().glob("live_*.yaml")
    if path.name not in NEEDS or importlib.util.find_spec(NEEDS[path.name]) is not None
)


@pytest.mark.parametrize("name", LIVE)
def test_a_shipped_configuration_builds_its_source(name: str) -> None:
    config = configuration.load(configuration.shipped(name))
    source = assemble.build_source(config)
    assert isinstance(source, LiveSource)
    assert not source.connected


def test_each_kind_of_live_source_has_one() -> None:
    kinds = {configuration.load(configuration.shipped(name)).source.kind for name in LIVE}
    assert {"udp", "serial_skeleton", "mvn", "json", "websocket"} <= kinds
    assert {"vmc", "rokoko", "zed_livelink", "natnet", "qualisys"} <= kinds
