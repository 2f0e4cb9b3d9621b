"""All incidents, by what goes wrong in them."""

from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.incidents.late_scenes import LATE_SCENES
from hri_sim.fault_table.incidents.lost_people import LOST_PEOPLE

INCIDENTS: tuple[Incident, ...] = (*LATE_SCENES, *LOST_PEOPLE)
