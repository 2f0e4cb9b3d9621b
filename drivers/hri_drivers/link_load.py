"""How full a link will be, at worst, and what would fit if it is too full."""

from collections.abc import Sequence

from hri_predict.errors import LinkError
from hri_predict.link import LinkLoad
from hri_predict.protocol.messages import Advice, Message, RobotState, Schema, Status
from hri_predict.protocol.wire import LinkKind, wire_bits

SCHEMA_HZ = 1.0
MIN_STATUS_HZ = 10.0
CAN_BITRATES = (125_000, 250_000, 500_000, 800_000, 1_000_000)
BAUDRATES = (9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 921_600, 2_000_000, 3_000_000)

_PER_CYCLE = (Status.__name__, Advice.__name__)


def link_load(
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
    """Worst-case load of what must always fit.

    Status and an Advice per robot each cycle, Schema once a second, and each controller's
    RobotState. Both directions count together, also on serial: half-duplex lines (RS-485) carry
    both, and a full-duplex one merely has room to spare.
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
        name,
        load,
        1.0 - load - reserved_load,
        details,
        rate_hz=rate_hz,
        bitrate=round(bitrate),
        bitrates=CAN_BITRATES if kind != "serial" else BAUDRATES,
    )


def check_load(load: LinkLoad) -> None:
    """Refuse a link that cannot carry what must always fit.

    Raises:
        LinkError: one line with the load and what would fit.
    """
    if load.spare >= 0:
        return
    reserved = 1.0 - load.load - load.spare
    remedies = _remedies(load, 1.0 - reserved)
    raise LinkError(
        f"link '{load.name}': {load.load:.0%} load and {reserved:.0%} reserved_load do not fit; "
        f"{' or '.join(remedies)}"
    )


def _remedies(load: LinkLoad, room: float) -> Sequence[str]:
    remedies = []
    per_cycle = sum(load.details[name] for name in _PER_CYCLE)
    rate_hz = load.rate_hz * (room - (load.load - per_cycle)) / per_cycle
    if rate_hz >= MIN_STATUS_HZ:
        remedies.append(f"lower rate_hz from {load.rate_hz:g} to {int(rate_hz)}")
    needed = load.bitrate * load.load / room
    faster = next((b for b in load.bitrates if b >= needed and b > load.bitrate), None)
    if faster is not None:
        remedies.append(f"raise the bit rate from {load.bitrate} to {faster}")
    if load.load <= 1.0:
        remedies.append(f"lower reserved_load to {int((1.0 - load.load) * 100) / 100:g}")
    return remedies or ["use a faster kind of link, or fewer robots on this one"]
