"""The shipped configuration hears the camera."""

import time

import numpy as np

from hri_drivers.camera.sending import Sender
from hri_drivers.sources.scene_stream.udp_source import UdpSource
from hri_drivers.sources.sent import SentPerson
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.run import config as configuration

PATIENT_S = 60.0


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
