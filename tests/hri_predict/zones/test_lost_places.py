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


def test_zones_stand_on_the_floor_and_on_what_people_stand_on():
    zones = anywhere_in(lost([[0, 0, 0.5]], floor_m=3.0, platform_m=1.0), np.zeros(1), 1)
    assert zones.a[0, 0, 2] == 3.0
    assert zones.b[0, 0, 2] + zones.radius[0, 0] == pytest.approx(6.5)
