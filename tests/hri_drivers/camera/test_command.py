"""``hri-predict camera``: options, mistakes, and what it opens.

The network is that of ``network/test_described.py``'s kind: small, and made here.
"""

import json
import os
import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
import yaml

from hri_drivers.camera import command, images, options
from hri_drivers.camera.command import camera
from hri_drivers.camera.network import package
from hri_drivers.sources.scene_stream.codec import decode_body, open_datagram
from hri_predict.base.errors import HriPredictError
from tests.hri_drivers.camera.pictures import cv2, textured, write_video
from tests.processes import python

onnx = pytest.importorskip("onnx")

CALIBRATED = {"width": 640, "height": 480, "focal": [500, 500], "centre": [320, 240]}


@pytest.fixture
def model(tmp_path) -> Path:
    """A network that has the same standing person, with landmarks in metres, in every picture.

    It has room for a second one.
    """
    random = np.random.default_rng(3)
    world = random.uniform(-0.5, 0.5, (33, 3)) * [0.5, 1.7, 0.3]
    depth = world[:, 2] + 3.0
    focal = 0.5 / np.tan(np.radians(32))  # of a width of 1
    pixels = np.column_stack([world[:, :2] / depth[:, None] * focal + 0.5, np.full(33, 0.9)])
    nobody = np.zeros((33, 3))
    tensors = {
        "joints": np.stack([pixels, nobody]).reshape(2, 99),
        "metres": np.stack([world, nobody]).reshape(2, 99),
    }
    helper = onnx.helper
    nodes = [
        helper.make_node("ReduceMean", ["picture"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        *(helper.make_node("Add", ["nothing", f"{name} fixed"], [name]) for name in tensors),
    ]
    constants = {"zero": np.float32(0)} | {f"{n} fixed": np.float32(a) for n, a in tensors.items()}
    graph = helper.make_graph(
        nodes, "test",
        [helper.make_tensor_value_info("picture", 1, (1, 64, 64, 3))],
        [helper.make_tensor_value_info(n, 1, a.shape) for n, a in tensors.items()],
        [onnx.numpy_helper.from_array(np.asarray(a), n) for n, a in constants.items()],
    )  # fmt: skip
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), tmp_path / "net.onnx")
    path = tmp_path / "net.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "network": "net.onnx",
                "layout": "mediapipe33",
                "people": {"output": "joints", "world": "metres"},
                "joints": {"units": "fraction"},
            }
        )
    )
    return path


@pytest.fixture
def picture(tmp_path) -> Path:
    path = tmp_path / "picture.png"
    cv2.imwrite(str(path), textured(640, 640))
    return path


def call(*arguments) -> None:
    app = typer.Typer(add_completion=False)
    app.command()(camera)
    app([str(a) for a in arguments], standalone_mode=False, prog_name="hri-predict camera")


