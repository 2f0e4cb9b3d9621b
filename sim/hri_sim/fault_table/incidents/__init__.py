"""All incidents, grouped by what goes wrong."""

from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.incidents.acknowledges import ACKNOWLEDGES
from hri_sim.fault_table.incidents.exits import EXITS
from hri_sim.fault_table.incidents.fast_people import FAST_PEOPLE
from hri_sim.fault_table.incidents.identity import IDENTITY
from hri_sim.fault_table.incidents.latches import LATCHES
from hri_sim.fault_table.incidents.late_scenes import LATE_SCENES
from hri_sim.fault_table.incidents.lost_people import LOST_PEOPLE
from hri_sim.fault_table.incidents.muting import MUTING
from hri_sim.fault_table.incidents.robot_lies import ROBOT_LIES
from hri_sim.fault_table.incidents.robots_elsewhere import ROBOTS_ELSEWHERE
from hri_sim.fault_table.incidents.second_sender import SECOND_SENDER
from hri_sim.fault_table.incidents.tracker_lies import TRACKER_LIES
from hri_sim.fault_table.incidents.wrong_axes import WRONG_AXES

INCIDENTS: tuple[Incident, ...] = (
    *EXITS,
    *ACKNOWLEDGES,
    *FAST_PEOPLE,
    *IDENTITY,
    *LATCHES,
    *LATE_SCENES,
    *LOST_PEOPLE,
    *MUTING,
    *ROBOT_LIES,
    *ROBOTS_ELSEWHERE,
    *SECOND_SENDER,
    *TRACKER_LIES,
    *WRONG_AXES,
)
