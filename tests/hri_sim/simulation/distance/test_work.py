"""A measured person: the distance is that of the time in which the speed is judged."""

import numpy as np
import pytest

from hri_predict.run import config as configuration
from hri_sim.simulation.distance.people import FULL, activities
from hri_sim.simulation.distance.work import Case, DistancePlan, PlacedPerson
from hri_sim.simulation.motion import load_motion


@pytest.mark.parametrize("seconds", [8.0, 12.0])
def test_only_the_judged_time_says_where_a_person_is(tmp_path, seconds):
    """Somebody comes within 2.5 s, stays to 8 s, and then stands as far on the other side."""
    times = np.arange(15 * 30) / 30
    rest = np.array([[x, y, 0.7] for y in (0.25, 0.1, -0.1) for x in (0.2, -0.2)])
    positions = np.repeat(rest[None], len(times), axis=0)
    positions[..., 0] += np.select([times < 2.5, times <= 8.0], [-4.0, 1.0], -1.4)[:, None]
    path = tmp_path / "arms.npz"
    np.savez(path, positions=positions.astype(np.float32), fps=np.float32(30))
    (activity,), _ = activities([str(path)], None)
    config = str(configuration.shipped("working_distance.yaml"))
    person = PlacedPerson(
        DistancePlan(config=config, robot=None, seconds=seconds),
        Case(
            activity=activity,
            sight=FULL,
            noise_m=0.0,
            predictor="constant_velocity",
            modes=("iso",),
        ),
    )
    frames = load_motion(str(path), 30.0).positions[..., :2]
    expected = np.nanmean(frames[75 : round(30 * seconds) + 1], axis=(0, 1))
    np.testing.assert_allclose(person.middle, expected, atol=1e-9)
    assert np.linalg.norm(np.nanmean(frames, axis=(0, 1)) - expected) > 0.5
