import json
import random
from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.recording import read_messages
from hri_predict.recording.mcap.clocks import SystemClocks
from hri_predict.run import session
from hri_predict.run.session import Options, run
from hri_predict.viewing import recorded as recorded_pictures
from hri_predict.viewing.recorded import RecordedPictures
from hri_predict.viewing.room import band_of_text, room_of_text
from hri_predict.viewing.scene3d.panel import details, head
from tests.hri_predict.viewing.staged import BENCH, cell, pictures


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    path = folder / "cell.mcap"
    options = Options(factor=None, duration_s=7.0, record=path)
    run(cell(folder).quiet(), options)
    return path


@pytest.mark.long
def test_a_recording_shows_what_the_live_view_showed(recording):
    recorded = RecordedPictures(recording)
    live = pictures([6.5])[0]
    ns = round(live.facts["node_s"] * 1e9)  # no UTC on the virtual clock
    then = recorded.at(ns)
    assert then is not None
    assert then.facts["people"] == live.facts["people"]
    assert then.facts["room"] == {**live.facts["room"], "cell": then.facts["room"]["cell"]}
    assert then.facts["named"] == live.facts["named"]
    was, is_now = then.facts["robots"][0], live.facts["robots"][0]
    assert (was["name"], was["level"]) == (is_now["name"], is_now["level"])
    # a picture is up to 0.2 s old; nobody walks faster than 2 m/s, no robot here than 1 m/s
    middle = [np.nanmean(each.bodies[..., :6].reshape(-1, 3), axis=0) for each in (then, live)]
    assert np.linalg.norm(middle[0] - middle[1]) < 0.5
    low = [each.robots[:, :3].min(axis=0) for each in (then, live)]
    np.testing.assert_allclose(low[0], low[1], atol=0.3)
    assert then.bodies.shape == live.bodies.shape
    np.testing.assert_allclose(then.bodies[..., 6], live.bodies[..., 6], atol=1e-6)  # radii
    assert then.zones.shape[0] == then.forecast.shape[0] == 1


@pytest.mark.long
def test_the_line_joins_the_deciding_pair_as_in_the_live_view(recording):
    live = pictures([6.4])[0]  # a tick of which a picture was recorded: five a second are
    then = RecordedPictures(recording).at(round(live.facts["node_s"] * 1e9))
    assert then is not None
    assert then.facts["node_s"] == live.facts["node_s"]
    was, is_now = then.facts["robots"][0], live.facts["robots"][0]
    np.testing.assert_allclose(was["line"], is_now["line"], atol=0.001)  # recorded in millimetres
    assert (was["apart"], was["pair"]) == (is_now["apart"], is_now["pair"])
    assert is_now["pair"].startswith("person 1's ")


@pytest.mark.long
def test_it_says_levels_and_reasons_as_the_live_view_says_them(recording):
    live = pictures([5.2, 6.4])
    recorded = RecordedPictures(recording)
    for each in live:
        then = recorded.at(round(each.facts["node_s"] * 1e9))
        assert then is not None
        assert (then.facts["state"], then.facts["reasons"]) == (
            each.facts["state"],
            each.facts["reasons"],
        )
        was, is_now = then.facts["robots"][0], each.facts["robots"][0]
        for name in ("level", "reason", "clears"):
            assert was[name] == is_now[name], name


def test_a_recording_without_people_opens_where_the_level_first_changes(recording, monkeypatch):
    def nobody(*args, **kwargs):
        for told in read_messages(*args, **kwargs):
            if told.topic.startswith("/advice"):
                told = replace(told, data={**told.data, "separation_m": None})
            yield told

    somebody = RecordedPictures(recording)
    monkeypatch.setattr(recorded_pictures, "read_messages", nobody)
    recorded = RecordedPictures(recording)
    assert recorded.first_ns == recorded.changes[1][0]
    assert somebody.first_ns != recorded.first_ns


def test_the_timeline_has_the_levels_of_the_recording(recording):
    recorded = RecordedPictures(recording)
    levels = recorded.levels(70)
    assert levels[0] == "UNKNOWN"  # the node starts
    assert {"SLOW", "STOP"} <= set(levels)
    assert recorded.level_at(recorded.end_ns) == recorded.changes[-1][1]


def test_a_picture_says_the_level_of_its_moment_not_of_the_last_scene(recording):
    """Scenes are recorded five times a second, advice with each tick."""
    recorded = RecordedPictures(recording)
    for ns, level in recorded.changes[1:]:
        then = recorded.at(ns)
        assert then is not None
        assert then.facts["robots"][0]["level"] == level


def test_outside_of_a_recording_there_is_nothing(recording):
    recorded = RecordedPictures(recording)
    assert recorded.at(recorded.start_ns - 5_000_000_000) is None
    assert recorded.at(recorded.end_ns + 90_000_000_000) is None


