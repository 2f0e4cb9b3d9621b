"""The source that replays a recording in a cell."""

from pathlib import Path

import pytest

from hri_predict.base.settings import validated
from hri_predict.cli.run import played
from hri_predict.run import config as configuration
from hri_sim.replay import RecordingSettings

CELL = configuration.load(configuration.shipped("live_udp.yaml")).source
SEEN = {"keeps_ids": False, "even_captures": False}


@pytest.mark.parametrize(("name", "of_the_node"), [("monday.mcap", True), ("walk.bvh", False)])
def test_people_of_the_node_s_own_recordings_are_judged_as_live(
    name: str, of_the_node: bool
) -> None:
    """Otherwise a lost person whose id comes back would be found in the replay alone."""
    cell = CELL.model_copy(update=SEEN)
    source = validated(RecordingSettings, played(cell, Path(name)), "source")
    own = RecordingSettings(path=name, kind="recording")
    for key, value in SEEN.items():
        assert getattr(source, key) == (value if of_the_node else getattr(own, key))
