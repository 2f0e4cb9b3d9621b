"""A saturating link fills its wire, and never more, whenever its writer wakes up a little late."""

import pytest

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.links.supervised import BULK_AHEAD_NS
from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.protocol.messages import Advice, Level, Zone, ZoneCapsule
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import SerialSender

CYCLE_NS, CYCLES = 40_000_000, 60
LATE_NS = 300_000  # a thread wakes up so late on a machine that has something else to do too
CAPSULES = tuple(ZoneCapsule(i, (0.0, 0.0, 1.0), (0.0, 0.5, 1.0), 0.2) for i in range(17))
ADVICE = Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_NEAR)


class Line:
    """The wire as it is: a bit at a time."""

    def __init__(self, bits_per_s: float) -> None:
        self._ns_per_byte = 10e9 / bits_per_s
        self.free_ns = self.busy_ns = self.longest_wait_ns = 0.0

    def take(self, units: list[bytes], now_ns: int) -> None:
        took_ns = sum(map(len, units)) * self._ns_per_byte
        self.free_ns = max(self.free_ns, now_ns) + took_ns
        self.busy_ns += took_ns
        self.longest_wait_ns = max(self.longest_wait_ns, self.free_ns - now_ns)


@pytest.mark.parametrize("baudrate", [115_200, 921_600])
@pytest.mark.parametrize("reserved_load", [0.0, 0.3])
def test_the_wire_is_filled_and_never_overfilled(baudrate, reserved_load):
    clock, (near, far) = VirtualClock(), pipe()  # type: ignore[var-annotated]
    settings = SerialLinkSettings(
        name="cell", port="x", baudrate=baudrate, reserved_load=reserved_load, robot_state_rate_hz=0
    )
    link = SerialLink(settings, clock, near, rate_hz=1e9 / CYCLE_NS)
    far.open()
    link.service(0)
    line = Line(baudrate)
    due_ns = 0
    while due_ns < CYCLES * CYCLE_NS:
        if clock.now_ns() >= due_ns:
            link.post(ADVICE)
            for person in range(12):
                link.post(
                    Zone(
                        person=person,
                        step=0,
                        horizon_s=0.0,
                        capsules=CAPSULES,
                        capture_ns=clock.now_ns(),
                    )
                )
            due_ns += CYCLE_NS
        link._drain(clock.now_ns, paced=True)
        line.take(far.read(0.0), clock.now_ns())
        patience_s = link._patience_s()
        asleep_ns = due_ns if patience_s is None else clock.now_ns() + int(patience_s * 1e9)
        clock.advance_to(min(due_ns, asleep_ns) + LATE_NS)
    used = line.busy_ns / clock.now_ns()
    burst = link._bulk.budget.depth_s * 1e9 / clock.now_ns()  # at the start the budget is full
    assert 0.95 * (1.0 - reserved_load) <= used <= 1.0 - reserved_load + burst
    frame = (
        max(
            map(
                len,
                SerialSender()
                .encode(Zone(person=0, step=0, horizon_s=0.0, capsules=CAPSULES))
                .split(b"\0"),
            )
        )
        + 1
    )
    both = frame + len(SerialSender().encode(ADVICE))
    assert line.longest_wait_ns <= BULK_AHEAD_NS + both * 10e9 / baudrate + 1
