"""Which way a person is placed: by depth where the picture has it, by landmarks otherwise."""

from dataclasses import replace

import numpy as np

from hri_drivers.camera.place.camera import guessed_camera
from hri_drivers.camera.placing import Placer
from hri_drivers.camera.seen import Image, Seen
from tests.hri_drivers.camera.place.bodies import person, seen_at

CAMERA = replace(guessed_camera(640, 480, 60), focal_error=0.01)
SEEN = seen_at(np.array([0.0, 0.0, 3.0]), CAMERA)
PICTURE = Image(np.zeros((480, 640, 3), np.uint8), 0, 1)


def test_a_picture_with_depth_places_by_it():
    depth = np.full((480, 640), 2.0, np.float32)
    flat = Seen(
        1, "mediapipe33", CAMERA.project(person() + np.array([0, 0, 2.0])), np.ones(33), None
    )
    placed = Placer(CAMERA).place(flat, replace(PICTURE, depth=depth))
    assert placed.observed.any()
    assert np.nanmax(np.abs(placed.positions[:, 2] - 2.0)) < 0.1
    by_landmarks = Placer(CAMERA).place(SEEN, PICTURE)
    assert placed.error_m < 0.2 < by_landmarks.error_m


def test_a_person_without_depth_is_counted_and_has_no_place():
    placer = Placer(CAMERA)
    placed = placer.place(SEEN, replace(PICTURE, depth=np.zeros((480, 640), np.float32)))
    assert not placed.observed.any()
    assert placer.unplaced == {"too few joints with depth": 1}
