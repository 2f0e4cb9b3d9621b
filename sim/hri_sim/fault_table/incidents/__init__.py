"""All incidents, grouped by what goes wrong."""

from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.incidents.lost_people import EXITS, IDENTITY, LOST_PEOPLE
from hri_sim.fault_table.incidents.plants import RESTARTS, SETS
from hri_sim.fault_table.incidents.requests import ACKNOWLEDGES, LATCHES, MUTING
from hri_sim.fault_table.incidents.robots import ROBOT_LIES, SECOND_SENDER
from hri_sim.fault_table.incidents.robots_elsewhere import ROBOTS_ELSEWHERE
from hri_sim.fault_table.incidents.trackers import (
    FAST_PEOPLE,
    LATE_SCENES,
    TRACKER_LIES,
    WRONG_AXES,
)

INCIDENTS: tuple[Incident, ...] = (
    *EXITS,
    *ACKNOWLEDGES,
    *FAST_PEOPLE,
    *IDENTITY,
    *LATCHES,
    *LATE_SCENES,
    *LOST_PEOPLE,
    *MUTING,
    *RESTARTS,
    *ROBOT_LIES,
    *ROBOTS_ELSEWHERE,
    *SECOND_SENDER,
    *SETS,
    *TRACKER_LIES,
    *WRONG_AXES,
)
