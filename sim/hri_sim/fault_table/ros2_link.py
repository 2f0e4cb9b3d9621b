"""Faults of a ROS 2 link: their effect on a subscriber. Needs ROS 2.

The subscriber is the sample ``drivers/ros2/speed_follower.py`` in a separate process. The advice
is ``ADVICE``.
"""

import os
import subprocess
import threading
import time
from pathlib import Path

from hri_drivers import links
from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_predict.base.machine.orphans import command_of
from hri_sim.fault_table.link_cell import LOOK_S, PERIOD_S, LinkCase, LinkCell
from hri_sim.wires.samples import ADVICE

SILENCE_S = 0.2  # of the follower and of the link
LATE_MS = 1e3 * (PERIOD_S + 0.01)  # one cycle, and the follower's timer
SILENT_MS = 1e3 * SILENCE_S + LATE_MS
DOMAIN = 201  # of the table alone

CASES = (
    LinkCase("node hangs", "stop", SILENT_MS, "hangs"),
    LinkCase("node ends", "stop", LATE_MS, "ends"),
    LinkCase("delayed 1 s", "stop", SILENT_MS, {"kind": "delay", "delay_s": 1.0}, drain_s=1.0),
    LinkCase("everything lost", "stop", SILENT_MS, {"kind": "drop", "probability": 1.0}),
    LinkCase("flooded, everything 10 times", "count only", None, {"kind": "flood"}),
)


class Ros2Cell(LinkCell):
    """The link and the sample subscriber, which prints the speed that it sets."""

    start_s, acts = 6.0, "subscriber"
    well = f"speed {ADVICE.speed_limit_m_s:.3f}"
    stopped = {"speed 0.000": "silent"}

    def __init__(self, case: LinkCase) -> None:
        super().__init__(case)
        package = Path(links.__file__).parents[1]
        folders = (package / "ros2", package.parent / "ros2")  # of a wheel, of a clone
        script = next(f / "speed_follower.py" for f in folders if f.is_dir())
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }  # fmt: skip
        self._follower = subprocess.Popen(
            command_of(str(script)), env=environment, stdout=subprocess.PIPE, text=True
        )
        threading.Thread(target=self._read, daemon=True).start()

    def settings(self) -> tuple[type[Ros2Link], Ros2LinkSettings]:
        """Return a robot whose full speed is 1 m/s."""
        return Ros2Link, Ros2LinkSettings(
            name="ros", full_speed_m_s=1.0, domain_id=DOMAIN, silence_timeout_s=SILENCE_S
        )

    def look(self) -> None:
        """Wait; a thread records the follower's output."""
        time.sleep(LOOK_S)

    def close(self) -> None:
        """Stop the link and the follower."""
        super().close()
        self._follower.kill()
        self._follower.wait()

    def _read(self) -> None:
        assert self._follower.stdout is not None
        for line in self._follower.stdout:
            self.shown.append((time.monotonic(), line.strip()))
