"""What SocketCAN says of the bus: error frames, and the state that the kernel keeps.

Source: Linux, include/uapi/linux/can/error.h (error classes in the identifier, details in the
data), and drivers/net/can/dev/dev.c: in bus-off a controller has no carrier until its restart.
"""

import errno
from dataclasses import dataclass, field
from pathlib import Path

CAN_ERR_CRTL = 0x004
CAN_ERR_ACK = 0x020
CAN_ERR_BUSOFF = 0x040
CAN_ERR_RESTARTED = 0x100

CRTL_RX_OVERFLOW = 0x01
CRTL_TX_OVERFLOW = 0x02
CRTL_RX_WARNING = 0x04
CRTL_TX_WARNING = 0x08
CRTL_RX_PASSIVE = 0x10
CRTL_TX_PASSIVE = 0x20
CRTL_ACTIVE = 0x40

SYSFS = Path("/sys/class/net")

BUS_OFF = (
    "bus-off: too many errors, the CAN controller has left the bus; check bit rate, wiring and "
    "termination; it restarts by itself only if restart-ms is set for it, else by: "
    "ip link set {channel} type can restart"
)
DOWN = "the device is down; bring it up: ip link set {channel} up"


@dataclass(slots=True)
class BusHealth:
    """What the error frames of one interface said.

    Attributes:
        frames: error frames heard.
        passive: times the controller became error-passive.
        off: times it went bus-off.
        overflows: times that its receive buffer overflowed, so that frames were lost.
        state: "active", "warning", "passive" or "off", as last told.
    """

    frames: int = 0
    passive: int = 0
    off: int = 0
    overflows: int = 0
    state: str = "active"
    _told: str | None = field(default=None, repr=False)

    def feed(self, classes: int, data: bytes) -> str | None:
        """Take an error frame of SocketCAN; return one line if it tells of new trouble.

        The same trouble is told once, until the controller is error-active again: where the device
        reports every single error, frames come by the thousand.

        Args:
            classes: its identifier, a set of error classes.
            data: its data; shorter ones count as zeros.
        """
        self.frames += 1
        trouble = self._trouble(classes, data)
        if trouble is None or trouble == self._told:
            return None
        self._told = trouble
        return trouble

    def _recovered(self) -> None:
        self.state, self._told = "active", None

    def _trouble(self, classes: int, data: bytes) -> str | None:
        if classes & CAN_ERR_BUSOFF:
            self.off += 1
            self.state, self._told = "off", None
            return "bus-off"
        if classes & CAN_ERR_RESTARTED:
            self._recovered()
        trouble = None
        if classes & CAN_ERR_CRTL:
            trouble = self._controller(data[1] if len(data) > 1 else 0)
        if classes & CAN_ERR_ACK and trouble is None:
            trouble = "nobody acknowledges: is another node on the bus, at this bit rate?"
        return trouble

    def _controller(self, bits: int) -> str | None:
        if bits & (CRTL_RX_OVERFLOW | CRTL_TX_OVERFLOW):
            self.overflows += bool(bits & CRTL_RX_OVERFLOW)
            return "the CAN controller's buffer overflowed, frames were lost: lower the bus load"
        if bits & (CRTL_RX_PASSIVE | CRTL_TX_PASSIVE):
            self.passive += self.state != "passive"
            self.state = "passive"
            return "error-passive: many errors; check bit rate, wiring, termination and other nodes"
        if bits & (CRTL_RX_WARNING | CRTL_TX_WARNING):
            self.state = "warning"
            return "error warning: errors on the bus; check bit rate, wiring and termination"
        if bits & CRTL_ACTIVE:
            self._recovered()
        return None


def why_not_on_bus(channel: str) -> str | None:
    """Why a SocketCAN device takes no part in the bus; ``None`` if it does, or nobody can tell.

    A socket opens on a device that is down or in bus-off all the same, and would hear nothing.
    """
    if Path(channel).name != channel:
        return None
    try:
        carrier = (SYSFS / channel / "carrier").read_text(encoding="ascii").strip()
    except OSError as error:  # the kernel answers EINVAL for a device that is down
        return DOWN.format(channel=channel) if error.errno == errno.EINVAL else None
    return BUS_OFF.format(channel=channel) if carrier == "0" else None
