"""A robot placed where no person is seen, and an exit as large as the hall, are refused."""

from typing import Any

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.run import assemble
from hri_predict.run.places import place_notes
from tests.hri_predict.run.review.cells import cell

ARM = "room_from_robot: {xyz: [0, 0, 0]"
VIEW = "  kind: procedural\n  field_of_view: {polygon: [[-3, -3], [3, -3], [3, 3], [-3, 3]]}\n"
FAR_VIEW = "  kind: procedural\n  field_of_view: {polygon: [[30, 0], [33, 0], [33, 3], [30, 3]]}\n"
ROOM = "people: {room: {polygon: [[-3, -3], [3, -3], [3, 3], [-3, 3]]}, "


def built(config):
    transports: dict[str, Any] = {"plc": object()}
    return assemble.build(config, VirtualClock(), transports=transports)


@pytest.mark.parametrize(
    "xyz", ["800, 0, 0", "0, -800, 0", "100.5, 0, 0", "0, 0, 900", "80, 0, 0", "31.5, 0, 0"]
)
def test_a_robot_in_millimetres_centimetres_or_inches_is_refused(tmp_path, xyz):
    with pytest.raises(ConfigError, match=r"robots\.0\.room_from_robot.*metres are meant"):
        built(cell(tmp_path, (ARM, f"room_from_robot: {{xyz: [{xyz}]")))


@pytest.mark.parametrize("xyz", ["0.8, 0, 0", "5, 5, 0", "0, -12, 0.7"])
def test_a_robot_in_metres_is_accepted(tmp_path, xyz):
    built(cell(tmp_path, (ARM, f"room_from_robot: {{xyz: [{xyz}]")))


def test_the_origin_may_be_far_away_if_source_and_robot_are_together(tmp_path):
    built(
        cell(
            tmp_path,
            (ARM, "room_from_robot: {xyz: [60, 40, 0]"),
            ("room_from_source: {xyz: [0, 0, 0]", "room_from_source: {xyz: [62, 40, 2]"),
        )
    )


def test_a_source_in_centimetres_is_refused_as_well(tmp_path):
    with pytest.raises(ConfigError, match="so no person would be seen near it"):
        built(
            cell(
                tmp_path,
                ("room_from_source: {xyz: [0, 0, 0]", "room_from_source: {xyz: [60, 40, 2]"),
            )
        )


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (
            [
                ("source: {xyz: [0, 0, 0]", "source: {xyz: [-20, 0, 1.9]"),
                ("start: [1.0, 0.1]", "start: [-20, 0]"),
            ],
            "cell.yaml:4: source.room_from_source",
        ),
        (
            [("  kind: procedural\n", FAR_VIEW)],
            "cell.yaml:4: source.field_of_view",
        ),
        ([(ARM, "room_from_robot: {xyz: [30, 0, 0.75]")], "cell.yaml:10: robots.0.room_from_robot"),
    ],
)
def test_the_key_that_is_far_from_the_origin_is_named_without_a_guess_of_millimetres(
    tmp_path, changes, key
):
    with pytest.raises(ConfigError, match=rf"{key}: .*\(metres are meant\)"):
        built(cell(tmp_path, *changes))


@pytest.mark.parametrize("what", [("  kind: procedural\n", VIEW), ("people: {", ROOM)])
def test_a_robot_outside_of_what_is_seen_or_of_the_walls_is_refused(tmp_path, what):
    built(cell(tmp_path, what, (ARM, "room_from_robot: {xyz: [5, 0, 0]")))
    with pytest.raises(ConfigError, match=r"field_of_view|people\.room"):
        built(cell(tmp_path, what, (ARM, "room_from_robot: {xyz: [9, 0, 0]")))


def test_check_notes_a_robot_that_is_far_from_the_source(tmp_path):
    near, far = (cell(tmp_path, (ARM, f"room_from_robot: {{xyz: [{x}, 0, 0]")) for x in ("3", "12"))
    assert place_notes(near, assemble.build_robots(near)) == []
    (note,) = place_notes(far, assemble.build_robots(far))
    assert note.startswith("robot arm: its reach ends 9.39 m")


@pytest.mark.parametrize(
    ("polygon", "fits"),
    [("[[3, 3], [4, 3], [4, 4]]", True), ("[[3, 3], [27, 3], [27, 11.6], [3, 11.6]]", False)],
)
def test_an_exit_as_large_as_the_hall_is_refused(tmp_path, polygon, fits):
    config = cell(tmp_path, ("people: {", f"people: {{exits: [{{polygon: {polygon}}}], "))
    if fits:
        built(config)
        return
    with pytest.raises(ConfigError, match=r"people\.exits\.0: 206 m2 is too large for an exit"):
        built(config)


@pytest.mark.parametrize("key", ["exits", "entrances"])
def test_a_door_in_centimetres_is_refused(tmp_path, key):
    door = "{polygon: [[60, 50], [65, 50], [65, 55], [60, 55]]}"
    with pytest.raises(ConfigError, match=rf"people\.{key}\.0: .*metres are meant"):
        built(cell(tmp_path, ("people: {", f"people: {{{key}: [{door}], ")))


def test_a_zone_in_centimetres_is_refused(tmp_path):
    zone = "{name: hatch, polygon: [[50, -80], [90, -80], [90, -50]], level: slow}"
    with pytest.raises(ConfigError, match=r"zones\.0: .*where nothing is observed"):
        built(cell(tmp_path, ("risk: {", f"zones: [{zone}]\nrisk: {{")))
