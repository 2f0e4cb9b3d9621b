"""``check --listen`` confirms the floor only where feet were seen on it."""

import re
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hri_predict.base.settings import Region
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.check import sensor
from hri_predict.contracts.joint_map import load_joint_map
from hri_sim.baseline_demo import baseline_demo
from hri_sim.people.body import Body

COCO = load_joint_map("coco17").mapped
LEGS = np.array([name.endswith(("hip", "knee", "ankle", "foot")) for name in JOINTS])
UPPER = COCO & ~LEGS & ~np.isin(JOINTS, ("waist", "torso"))
WHOLE = COCO.copy()


def person(stature=1.75, seated=False):
    """(J, 3) somebody who stands, or sits on a chair as seen above a bench."""
    who = Body(stature)
    body = who.joints(who.standing(np.array([2.0, 0.3]), 0.4))
    return body - [0, 0, 0.22 * stature] if seated else body


@pytest.fixture
def listen(monkeypatch):
    """What ``--listen`` finds and says of these bodies, each seen for 3 s with some noise."""

    def call(*bodies, seen=UPPER, off_m=0.0, view=None, **people):
        config = baseline_demo()
        node = config.node.model_copy(
            update={"people": config.node.people.model_copy(update=people)}
        )
        source = config.source.model_copy(update={"field_of_view": view})
        config = replace(config, node=node, source=source)
        rng = np.random.default_rng(2)
        captures = {
            number: (
                body + np.array([0, 0, off_m]) + rng.normal(0, 0.005, (90, len(JOINTS), 3)),
                np.tile(seen if isinstance(seen, np.ndarray) else seen[number], (90, 1)),
            )
            for number, body in enumerate(bodies)
        }
        fake = SimpleNamespace(
            source=SimpleNamespace(joint_map=load_joint_map("coco17")),
            captured_ns=(),
            arrived_ns=(),
            everybody=lambda seconds: (captures, 90),
        )

        @contextmanager
        def opened(source):
            yield fake

        monkeypatch.setattr(sensor, "opened", opened)
        monkeypatch.setattr(sensor.assemble, "build_source", lambda config: None)
        return sensor.listen(config, 3.0), config

    return call


def said(listened, capsys):
    found, config = listened
    fine = sensor.show(found, config, as_json=False)
    return fine, capsys.readouterr().out


def test_feet_on_the_floor_confirm_it(listen, capsys):
    fine, text = said(listen(person(), seen=WHOLE), capsys)
    assert fine
    assert "ok: bodies stand upright on the floor, left and right correct" in text


@pytest.mark.parametrize("off_m", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("seated", [False, True])
def test_without_feet_in_view_the_floor_is_never_confirmed(listen, capsys, off_m, seated):
    fine, text = said(listen(person(seated=seated), off_m=off_m), capsys)
    assert not fine
    assert "ok" not in text.split()
    assert "the floor could not be verified, because no feet were seen" in text
    assert "--touched x,y,z" in text


@pytest.mark.parametrize("stature", [1.55, 1.75, 1.95])
@pytest.mark.parametrize(("off_m", "way"), [(-1.0, "low"), (1.0, "high")])
def test_a_pose_one_metre_off_is_found_from_heads_and_shoulders(
    listen, capsys, stature, off_m, way
):
    fine, text = said(listen(person(stature), off_m=off_m), capsys)
    assert not fine
    assert f"wrong: bodies are too {way} above the floor for people who stand or sit" in text
    assert "source.room_from_source.xyz" in text


@pytest.mark.parametrize("stature", [1.5, 1.75, 2.05])
@pytest.mark.parametrize("seated", [False, True])
def test_nobody_who_stands_or_sits_is_at_an_impossible_height(listen, stature, seated):
    found, _ = listen(person(stature, seated))
    assert found["refused"] == []
    assert found["floor"] == "unseen"


def test_one_person_who_crouches_among_others_is_believed(listen):
    crouching = person() - [0, 0, 0.85]
    found, _ = listen(person(), crouching, seen={0: UPPER, 1: UPPER})
    assert found["refused"] == []


def test_one_person_whose_feet_are_seen_confirms_the_floor_for_all(listen, capsys):
    fine, _ = said(listen(person(), person(), seen={0: UPPER, 1: WHOLE}), capsys)
    assert fine


@pytest.mark.parametrize(("off_m", "way"), [(0.3, "above"), (0.9, "above"), (-0.28, "below")])
def test_feet_away_from_the_floor_do_not_confirm_it(listen, capsys, off_m, way):
    fine, text = said(listen(person(), seen=WHOLE, off_m=off_m), capsys)
    assert not fine
    told = re.search(rf"the floor could not be verified: feet are (\S+) m {way}", text)
    assert told is not None
    assert float(told[1]) == pytest.approx(abs(off_m), abs=0.03)  # ankles are 7 to 9 cm up


def test_heights_count_from_the_configured_floor(listen):
    found, _ = listen(person(), off_m=-1.0, floor_m=-1.0)
    assert found["refused"] == []


def test_left_and_right_are_confirmed_only_by_limbs_that_show_them(listen, capsys):
    no_arms = UPPER & np.isin(JOINTS, ("neck", "head", "l_shoulder", "r_shoulder"))
    fine, text = said(listen(person(), seen=no_arms), capsys)
    assert not fine
    assert "left and right correct" not in text
    assert "left and right could not be verified" in text


def test_people_outside_a_field_of_view_that_is_too_small_get_it_named(listen):
    small = Region(polygon=[[-3, -1], [0, -1], [0, 1], [-3, 1]])
    found, _ = listen(person(), view=small)
    assert found["refused"] == ["outside the field of view"]
    assert "enlarge source.field_of_view" in found["remedy"]
    assert "[2.0" in found["remedy"]  # where they are
