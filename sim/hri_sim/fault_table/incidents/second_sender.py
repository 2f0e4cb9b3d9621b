"""Two nodes with the same ids on one wire."""

from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident
from hri_sim.fault_table.people import person, stands, wait, walk

_FAR = stands([5.0, 3.0], 20.0)
"""Stands far enough away for the robot to move."""

_WALKS_IN = person([5.0, 3.0], wait(3.0), walk([1.3, 0.2]), wait(9.0))
"""Walks up to the robot while another node on the bus sees an empty room."""

SECOND_SENDER = (
    Incident(
        name="second sender: stops an idle cell, and releases it",
        people=(_FAR,),
        duration_s=18.0,
        faults=("monitor:second_sender@5+3",),
        moving=(13.0, 18.0),
        not_moving=(5.1, 9.9),
        says=(Reason.SECOND_SENDER,),
    ),
    Incident(
        name="second sender: says clear while a person walks in",
        people=(_WALKS_IN,),
        duration_s=14.0,
        faults=("drive:second_sender@2+12", "monitor:second_sender@2+12"),
        not_moving=(2.1, 14.0),
        says=(Reason.SECOND_SENDER,),
    ),
)
