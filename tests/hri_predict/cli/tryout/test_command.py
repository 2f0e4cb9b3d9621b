"""What ``hri-predict try`` starts, and what it refuses."""

import sys
import threading

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import HriPredictError
from hri_predict.cli.commands import app
from hri_predict.cli.tryout import command
from hri_predict.cli.tryout import command as cameras
from tests.hri_predict.cli.tryout.test_camera import FAILS, SENDS, UNTIL_INPUT_ENDS

pytest.importorskip("viser", reason="the extra viewer is not installed")


@pytest.fixture
def runs(monkeypatch):
    """The runs that ``try`` would start: the configuration, and whether it can be stopped."""
    kept = []
    monkeypatch.setattr(command, "go", lambda config, *args, stop=None: kept.append((config, stop)))
    return kept


def started(monkeypatch, code, *words):
    monkeypatch.setattr(cameras, "COMMAND", [sys.executable, "-c", code])
    return CliRunner().invoke(app, ["try", "--no-browser", *words])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--video", "a.mp4", "--person"], "--video and --person: give one of them"),
        (["--robot", "here"], "--robot here: give X,Y or X,Y,YAW"),
        (["--seconds", "0"], "--seconds 0.0: give a number above 0"),
        (["--seconds", "nan"], "--seconds nan: give a number above 0"),
        (["--viewer", "70000"], "give a port from 0 to 65535"),
        (["--person", "--", "--height", "1.8"], "--height 1.8: has no effect with --person"),
    ],
)
def test_a_mistake_is_one_line(words, said):
    result = CliRunner().invoke(app, ["try", "--no-browser", *words])
    assert isinstance(result.exception, HriPredictError)
    assert said in str(result.exception)
    assert "\n" not in str(result.exception)


def test_with_a_camera_the_node_listens_to_it(runs, monkeypatch):
    result = started(monkeypatch, SENDS + UNTIL_INPUT_ENDS, "--robot", "2,1")
    assert result.exception is None
    ((config, stop),) = runs
    assert config.source.kind == "udp"
    assert config.node.robots[0].room_from_robot.xyz == [2.0, 1.0, 0.0]
    assert isinstance(stop, threading.Event)


def test_without_a_camera_one_line_says_so_and_the_demos_person_comes(runs, monkeypatch):
    result = started(monkeypatch, FAILS)
    assert result.exception is None
    (notice,) = [line for line in result.stderr.splitlines() if "none found" in line]
    assert notice == "no camera: camera 0: none found; showing the demo's person instead"
    ((config, _),) = runs
    assert config.source.kind == "procedural"


@pytest.mark.parametrize(
    ("words", "handed_on"),
    [
        ([], "0 --max-fps 15"),
        (["--camera", "3"], "3 --max-fps 15"),
        (["--video", "a.mp4"], "a.mp4 --loop --max-fps 15"),
        (["--", "--height", "1.8"], "0 --max-fps 15 --height 1.8"),
    ],
)
def test_the_camera_gets_its_input_and_the_options_after_two_dashes(
    runs, monkeypatch, words, handed_on
):
    says = "import sys\nprint(*sys.argv[1:sys.argv.index('--host')], file=sys.stderr, flush=True)"
    result = started(monkeypatch, says + SENDS + UNTIL_INPUT_ENDS, *words)
    assert result.exception is None
    assert f"camera: {handed_on}\n" in result.stderr
    ((config, _),) = runs
    assert config.source.declares_noise == ("--loop" not in handed_on)  # it plays the same again


@pytest.mark.parametrize(
    "words", [["--video", "a.mp4"], ["--camera", "3"], ["--", "--height", "1.8"]]
)
def test_an_input_that_was_asked_for_is_not_replaced(runs, monkeypatch, words):
    result = started(monkeypatch, FAILS, *words)
    video = [] if "--video" in words else ["--video FILE plays a video"]
    remedies = [*video, "--person shows the demo's person"]
    assert str(result.exception) == f"camera 0: none found; {', '.join(remedies)}"
    assert runs == []


def test_a_camera_that_ended_meanwhile_is_the_reason_of_the_end(monkeypatch):
    """The node stops, and the last line says why."""
    waited = []
    monkeypatch.setattr(command, "go", lambda *args, stop: waited.append(stop.wait(60.0)))
    result = started(
        monkeypatch, SENDS + "\nprint('error: camera 0: a fault', file=sys.stderr); exit(2)"
    )
    assert waited == [True]
    assert str(result.exception) == "camera 0: a fault"


def test_a_video_that_ended_is_not_a_mistake(runs, monkeypatch):
    result = started(monkeypatch, SENDS, "--video", "a.mp4")
    assert result.exception is None
    assert len(runs) == 1


@pytest.mark.parametrize(("display", "opened"), [({}, 0), ({"DISPLAY": ":0"}, 1)])
def test_a_browser_opens_only_where_there_is_a_display(monkeypatch, display, opened):
    begun = []
    monkeypatch.setattr(command.subprocess, "Popen", lambda words, **options: begun.append(words))
    monkeypatch.setattr(command.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in display.items():
        monkeypatch.setenv(name, value)
    command.open_page("http://127.0.0.1:1")
    assert [words[1:] for words in begun] == opened * [["-m", "webbrowser", "http://127.0.0.1:1"]]
