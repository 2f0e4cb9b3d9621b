"""A5: a thing that moves hides a person, where the sensor is said to see free space."""

from typing import Any

import numpy as np

from tests.attacks.people import at, reach_in, stand
from tests.attacks.play import Attack

_ROOM = [[-3.0, -3.5], [6.0, -3.5], [6.0, 4.0], [-3.0, 4.0]]


def truck(rng: np.random.Generator) -> Attack:
    """A driverless truck stops between the camera and a person at the robot."""
    camera = np.array([rng.uniform(4.0, 5.8), rng.uniform(-1.5, 1.5), 2.4])
    bearing, away_m = float(rng.uniform(-0.3, 0.3)), float(rng.uniform(1.25, 1.5))
    place = at(bearing, away_m)
    comes_s, reach_s = float(rng.uniform(1.5, 4.0)), float(rng.uniform(11.0, 14.0))
    share = float(rng.uniform(0.35, 0.75))  # of the way from the person to the camera
    stop = place + share * (camera[:2] - place)
    across = np.array([-(camera - [*place, 0])[1], (camera - [*place, 0])[0]])
    across /= np.hypot(*across)
    half_m = float(rng.uniform(0.6, 0.9))

    def hidden(t: float, joints: np.ndarray) -> bool:
        truck = stop + across * max(4.0 - 1.2 * max(t - comes_s, 0.0), 0.0)
        way = truck - joints.mean(axis=0)[:2]
        line = camera[:2] - joints.mean(axis=0)[:2]
        line /= np.hypot(*line)
        return float(np.hypot(*(way - line * float(way @ line)))) < half_m

    def joints(t: float) -> np.ndarray:
        if t < reach_s - 0.3:
            return stand(place, bearing + np.pi)
        return reach_in(t, reach_s, bearing)

    def change(data: dict[str, Any]) -> None:
        data["source"] |= {
            "sees_free_space": True,
            "field_of_view": {"polygon": _ROOM},
            "viewpoints": [camera.tolist()],
        }
        data["people"] = {"exits": [], "room": {"polygon": _ROOM}}

    return Attack(
        name=f"a truck of {2 * half_m:.1f} m hides a person from {np.round(camera, 1)}",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [] if hidden(t, joints(t)) else [(1, joints(t))],
        seconds=reach_s + 4.0,
        change=change,
    )