@pytest.mark.parametrize("step_s", [-3600.0, -2.5, 0.5, 7200.0])
def test_a_wall_clock_that_was_set_changes_no_level_and_no_picture(
    recording, tmp_path, monkeypatch, step_s
):
    """Set back, it gave two moments one time, and the later one the levels of the earlier."""

    def clocks(clock, *_):
        began_ns = clock.now_ns()
        return SystemClocks(
            clock, boot_ns=clock.now_ns, utc_ns=lambda: utc_ns(clock.now_ns(), began_ns)
        )

    def utc_ns(now_ns, began_ns):
        is_later = now_ns - began_ns > 5_500_000_000  # shortly before the robot stops
        return 1_700_000_000_000_000_000 + now_ns + is_later * round(step_s * 1e9)

    monkeypatch.setattr(session, "clocks_of", clocks)
    path = tmp_path / "cell.mcap"
    run(cell(tmp_path).quiet(), Options(factor=None, duration_s=7.0, record=path))
    steady, stepped = RecordedPictures(recording), RecordedPictures(path)
    assert stepped.changes == steady.changes
    assert stepped.levels(70) == steady.levels(70)
    shown = list[str]()
    for ns in range(steady.start_ns, steady.end_ns, 100_000_000):
        was, then = steady.at(ns), stepped.at(ns)
        assert (was is None) == (then is None)
        if was is not None and then is not None:
            assert without_utc(then) == without_utc(was)
            shown.append(then.facts["utc"])
    assert (shown == sorted(shown)) == (step_s > 0)


def without_utc(picture):
    """The facts but for UTC and the cell's name, which the file's differs by."""
    room = {**picture.facts["room"], "cell": ""}
    return {**picture.facts, "utc": "", "room": room}


def test_a_cut_recording_is_shown_to_the_cut(recording, tmp_path):
    cut = tmp_path / "cut.mcap"
    data = recording.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    recorded = RecordedPictures(cut)
    assert 0 < recorded.duration_s < RecordedPictures(recording).duration_s
    assert recorded.at(recorded.end_ns) is not None


def test_the_coverage_is_that_of_the_live_view(recording):
    recorded = RecordedPictures(recording)
    then, live = recorded.at(recorded.end_ns), pictures([1.0])[0]
    assert then is not None
    assert then.facts["coverage"] == live.facts["coverage"] != ""


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_recording_is_shown_or_refused_in_one_line(recording, tmp_path, seed):
    drawn = random.Random(seed)
    data = bytearray(recording.read_bytes())
    for _ in range(drawn.choice((1, 5, 50))):
        data[drawn.randrange(len(data))] = drawn.randrange(256)
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data[: drawn.choice((len(data), drawn.randrange(len(data))))])
    said = f"recording {damaged}: "
    try:
        recorded = RecordedPictures(damaged)
        recorded.levels(50)
        for k in range(3):
            recorded.at(recorded.start_ns + (recorded.end_ns - recorded.start_ns) * k // 2)
    except RecordingError as error:
        said = str(error)
    assert said.startswith(f"recording {damaged}: ")
    assert "\n" not in said


@pytest.mark.parametrize("value", [None, "x", [], {}, True, -1, 1e308, 10**30])
@pytest.mark.parametrize("key", ["level", "reason", "grounds", "speed_limit_m_s", "detail"])
def test_an_odd_message_is_shown_or_refused_in_one_line(recording, monkeypatch, key, value):
    def odd(*args, **kwargs):
        for told in read_messages(*args, **kwargs):
            if told.topic.startswith("/advice"):
                told = replace(told, data={**told.data, key: value})
            yield told

    monkeypatch.setattr(recorded_pictures, "read_messages", odd)
    said = ""
    try:
        recorded = RecordedPictures(recording)
        recorded.levels(50)
        found = recorded.at(recorded.end_ns)
        assert found is not None
        assert head(found.facts) + details(found.facts)
    except RecordingError as error:
        said = str(error)
    assert said == "" or "damaged" in said


def test_another_file_is_refused_with_the_remedy(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(RecordingError, match="name another file"):
        RecordedPictures(other)


def test_the_regions_come_from_the_configuration_as_recorded(tmp_path):
    text = cell(tmp_path).path.read_text()
    room = room_of_text(text, "press-4")
    assert room["named"][0]["name"] == BENCH["name"]
    assert room["view"]["z_max"] == 2.6


def test_the_band_comes_from_the_configuration_as_recorded():
    assert band_of_text("risk: {band_m: 0.05}") == 0.05
    assert band_of_text("risk:\nsource: {}") == 0.1  # the default
    assert band_of_text("risk: {band_m: x}") is None


@pytest.mark.parametrize(
    "text", ["", "]", "source: 3", "source: {field_of_view: {polygon: x}}", json.dumps({"a": 1})]
)
def test_a_configuration_that_makes_no_sense_has_no_regions(text):
    assert band_of_text(text) in (None, 0.1)
    room = room_of_text(text, "x")
    assert room.pop("cell") == "x"
    assert not any(room.values())
