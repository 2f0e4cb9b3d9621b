"""A robot backs out beside people only where it is certain that it recedes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules
from hri_predict.risk.separation.backing_out import why_not_backing_out

AWAY = np.linspace(0.0, -0.2, 5)


def why(x: float, error_m: float | None) -> str:
    """Of a ball of 0.1 m that goes from 0 to -0.2 m, beside another one, at ``x``, that stands."""
    way = np.zeros((len(AWAY), 1, 3))
    way[:, 0, 0] = AWAY
    links = Capsules(way, way, np.full((len(AWAY), 1), 0.1))
    plan = SimpleNamespace(
        forwards_m_s=lambda *_: 0.0,
        back_from=lambda *_: None,
        trajectory=SimpleNamespace(at=lambda _: [None]),
    )
    robot: Any = SimpleNamespace(
        robot=SimpleNamespace(modes=SimpleNamespace(recovery=SimpleNamespace(speed_m_s=0.2))),
        plan=plan,
        model=SimpleNamespace(stopping=lambda _: (0.1, 0.01), capsules=lambda _: links),
        reaction_s=lambda _: 0.1,
    )
    place = np.array([[[x, 0.0, 0.0]]])
    bodies: Any = SimpleNamespace(
        lost=np.zeros(1, bool),
        speeds=SimpleNamespace(unknown=np.zeros(1, bool)),
        age_s=0.0,
        captured=Capsules(place, place, np.full((1, 1), 0.1 + (error_m or 0.0))),
        error_m=lambda _: error_m or 0.0,
    )
    now: Any = SimpleNamespace(place_s=0.0)
    motion: Any = SimpleNamespace(qd=None)
    return why_not_backing_out(robot, now, motion, bodies)


@pytest.mark.parametrize(
    ("x", "error_m", "expected"),
    [
        (0.15, 0.0, ""),  # they touch, but it is known on which side, and it recedes
        (-0.15, 0.0, "a link would move closer to a person on the way back"),
        (0.6, 0.3, ""),  # 0.3 m nearer, the person still is ahead of it, so it recedes
        (0.6, 0.5, "the position of a person near it is not known well enough"),
        (0.15, 0.01, "the position of a person near it is not known well enough"),
    ],
)
def test_who_may_be_on_either_side_is_not_receded_from(x, error_m, expected):
    assert why(x, error_m) == expected