def test_a_person_in_a_picture_reaches_the_node(model, picture, tmp_path, capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        node.bind(("127.0.0.1", 0))
        node.settimeout(30)
        call(picture, "--model", model, "--port", node.getsockname()[1], "--json",
             "--preview", tmp_path / "seen.png")  # fmt: skip
        header, body = open_datagram(node.recv(2000))
        scene = decode_body(header, body)
    assert scene.sees_room
    (person,) = scene.people
    middle = np.nanmean(person.positions, axis=0)
    assert middle[2] == pytest.approx(3.0, abs=0.5)  # the world was made 3 m away
    assert person.error_m > 0.3  # the camera is guessed
    summary = json.loads(capsys.readouterr().out)
    assert (summary["pictures"], summary["scenes"], summary["ids"]) == (1, 1, 1)
    drawn = cv2.imread(str(tmp_path / "seen.png"))
    assert np.abs(drawn.astype(int) - textured(640, 640)).max() > 100


def test_a_calibrated_camera_needs_its_own_kind_of_pictures(model, picture, tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump(CALIBRATED))
    with pytest.raises(HriPredictError, match="calibrate again with images of this size") as caught:
        call(picture, "--model", model, "--calibration", path)
    assert "--size" not in str(caught.value)  # it is refused for a picture and a video


class Opened(Exception):
    """The camera would be open now."""


def test_the_network_is_loaded_before_the_camera_and_the_size_is_that_of_its_file(
    model, tmp_path, monkeypatch
):
    """Pictures of an open camera would grow old meanwhile."""
    path, done = tmp_path / "camera.yaml", []
    path.write_text(yaml.safe_dump(CALIBRATED | {"width": 800, "height": 600}))

    def network(*_, **__):
        done.append("network")
        return SimpleNamespace(layout="mediapipe33")

    def device(*_, size, **__):
        done.append(size)
        raise Opened

    monkeypatch.setattr(command, "finder_of", network)
    monkeypatch.setattr(images, "Webcam", device)
    with pytest.raises(Opened):
        call("0", "--model", model, "--calibration", path)
    with pytest.raises(Opened):
        call("0", "--model", model)
    with pytest.raises(Opened):  # the angle of a data sheet is that of 16:9 images
        call("0", "--model", model, "--field-of-view", "70")
    assert done == ["network", (800, 600), "network", (640, 480), "network", (640, 360)]


def test_an_opencv_that_cannot_be_loaded_is_one_line(monkeypatch):
    def fails(name):
        raise ImportError("libGL.so.1: cannot open shared object file")

    monkeypatch.setattr(options.importlib, "import_module", fails)
    with pytest.raises(HriPredictError, match=r"libGL.*opencv-python-headless"):
        call("0")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give an input"),
        (["PICTURE", "--seconds", "0"], "--seconds 0: give a number above 0"),
        (["PICTURE", "--max-fps", "nan"], "--max-fps nan"),
        (["PICTURE", "--preview", "x.gif"], "--preview x.gif: name a file"),
        (["PICTURE", "--preview", "none/x.png"], "the folder does not exist"),
        (["PICTURE", "--calibration", "none.yaml"], "none.yaml: cannot be read"),
        (["PICTURE", "--field-of-view", "200"], "field of view"),
        (["PICTURE", "--height", "17"], "height"),
        (["PICTURE", "--host", "robot"], "not an IP address"),
        (["PICTURE", "--key-file", "none.key"], "none.key: cannot be read"),
        (["PICTURE", "--size", "640x480"], "--size: has no effect on"),
        (["0", "--size", "huge"], "--size huge"),
        (["0", "--size", "640x360", "--calibration", "CAMERA"], "leave out --size, or"),
        (["", "--model", "none.yaml"], "input: empty; give a camera's number"),
        (["none.mp4", "--model", "none.yaml"], "input none.mp4: no such file"),
        (["PICTURE", "--model", "none.yaml", "--host", "robot"], "not an IP address"),
        (["PICTURE", "--model", "net.onnx"], "describe the network in a .yaml file"),
        (["PICTURE", "--variant", "full"], "--variant: has no effect"),
        (["PICTURE", "--fetch-model"], "INPUT, --model: have no effect with --fetch-model"),
    ],
)
def test_a_mistake_is_one_line(arguments, message, model, picture, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump(CALIBRATED))
    named = {"PICTURE": str(picture), "CAMERA": str(path)}
    given = [named.get(a, a) for a in arguments]
    if "--model" not in given:
        given += ["--model", str(model)]
    with pytest.raises(HriPredictError) as caught:
        call(*given)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_variant_that_is_unknown_is_refused(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_DATA", str(tmp_path))
    with pytest.raises(HriPredictError, match=r"no model yet; fetch it with"):
        call(picture)
    with pytest.raises(HriPredictError, match=r"--variant fulll: unknown; did you mean"):
        call(picture, "--variant", "fulll")


def test_a_kept_package_that_changed_is_refused(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_DATA", str(tmp_path))
    (tmp_path / package.FILE).write_bytes(b"something else")
    with pytest.raises(HriPredictError, match="damaged, or replaced since it was fetched; run"):
        call(picture)


def test_a_network_of_one_person_never_sees_the_room(picture, tmp_path, capsys, model):
    net = onnx.load(tmp_path / "net.onnx")
    for tensor in net.graph.initializer:
        if tensor.dims:
            first = onnx.numpy_helper.to_array(tensor)[:1]
            tensor.CopyFrom(onnx.numpy_helper.from_array(first, tensor.name))
    for output in net.graph.output:
        output.type.tensor_type.shape.dim[0].dim_value = 1
    onnx.save(net, tmp_path / "net.onnx")
    call(picture, "--model", model, "--json")
    said = capsys.readouterr()
    assert "finds one person only" in said.err
    assert json.loads(said.out)["without_view"] == {"there may be more people than are followed": 1}


def test_a_network_without_metres_cannot_place_a_person(model, picture):
    about = yaml.safe_load(model.read_text())
    del about["people"]["world"]
    model.write_text(yaml.safe_dump(about))
    with pytest.raises(HriPredictError, match="cannot measure the distance to a person"):
        call(picture, "--model", model)


WATCHED = """
import os, sys
opened = []
def hook(event, arguments):
    if event.startswith("socket."):
        opened.append((event, str(arguments[1:])))
sys.addaudithook(hook)
from hri_drivers.camera import sending
from hri_predict.cli import main
close = sending.Sender.close
def sockets(self):
    inodes = {os.readlink(f"/proc/self/fd/{n}") for n in os.listdir("/proc/self/fd")
              if os.path.islink(f"/proc/self/fd/{n}")}
    print("SOCKETS", sum(name.startswith("socket:") for name in inodes))
    close(self)
sending.Sender.close = sockets
sys.argv = ["hri-predict", *sys.argv[1:]]
try:
    main()
finally:
    for event, arguments in opened:
        print("AUDIT", event, arguments)
"""


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="lists sockets by Linux's /proc")
def test_nothing_is_connected_but_the_node(model, tmp_path):
    """By Python's audit events, and by the process's descriptors, which hold those of libraries."""
    video = write_video(tmp_path / "v.avi", [textured(seed=k) for k in range(3)], 100)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = python(
        "-c", WATCHED, "camera", video, "--model", model, "--port", "47999", env=environment
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert "SOCKETS 1" in lines
    audit = [line.split(" ", 2)[1:] for line in lines if line.startswith("AUDIT")]
    assert {event for event, _ in audit} == {"socket.__new__", "socket.sendto"}
    assert {where for event, where in audit if event == "socket.sendto"} == {
        "(('127.0.0.1', 47999),)"
    }


def test_a_video_list_cannot_make_it_connect(tmp_path, model, monkeypatch):
    """A playlist is a text that names addresses; FFmpeg opens them if its environment permits."""
    monkeypatch.setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", "protocol_whitelist;file,http,tcp")
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        server.setblocking(False)
        address = f"http://127.0.0.1:{server.getsockname()[1]}/part.ts"
        path = tmp_path / "list.m3u8"
        path.write_text(
            f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{address}\n#EXT-X-ENDLIST\n"
        )
        with pytest.raises(HriPredictError, match="not a video"):
            call(path, "--model", model)
        with pytest.raises(BlockingIOError):
            server.accept()
