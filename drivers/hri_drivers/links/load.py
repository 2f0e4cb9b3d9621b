"""Worst-case load of a link."""

from hri_predict.link import MIN_STATUS_HZ, LinkLoad
from hri_predict.protocol.messages import Advice, Message, RobotState, Schema, Status
from hri_predict.protocol.wire import LinkKind, wire_bits

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
    robots: int,
    robot_state_rate_hz: float,
    reserved_load: float,
) -> LinkLoad:
    """Worst-case load of the messages that must always fit.

    These are Status and one Advice per robot in each cycle, Schema once a second, and each
    controller's RobotState. Both directions count together, on serial too: half-duplex lines
    (RS-485) carry both, and a full-duplex line just has more room.
    """
    rates: dict[type[Message], float] = {
        Status: max(rate_hz, MIN_STATUS_HZ),
        Advice: rate_hz * robots,
        Schema: SCHEMA_HZ,
        RobotState: robot_state_rate_hz * robots,
    }
    details = {
        message.__name__: rate * wire_bits(message, kind, extended).seconds(bitrate, data_bitrate)
        for message, rate in rates.items()
    }
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
