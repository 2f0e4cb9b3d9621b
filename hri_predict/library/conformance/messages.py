"""Messages for the checks of links, one of each kind."""

from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    NodeState,
    RobotMode,
    RobotState,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS


def status(cycle: int) -> Status:
    """Status of a running node."""
    return Status(
        node_state=NodeState.RUNNING,
        reason=Reason.NONE,
        people=1,
        predictor=0,
        cycle=cycle,
        age_s=0.03,
    )


def advice(robot: int, separation_m: float) -> Advice:
    """An Advice to slow down."""
    return Advice(
        robot=robot,
        level=Level.SLOW,
        reason=Reason.PERSON_NEAR,
        separation_m=separation_m,
        age_s=0.03,
    )


def state(counter: int) -> RobotState:
    """Return a RobotState of a robot with six joints."""
    return RobotState(
        robot=0,
        mode=RobotMode.AUTOMATIC,
        counter=counter,
        positions=(0.1,) * 6,
        velocities=(0.2,) * 6,
    )


def zone(person: int) -> Zone:
    """A Zone of one capsule."""
    capsule = ZoneCapsule(0, (0.1, 0.5, 1.0), (0.1, 0.6, 1.3), 0.2)
    return Zone(person=person, step=12, horizon_s=0.48, capsules=(capsule,), age_s=0.03)


def singles() -> list[Message]:
    """One message of each self-contained kind; a Zone or Pose is sent as several messages."""
    return [status(5), advice(0, 0.5), OURS, state(7), Acknowledge(3, 9)]
