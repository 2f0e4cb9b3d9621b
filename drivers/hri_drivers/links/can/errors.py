"""SocketCAN's reports about the bus: error frames, and the state in the kernel.

Source: Linux, include/uapi/linux/can/error.h (error classes in the identifier, details in the
data), and drivers/net/can/dev/dev.c: in bus-off a controller has no carrier until it restarts.
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
    "bus-off: after too many errors the CAN controller has left the bus; check bit rate, wiring "
    "and termination; it restarts by itself only if restart-ms is set, else run: ip link set "
    "{channel} type can restart"
)
DOWN = "the device is down; bring it up: ip link set {channel} up"


@dataclass(slots=True, kw_only=True)
class BusHealth:
    """The state of one interface according to its error frames.

    Attributes:
        frames: error frames received.
        passive: number of times the controller became error-passive.
        off: number of times it went bus-off.
        state: "active", "warning", "passive" or "off", as last reported.
    """

    frames: int = 0
    passive: int = 0
    off: int = 0
    state: str = "active"
    _told: str | None = field(default=None, repr=False)

    def feed(self, classes: int, data: bytes) -> str | None:
        """Process an error frame from SocketCAN; return one line if it reports a new problem.

        The same problem is reported once, until the controller is error-active again: some devices
        report every single error in thousands of frames.

        Args:
            classes: the identifier, a set of error classes.
            data: the data; missing bytes count as zeros.
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
            trouble = "no node acknowledges: connect another node to the bus, at this bit rate"
        return trouble

    def _controller(self, bits: int) -> str | None:
        if bits & (CRTL_RX_OVERFLOW | CRTL_TX_OVERFLOW):
            return "the CAN controller's buffer overflowed and lost frames: lower the bus load"
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
    """The reason why a SocketCAN device is off the bus; ``None`` if it is on, or unknown.

    A socket opens even on a device that is down or in bus-off, and then receives nothing.
    """
    if Path(channel).name != channel:
        return None
    try:
        carrier = (SYSFS / channel / "carrier").read_text(encoding="ascii").strip()
    except OSError as error:  # the kernel answers EINVAL for a device that is down
        return DOWN.format(channel=channel) if error.errno == errno.EINVAL else None
    return BUS_OFF.format(channel=channel) if carrier == "0" else None
