"""The legs of a body too low to stand may be anywhere, so no posture places them."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.inferred import Inference
from hri_predict.people.body.seated import is_low
from hri_sim.people.body import Body as Figure

_FIGURE = Figure(1.75)
STANDS = _FIGURE.joints(_FIGURE.standing(np.zeros(2), 0.3))
LEGS = np.isin(JOINTS, [f"{s}_{j}" for s in "lr" for j in ("knee", "ankle", "foot")])
BELOW_WAIST = LEGS | np.isin(JOINTS, ["l_hip", "r_hip", "waist"])


def lowered(metres):
    return STANDS - np.array([0.0, 0.0, metres])


@pytest.mark.parametrize(
    ("hidden", "down_m", "low"),
    [
        (LEGS, 0.0, False),
        (LEGS, 0.03, False),
        (LEGS, 0.25, True),
        (LEGS, 0.45, True),
        (BELOW_WAIST, 0.03, False),
        (BELOW_WAIST, 0.45, True),
    ],
)
def test_who_sits_is_low_by_hips_or_shoulders(hidden, down_m, low):
    body = lowered(down_m)
    assert is_low(body[None], ~hidden[None]).tolist() == [low]
    filled = Inference(body_model()).fill(body, ~hidden)
    assert filled.observed[LEGS].tolist() == [not low] * LEGS.sum()


def test_the_floor_of_the_room_counts():
    body = lowered(0.0) + np.array([0.0, 0.0, 3.0])
    assert Inference(body_model(), floor_m=3.0).fill(body, ~LEGS).observed.all()
    sits = body - np.array([0.0, 0.0, 0.4])
    assert not Inference(body_model(), floor_m=3.0).fill(sits, ~LEGS).observed[LEGS].any()


def test_a_body_without_hips_and_shoulders_is_not_low():
    head = np.isin(JOINTS, ["head", "neck"])
    assert is_low(lowered(0.5)[None], head[None]).tolist() == [False]


def test_seen_legs_stay_as_they_are():
    filled = Inference(body_model()).fill(lowered(0.4), np.ones(len(JOINTS), bool))
    assert filled.observed.all()
