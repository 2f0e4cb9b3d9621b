"""The shipped configuration hears the camera."""

import time

import numpy as np

from hri_drivers.camera.sending import Sender
from hri_drivers.camera.webcam import LATENCY_S
from hri_drivers.sources.scene_stream.udp_source import UdpSource
from hri_drivers.sources.sent import SentPerson
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Scene
from hri_predict.people.clock.scene_gate import SceneGate
from hri_predict.run import config as configuration
from tests.house import ROOT

PATIENT_S = 60.0
NETWORK_S = 0.02
"""Processor time of a picture by the default network: the table of the guide."""
GUIDE = ROOT / "docs" / "guides" / "camera.md"


def test_a_person_before_the_camera_is_there_in_the_room():
    config = configuration.load(configuration.shipped("camera.yaml"))
    settings = config.source.model_copy(update={"port": 0})
    assert isinstance(settings, UdpSource.settings_model)
    source = UdpSource(settings, config.base_dir)
    source.open(time.monotonic_ns())
    try:
        joints = load_joint_map("mediapipe33").source_joints  # of BlazePose
        sender = Sender("127.0.0.1", source.port, joints)
        ahead = np.tile([0.5, 0.2, 3.0], (33, 1))  # to the right, below the axis, 3 m away
        person = SentPerson(4, ahead, np.ones(33, np.bool_), 0.4)
        sender.send((person,), sees_room=True, stamp_ns=time.time_ns())
        assert source.arrived.wait(PATIENT_S)
        scene = source.poll(time.monotonic_ns())
    finally:
        source.close()
    assert scene is not None
    assert scene.sees_room
    x, y, z = scene.people[0].positions[0]
    assert abs(x - 3.0) < 1e-6  # the camera looks along x, as float32 has it
    assert abs(y + 0.5) < 1e-6  # y is to the left
    assert abs(z - (1.2 - 0.2)) < 1e-6  # the camera is 1.2 m high
    assert abs(scene.people[0].error_m - 0.4) < 1e-6


def test_a_picture_is_as_old_for_the_node_as_a_webcams_is():
    """The constant part of a delay is in no difference of clocks; it must be stated."""
    settings = configuration.load(configuration.shipped("camera.yaml")).source
    gate = SceneGate(round(1e9 / 15), round(1e9 * settings.min_latency_s))
    exposed_ns, receipt_ns = 10**18, 5 * 10**9
    capture_ns = gate.admit(Scene(exposed_ns, 1, True, ()), receipt_ns)
    assert capture_ns is not None
    assert receipt_ns - capture_ns >= round(1e9 * (LATENCY_S + NETWORK_S))


def test_the_guide_names_the_latency_that_the_configuration_has():
    settings = configuration.load(configuration.shipped("camera.yaml")).source
    assert f"`min_latency_s: {settings.min_latency_s:g}`" in GUIDE.read_text(encoding="utf-8")


def test_a_camera_that_sends_the_same_joints_again_is_frozen():
    settings = configuration.load(configuration.shipped("camera.yaml")).source
    assert settings.model_dump()["declares_noise"]
