"""``hri-predict cameras``: mistakes, and a run without a picture."""

import pytest
import typer
import yaml

from hri_drivers.camera.network.found import Finding
from hri_drivers.camera.rig_command import cameras
from hri_predict.base.errors import HriPredictError, SourceError
from tests.hri_drivers.camera.pictures import Script, textured, write_video

from hri_drivers.camera import command, options  # isort: skip

CALIBRATED = {
    "width": 640,
    "height": 480,
    "focal": [500, 500],
    "centre": [320, 240],
    "room_from_source": {"xyz": [0, 0, 1.5], "quaternion_xyzw": [0, 0, 0, 1]},
}


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Two calibrated cameras, and two videos of them; the network finds no person."""
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(CALIBRATED))
        write_video(tmp_path / f"{name}.avi", [textured(seed=k) for k in range(2)], rate_hz=50)
    monkeypatch.setattr(command, "finder_of", lambda *_, **__: Script([Finding(())] * 9))
    return tmp_path


def call(*arguments):
    app = typer.Typer(add_completion=False)
    app.command()(cameras)
    both = ["--calibration", "a.yaml", "--calibration", "b.yaml"]
    app([*arguments, *both], standalone_mode=False, prog_name="hri-predict cameras")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.avi"], "give 2 to 4 different inputs"),
        (["a.avi", "a.avi"], "give 2 to 4 different inputs"),
        (["a.avi", "b.avi", "--fps", "nan"], "--fps nan: give a number above 0"),
        (["a.avi", "b.avi", "--seconds", "inf"], "--seconds inf: give a number above 0"),
        (["a.avi", "none.avi"], "input none.avi: no such file"),
        (["a.avi", ""], "input: empty"),
        (["a.avi", "b.avi", "--host", "robot"], "not an IP address"),
        (["0", "1", "--size", "640x360"], "leave out --size, or"),
    ],
)
def test_a_mistake_is_one_line(arguments, message, files):
    with pytest.raises(HriPredictError) as caught:
        call(*arguments)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_opencv_that_cannot_be_loaded_is_one_line(monkeypatch, files):
    def fails(name):
        raise ImportError("libGL.so.1: cannot open shared object file")

    monkeypatch.setattr(options.importlib, "import_module", fails)
    with pytest.raises(HriPredictError, match=r"libGL.*opencv-python-headless"):
        call("0", "1")


def test_a_run_without_a_picture_is_one_line(files):
    with pytest.raises(SourceError, match="no images taken at the same time arrived; "):
        call("a.avi", "b.avi", "--seconds", "1e-9")


def test_the_summary_names_the_latency_that_the_node_needs(files, capsys):
    call("a.avi", "b.avi")
    said = capsys.readouterr().out
    assert "the node needs source.min_latency_s: 0." in said
    assert "the video's own times (a.avi)" in said
