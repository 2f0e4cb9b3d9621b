"""A program: a link that sends *slow* 67 times a second; it ends at SIGTERM."""

import signal
import sys
import threading
import time

from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.library.conformance.messages import status
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason

CAPTURED_S = 0.03
"""Age of the capture of each advice when it is posted."""


def main(domain: str, seconds: str = "60") -> None:
    settings = Ros2LinkSettings(
        name="ros", full_speed_m_s=1.0, domain_id=int(domain), silence_timeout_s=0.2
    )
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    clock = MonotonicClock()
    link = Ros2Link(settings, clock)
    link.start()
    end_s, cycle = time.monotonic() + float(seconds), 0
    while not stop.wait(0.015) and time.monotonic() < end_s:
        cycle += 1
        link.post(status(cycle))
        link.post(
            Advice(
                robot=0,
                level=Level.SLOW,
                reason=Reason.PERSON_NEAR,
                speed_limit_m_s=0.5,
                capture_ns=clock.now_ns() - round(CAPTURED_S * 1e9),
            )
        )
    link.stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
