"""All incidents, by what goes wrong in them."""

from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.incidents.lost_people import LOST_PEOPLE
from hri_sim.fault_table.incidents.second_sender import SECOND_SENDER
from hri_sim.fault_table.incidents.wrong_axes import WRONG_AXES

INCIDENTS: tuple[Incident, ...] = (
    *LOST_PEOPLE,
    *SECOND_SENDER,
    *WRONG_AXES,
)
