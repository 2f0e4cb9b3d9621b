import numpy as np
import pytest

from hri_predict.people.snapshot import LostPerson
from hri_predict.zones.lost_places import ARM_M, anywhere_in


def lost(places, **heights):
    return LostPerson(
        id=1,
        positions=np.zeros((1, 3)),
        last_seen_ns=0,
        joint_age_s=np.zeros(1),
        speed_m_s=1.6,
        limbs_m_s=np.zeros(1),
        places=np.array(places, float),
        places_ns=0,
        **heights,
    )


@pytest.mark.parametrize("segments", [1, 3, 17, 30])
@pytest.mark.parametrize("count", [1, 4, 20])
def test_every_place_is_in_a_zone_however_few_segments_a_body_has(segments, count):
    rng = np.random.default_rng(count)
    places = np.column_stack([rng.uniform(-5, 5, (count, 2)), rng.uniform(0.2, 0.5, count)])
    zones = anywhere_in(lost(places), np.zeros(2), segments)
    assert zones.radius.shape == (2, segments)
    apart = np.linalg.norm(zones.a[0, :, None, :2] - places[:, :2], axis=-1)
    assert (apart + places[:, 2] + ARM_M <= zones.radius[0, :, None] + 1e-9).any(0).all()


@pytest.mark.parametrize("platform_m", [0.0, 1.0])
@pytest.mark.parametrize("disc_m", [0.3, 0.5, 1.2])
def test_a_person_at_the_edge_of_a_place_is_held_with_an_outstretched_arm(platform_m, disc_m):
    person = lost([[0, 0, disc_m]], floor_m=3.0, platform_m=platform_m)
    for at_s in (0.0, 0.5, 1.0, 3.0):
        zone = anywhere_in(person, np.array([at_s]), 1)
        low, high = zone.a[0, 0], zone.b[0, 0]
        assert low[2] == 3.0
        edge = disc_m + 1.6 * at_s
        for stands_m in (0.0, platform_m):
            floor = 3.0 + stands_m
            for out_m, up_m in ((edge, 2.5), (edge, 0.0), (edge + ARM_M, 1.6), (edge + ARM_M, 0.5)):
                z = floor + up_m
                on_axis = np.clip(z, low[2], high[2])
                apart = np.hypot(out_m, z - on_axis)
                assert apart <= zone.radius[0, 0] + 1e-9, (at_s, stands_m, out_m, up_m)
