"""The rotation that would make sense is found and named, for each wrong one."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hri_predict.base.geometry import transform
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.check import sensor as listen_module
from hri_predict.cli.check.sensor import refusals, remedy, show, size_remedy
from hri_predict.contracts.joint_map import METRES_PER_UNIT, load_joint_map
from hri_predict.people.body.axes import all_axes
from hri_predict.people.body.posture_watch import Verdict
from hri_sim.baseline_demo import baseline_demo
from hri_sim.people.body import Body

J = len(JOINTS)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([2.5, 0.6]), 2.0))
TRUTH = Pose(xyz=[-0.5, 0.0, 1.8], quaternion_xyzw=[0.0, 0.13, 0.0, 0.9915])
SOURCE_FROM_ROOM = np.asarray(np.linalg.inv(TRUTH.matrix()), np.float64)
COCO = load_joint_map("coco17").rotation
AXES = [(axes, turn) for axes, turn in all_axes(1.0)]


def configured(**people):
    config = baseline_demo()
    return replace(
        config,
        source=config.source.model_copy(update={"room_from_source": TRUTH}),
        node=config.node.model_copy(
            update={"people": config.node.people.model_copy(update=people)}
        ),
    )


def heard(sent):
    """What the node makes of ``sent`` (J, 3), raw, with the map of COCO."""
    placed = transform(TRUTH.matrix(), sent @ COCO.T)
    return {1: (np.tile(placed, (40, 1, 1)), np.ones((40, J), bool))}


@pytest.mark.parametrize(("axes", "turn"), AXES, ids=[",".join(axes) for axes, _ in AXES])
def test_whatever_the_axes_a_remedy_makes_people_stand(axes, turn):
    source = transform(SOURCE_FROM_ROOM, BODY)
    config, people = configured(), heard(source @ turn)  # sent = turn^T source
    if not refusals(config, people, np.eye(4)):
        return  # only the heading is wrong, if anything: no body shows that
    text = remedy(config, people, COCO)
    named = next(t for a, t in AXES if f"axes: [{', '.join(a)}]" in text)
    # the axes named are those that were sent, up to a turn about the vertical
    assert (named @ turn.T)[2] == pytest.approx([0, 0, 1], abs=1e-9)
    assert "quaternion_xyzw: [" in text
    assert "hri-predict register" in text


def test_of_four_headings_the_common_axes_are_named():
    source = transform(SOURCE_FROM_ROOM, BODY)
    assert "axes: [x, y, z]" in remedy(configured(), heard(source), COCO)


def test_a_mirrored_body_needs_left_and_right_exchanged():
    source = transform(SOURCE_FROM_ROOM, BODY)
    people = heard((source @ COCO) * [-1.0, 1.0, 1.0])
    assert refusals(configured(), people, np.eye(4)) == [Verdict.MIRRORED]
    assert "exchange left and right" in remedy(configured(), people, COCO)


def test_a_wrong_floor_is_told_as_such():
    source = transform(SOURCE_FROM_ROOM, BODY - [0, 0, 0.8])
    text = remedy(configured(), heard(source @ COCO), COCO)
    assert "ankles are at -0.73 m and people.floor_m is 0" in text
    fine = configured(floor_m=-0.8)
    assert refusals(fine, heard(source @ COCO), np.eye(4)) == []


def test_there_are_24_axes_of_each_handedness():
    for hands in (1.0, -1.0):
        turns = [turn for _, turn in all_axes(hands)]
        assert len({turn.tobytes() for turn in turns}) == 24
        assert all(np.sign(np.linalg.det(turn)) == hands for turn in turns)


@pytest.mark.parametrize(
    ("real", "declared"), [("mm", "m"), ("cm", "m"), ("inch", "m"), ("ft", "m"), ("m", "mm")]
)
def test_size_is_judged_before_posture_and_the_unit_is_named(real, declared):
    scale = METRES_PER_UNIT[declared]
    positions, observed = heard(transform(SOURCE_FROM_ROOM, BODY) @ COCO)[1]
    sent = {1: (positions / METRES_PER_UNIT[real] * scale, observed)}
    text = size_remedy(configured(), sent, scale)
    assert text is not None
    assert f"units: {real} instead of {declared}" in text
    assert size_remedy(configured(), {1: (positions, observed)}, scale) is None


def test_left_and_right_are_not_exchanged_of_a_body_that_lies():
    source = transform(SOURCE_FROM_ROOM, BODY)
    text = remedy(configured(), heard(source[:, [1, 2, 0]] * [-1.0, 1.0, 1.0]), COCO)
    assert "exchange" not in text
    assert "left_handed: true" in text


@pytest.mark.parametrize(
    ("found", "fine"),
    [
        ({}, True),
        ({"judged": 0}, False),
        ({"floor": "unseen", "ankles_m": None}, False),
        ({"sides": False}, False),
        ({"people": 0, "judged": 0}, False),
        ({"unknown_joints": "joints that the joint map does not have: left_anke"}, False),
        ({"refused": ["not of human size"], "remedy": "units: mm"}, False),
    ],
)
def test_only_what_was_verified_is_fine(found, fine, capsys):
    whole = {
        "scenes": 9,
        "people": 1,
        "judged": 1,
        "refused": [],
        "remedy": None,
        "floor": "seen",
        "ankles_m": 0.08,
        "heights_m": {},
        "sides": True,
        "unknown_joints": None,
        "never_came": ["l_ankle"],
    } | found
    assert show(whole, configured(), as_json=False) is fine
    told = capsys.readouterr().out
    assert ("ok: " in told) is fine
    assert ("mapped, but never received: l_ankle" in told) == bool(whole["people"])


def test_coordinates_about_the_hips_are_named(monkeypatch):
    """No height makes them right."""
    body = BODY - BODY[JOINTS.index("waist")] + TRUTH.xyz

    class Sensor:
        source = SimpleNamespace(joint_map=load_joint_map("canonical"))
        captured_ns = arrived_ns = ()

        def everybody(self, seconds):
            return {1: (np.tile(body, (40, 1, 1)), np.ones((40, J), bool))}, 40

    monkeypatch.setattr(listen_module, "opened", lambda source: nullcontext(Sensor()))
    monkeypatch.setattr(listen_module.assemble, "build_source", lambda config: None)
    found = listen_module.listen(configured(), 1.0)
    assert "relative to the hips" in found["refused"][0]
    assert "positions in the room" in found["remedy"]
