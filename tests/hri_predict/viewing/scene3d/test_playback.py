import pytest

from hri_predict.run.session import Options, run
from hri_predict.viewing.recorded import RecordedPictures
from tests.hri_predict.viewing.staged import cell

pytest.importorskip("viser", reason="the extra viewer is not installed")


@pytest.fixture
def playback(tmp_path):
    from hri_predict.viewing.scene3d.playback import Playback

    path = tmp_path / "cell.mcap"
    run(cell(tmp_path).quiet(), Options(factor=None, duration_s=7.0, record=path))
    shown = Playback(RecordedPictures(path), "127.0.0.1", 0)
    yield shown
    shown.server.stop()


@pytest.mark.long
def test_a_recording_plays_stands_and_goes_where_the_slider_is(playback):
    playback.go(0.0)
    playback.draw(10.0)
    assert playback._at.value == 0.0
    playback._play.value = True
    for tenth in range(1, 11):
        playback.draw(10.0 + tenth / 10)
    assert playback._at.value == pytest.approx(1.0, abs=0.11)  # the slider has tenths
    playback._play.value = False
    playback.draw(20.0)
    assert playback._at.value == pytest.approx(1.0, abs=0.11)

    playback._at.value = 6.5
    playback.draw(20.1)
    assert "arm: STOP" in playback._head.content
    assert playback._at.value == 6.5

    playback._play.value = True
    playback._speed.value = "20"
    for tenth in range(2, 12):
        playback.draw(20.0 + tenth / 10)
    assert not playback._play.value  # at the end it stands
    assert playback._at.value == pytest.approx(playback._recorded.duration_s, abs=0.1)


@pytest.mark.long
def test_a_recording_opens_where_somebody_comes_into_the_scene(playback):
    playback.draw(10.0)
    recorded = playback._recorded
    shown = recorded.at(recorded.start_ns + round(playback._position_s * 1e9))
    assert shown.facts["people"] == [1]
    before = recorded.at(recorded.picture_beside(round(shown.facts["node_s"] * 1e9), -1))
    assert before.facts["people"] == []
    assert playback._at.value == pytest.approx(playback._position_s, abs=0.051)  # in tenths


@pytest.mark.long
def test_buttons_and_keys_go_to_the_next_change_and_the_next_picture(playback):
    recorded = playback._recorded
    changes = [(ns - recorded.start_ns) * 1e-9 for ns, _ in recorded.changes]
    assert len(changes) > 3
    now_s = 10.0

    def press(what: str) -> float:
        nonlocal now_s
        now_s += 0.1
        playback._ask(what, None)
        playback.draw(now_s)
        return playback._position_s

    playback.go(0.0)
    playback.draw(now_s)
    assert press("level >") == pytest.approx(changes[1])
    assert press("level >") == pytest.approx(changes[2])
    assert f"arm: {recorded.changes[2][1]}" in playback._head.content
    assert press("< level") == pytest.approx(changes[1])
    there = press("step >")
    assert 0 < there - changes[1] <= 0.201  # five pictures a second, and one at each change
    assert 0 < press("step >") - there <= 0.201
    assert press("< step") == pytest.approx(there)
    for _ in range(len(changes)):
        press("level >")
    assert playback._position_s == pytest.approx(recorded.duration_s)
    assert press("play or stop") == pytest.approx(recorded.duration_s)


@pytest.mark.long
def test_nobody_can_publish_the_view_beyond_its_address(playback):
    assert playback.server.request_share_url() is None
    assert playback.url.startswith("http://127.0.0.1:")
