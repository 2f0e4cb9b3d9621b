"""Which trackers are measured where none is named, and how the largest terms may be reduced."""

from dataclasses import replace

import pytest

from hri_predict.base.files import data_path
from hri_predict.run import config as configuration
from hri_predict.run.working_distance.waterfall import TERMS, Waterfall
from hri_sim.simulation.distance.people import SIGHTS, activities, sights
from hri_sim.simulation.distance.run import TRACKERS, remedies_of, trackers_of
from hri_sim.simulation.distance.work import Case


def cell_with(joint_map):
    config = configuration.load(configuration.shipped("live_udp.yaml"))
    source = config.source.model_copy(update={"joint_map": joint_map})
    return replace(config, source=source)


def test_the_own_tracker_of_the_cell_also_behind_a_bench():
    found = trackers_of(cell_with("coco17"))
    assert found == ("coco17", "coco17+legs-hidden", "coco17+waist-hidden")
    assert sights(found)[2].hidden == SIGHTS["waist-hidden"].hidden


def test_a_file_of_the_cell_is_found_from_everywhere(tmp_path):
    (tmp_path / "mine.yaml").write_bytes(data_path("skeletons", "coco17.yaml").read_bytes())
    found = trackers_of(replace(cell_with("mine.yaml"), path=tmp_path / "cell.yaml"))
    assert sights(found)[1].tracker == str(tmp_path / "mine.yaml")


def test_a_tracker_of_all_joints_as_several_others():
    assert trackers_of(cell_with("canonical")) == TRACKERS


@pytest.mark.parametrize("sight", ["full", "waist-hidden"])
def test_terms_that_cost_something_have_a_remedy_that_fits_what_is_hidden(sight):
    (person,), _ = activities(["talking"], None)
    (seen,) = sights([sight])
    case = Case(activity=person, sight=seen, noise_m=0.0, predictor=None, modes=("predictive",))
    costs_m = {term.key: 0.0 for term in TERMS} | {"unseen": 0.4, "seen": 0.3}
    found = Waterfall(total_m=1.7, costs_m=costs_m, rest_m=1.0)
    first, second = remedies_of(case, found, cell_with("canonical"))
    assert first.startswith("40 cm of the contributions: zones of unobserved joints; ")
    assert ("left hip" in first) == (sight == "waist-hidden")
    assert ("so that it sees waist" in first) == (sight == "waist-hidden")
    assert second.startswith("30 cm")
