"""A simulation's cell refuses settings that would not count as they do in a node."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.run import config as configuration
from hri_sim.simulation.cell import Cell

DOOR = "[{polygon: [[5, -1], [7, -1], [7, 1], [5, 1]]}]"


def written(tmp_path, source="", more=""):
    """The shipped cell with more keys, in a file of its own."""
    text = configuration.shipped("simulate.yaml").read_text(encoding="utf-8")
    text = text.replace("  lead_in_s: 3.0\n", f"  lead_in_s: 3.0\n{source}") + more
    (tmp_path / "cell.yaml").write_text(text, encoding="utf-8")
    config = configuration.load(tmp_path / "cell.yaml").quiet()
    return config.with_predictor("constant_velocity", horizon_s=1.2)


@pytest.mark.parametrize(
    ("source", "more", "key"),
    [
        ("  room_from_source: {xyz: [1, 0, 0]}\n", "", "source.room_from_source"),
        (
            "  room_from_source: {quaternion_xyzw: [0, 0, 1, 0]}\n",
            "",
            "source.room_from_source",
        ),
        ("", f"people: {{exits: {DOOR}}}\n", "people.exits"),
        ("", f"people: {{entrances: {DOOR}}}\n", "people.entrances"),
        ("  faults: [{kind: drop, probability: 0.5}]\n", "", "source.faults"),
        (f"  field_of_view: {DOOR[1:-1]}\n", "", "source.field_of_view"),
    ],
)
def test_what_approaches_cannot_follow_is_refused_with_its_line(tmp_path, source, more, key):
    config = written(tmp_path, source, more)
    with pytest.raises(ConfigError, match=rf"cell\.yaml:\d+: {key}: .*; remove") as error:
        Cell(config)
    assert "\n" not in str(error.value)


def test_a_pose_that_moves_nothing_is_accepted(tmp_path):
    config = written(tmp_path, "  room_from_source: {xyz: [0, 0, 0]}\n")
    assert Cell(config).config.path == tmp_path / "cell.yaml"
