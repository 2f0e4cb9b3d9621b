"""Worst-case load of a link."""

from collections.abc import Sequence

from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import MIN_STATUS_HZ, LinkLoad
from hri_predict.protocol.messages import Advice, Message, RobotState, Schema, Status
from hri_predict.protocol.robot_state import BASE_ROBOTS
from hri_predict.protocol.wire import SIX_JOINTS, LinkKind, StateShape, wire_bits

SCHEMA_HZ = 1.0
CAN_BITRATES = (125_000, 250_000, 500_000, 800_000, 1_000_000)
BAUDRATES = (9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 921_600, 2_000_000, 3_000_000)


def link_load(
    *,
    name: str,
    kind: LinkKind,
    bitrate: float,
    data_bitrate: int | None,
    extended: bool,
    rate_hz: float,
    robots: Sequence[int],
    shapes: Sequence[StateShape] = (),
    robot_state_rate_hz: float,
    reserved_load: float,
) -> LinkLoad:
    """Worst-case load of the messages that must always fit.

    These are Status and one Advice per robot in each cycle, Schema once a second, and each
    controller's RobotState. Both directions count together, on serial too: half-duplex lines
    (RS-485) carry both, and a full-duplex line just has more room. A RobotState counts with the
    parts that its robot needs.

    Raises:
        LinkError: classic CAN has no frames for the moving base of one of these robots.
    """
    shapes = padded_shapes(robots, shapes)
    if kind == "can":
        _check_bases(name, robots, shapes)
    rates: dict[type[Message], float] = {
        Status: max(rate_hz, MIN_STATUS_HZ),
        Advice: rate_hz * len(robots),
        Schema: SCHEMA_HZ,
    }
    details = {
        message.__name__: rate * wire_bits(message, kind, extended).seconds(bitrate, data_bitrate)
        for message, rate in rates.items()
    }
    states = (wire_bits(RobotState, kind, extended, shape=shape) for shape in shapes)
    details[RobotState.__name__] = robot_state_rate_hz * sum(
        bits.seconds(bitrate, data_bitrate) for bits in states
    )
    load = sum(details.values())
    return LinkLoad(
        name=name,
        load=load,
        spare=1.0 - load - reserved_load,
        details=details,
        rate_hz=rate_hz,
        bitrate=round(bitrate),
        bitrates=CAN_BITRATES if kind != "serial" else BAUDRATES,
    )


def padded_shapes(robots: Sequence[int], shapes: Sequence[StateShape]) -> list[StateShape]:
    """One shape for each robot: those given, then six joints on a base that stands."""
    return [*shapes[: len(robots)], *[SIX_JOINTS] * (len(robots) - len(shapes))]


def _check_bases(name: str, robots: Sequence[int], shapes: Sequence[StateShape]) -> None:
    for robot, shape in zip(robots, shapes, strict=True):
        if shape.moving_base and robot >= BASE_ROBOTS:
            raise LinkError(
                f"link '{name}': classic CAN carries a moving base for the first {BASE_ROBOTS} "
                f"robots only, not for robots[{robot}]; list that robot earlier, or use CAN FD "
                "or serial"
            )
