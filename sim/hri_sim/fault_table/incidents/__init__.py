"""All incidents, by what goes wrong in them."""

from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.incidents.fast_people import FAST_PEOPLE
from hri_sim.fault_table.incidents.lost_people import LOST_PEOPLE

INCIDENTS: tuple[Incident, ...] = (*FAST_PEOPLE, *LOST_PEOPLE)
