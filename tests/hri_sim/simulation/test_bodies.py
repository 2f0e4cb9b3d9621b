"""Bodies computed once and moved are the bodies that the node would have found there."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.protocol.reasons import Reason
from hri_sim.simulation.approach import lasts_ns, over_floor
from hri_sim.simulation.bodies import compute, joined, moved, without_people
from hri_sim.simulation.cell import variants
from hri_sim.simulation.motion import load_motion

PLACES = [(1.3, -0.4, 0.9), (-2.0, 1.0, -2.2)]
MOTIONS = ["procedural:1", "procedural:2"]


@pytest.fixture(scope="module")
def modes(cell):
    return variants(cell.config, ["predictive", "iso"], [])


def assert_same(found, expected):
    assert len(found.snapshots) == len(expected.snapshots)
    for mine, theirs in zip(found.snapshots, expected.snapshots, strict=True):
        assert (mine.now_ns, mine.ids, mine.captures) == (
            theirs.now_ns,
            theirs.ids,
            theirs.captures,
        )
        assert (mine.reasons, mine.newest_capture_ns) == (theirs.reasons, theirs.newest_capture_ns)
        np.testing.assert_array_equal(mine.capture_ns, theirs.capture_ns)
        for name in ("observed", "last_positions", "joint_age_s"):
            np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), atol=1e-9)
        seen = mine.observed  # what was not observed has a value that means nothing
        np.testing.assert_allclose(mine.history[seen], theirs.history[seen], atol=1e-9)
    for mine, theirs in zip(found.forecasts, expected.forecasts, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)
    for name in expected.zones:
        for mine, theirs in zip(found.zones[name], expected.zones[name], strict=True):
            assert mine.zones.ids == theirs.zones.ids
            assert (mine.age_s, mine.capture_ns, mine.reasons) == (
                theirs.age_s,
                theirs.capture_ns,
                theirs.reasons,
            )
            for per_person in ("lost", "segments_m_s", "as_assumed"):
                np.testing.assert_allclose(
                    getattr(mine, per_person), getattr(theirs, per_person), atol=1e-9
                )
            np.testing.assert_array_equal(mine.speeds.unknown, theirs.speeds.unknown)
            for part in ("a", "b", "radius"):
                np.testing.assert_allclose(
                    getattr(mine.zones.capsules, part),
                    getattr(theirs.zones.capsules, part),
                    atol=1e-9,
                )
                np.testing.assert_allclose(
                    getattr(mine.paths, part), getattr(theirs.paths, part), atol=1e-9
                )


@pytest.mark.long
def test_moved_zones_are_the_zones_of_moved_people(cell, modes):
    own = compute(cell=cell, motions=MOTIONS[:1], lead_in_s=0.4, variants=modes)
    there = compute(
        cell=cell, motions=MOTIONS[:1], lead_in_s=0.4, variants=modes, places=PLACES[:1]
    )
    assert_same(moved(own, over_floor(PLACES[0]), 0), there)


@pytest.mark.long
def test_people_computed_apart_are_the_people_of_one_room(cell, modes):
    parts = [
        moved(
            compute(cell=cell, motions=[name], lead_in_s=0.4, variants=modes),
            over_floor(place),
            person,
        )
        for person, (name, place) in enumerate(zip(MOTIONS, PLACES, strict=True))
    ]
    ends_ns = lasts_ns([load_motion(name, 30.0) for name in MOTIONS], 0.4)
    assert_same(
        joined(parts, ends_ns),
        compute(cell=cell, motions=MOTIONS, lead_in_s=0.4, variants=modes, places=PLACES),
    )


def test_people_computed_apart_end_where_the_run_does(cell, recording, tmp_path):
    """Of 60 Hz played at 30 Hz, the last frame may come half a period early: it is left out."""
    paths = [tmp_path / "whole.npz", tmp_path / "early.npz"]
    arms = np.concatenate(2 * [np.load(recording)["positions"]])
    for path, frames in zip(paths, (90, 76), strict=True):
        np.savez(path, positions=arms[:frames], fps=np.float32(60))
    names, modes = [str(path) for path in paths], variants(cell.config, ["iso"], [])
    places = [(3.0, 0.0, 0.0), (-3.0, 0.0, 0.0)]
    told = {"cell": cell, "lead_in_s": 0.0, "variants": modes}
    parts = [
        moved(compute(motions=[name], **told), over_floor(place), person)
        for person, (name, place) in enumerate(zip(names, places, strict=True))
    ]
    one_run = compute(motions=names, places=places, **told)
    ends_ns = lasts_ns([load_motion(name, 30.0) for name in names], 0.0)
    found = joined(parts, ends_ns)
    stamps = [each.now_ns for each in found.snapshots]
    assert stamps == [each.now_ns for each in one_run.snapshots]
    assert len(stamps) < min(len(part.snapshots) for part in parts)


def test_an_empty_room_is_not_doubted_where_a_scene_was(cell, modes):
    bodies = compute(cell=cell, motions=MOTIONS[:1], lead_in_s=0.5, variants=modes[:1])
    trusted = bodies.snapshots[-1]
    assert without_people(trusted).newest_capture_ns == trusted.newest_capture_ns
    stale_ns = trusted.now_ns - 1_000_000_000
    doubted = replace(trusted, reasons=(Reason.INPUT_REPEATS,), newest_capture_ns=stale_ns)
    empty = without_people(doubted)
    assert (empty.ids, empty.reasons, empty.age_s) == ((), (), 0.0)
