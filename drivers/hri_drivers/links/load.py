"""Worst-case load of a link."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import MIN_STATUS_HZ
from hri_predict.protocol.messages import Advice, Message, RobotState, Schema, Status
from hri_predict.protocol.robot_state import BASE_ROBOTS
from hri_predict.protocol.wire import SIX_JOINTS, StateShape

SCHEMA_HZ = 1.0
CAN_BITRATES = (125_000, 250_000, 500_000, 800_000, 1_000_000)
BAUDRATES = (9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 921_600, 2_000_000, 3_000_000)


@dataclass(frozen=True)
class Traffic:
    """Messages that a link must always fit.

    These are Status and one Advice per robot in each cycle, Schema once a second, and each
    controller's RobotState. Both directions count together, also on serial: half-duplex lines
    (RS-485) carry both, and a full-duplex line only has more room.

    Attributes:
        rate_hz: the node's cycle rate.
        robots: indices of the advised robots.
        shapes: shape of each robot; robots without a given shape get six joints on a fixed base.
    """

    rate_hz: float
    robots: Sequence[int]
    shapes: Sequence[StateShape]

    def __post_init__(self) -> None:
        padding = [SIX_JOINTS] * (len(self.robots) - len(self.shapes))
        object.__setattr__(self, "shapes", [*self.shapes[: len(self.robots)], *padding])

    def shares(
        self, seconds: Callable[[type[Message], StateShape], float], states_hz: float
    ) -> dict[str, float]:
        """Return the fraction of the time for which each message occupies the wire.

        Args:
            seconds: worst-case seconds on the wire of one message; a RobotState has a shape.
            states_hz: rate of each robot's RobotState.
        """
        rates: dict[type[Message], float] = {
            Status: max(self.rate_hz, MIN_STATUS_HZ),
            Advice: self.rate_hz * len(self.robots),
            Schema: SCHEMA_HZ,
        }
        shares = {kind.__name__: hz * seconds(kind, SIX_JOINTS) for kind, hz in rates.items()}
        states = sum(seconds(RobotState, shape) for shape in self.shapes)
        return shares | {RobotState.__name__: states_hz * states}


def check_bases(name: str, traffic: Traffic) -> None:
    """Refuse a robot that classic CAN cannot carry.

    Raises:
        LinkError: classic CAN lacks frames for the moving base of one of these robots.
    """
    for robot, shape in zip(traffic.robots, traffic.shapes, strict=True):
        if shape.moving_base and robot >= BASE_ROBOTS:
            raise LinkError(
                f"link '{name}': classic CAN carries a moving base for the first {BASE_ROBOTS} "
                f"robots only, not for robots[{robot}]; list that robot earlier, or use CAN FD "
                "or serial"
            )
