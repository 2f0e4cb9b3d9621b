"""The other processes of the zenoh bench: a listener to a cell, and a router.

    python -m hri_sim.bench.fleet_far_end hear client|peer ENDPOINT
    python -m hri_sim.bench.fleet_far_end route ENDPOINT

Both end after a line on standard input.
"""

import json
import sys
import threading
import time

from hri_drivers.links.zenoh.link import ZenohLink
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.protocol.keyed import Keyed, KeyedReceiver
from hri_predict.protocol.messages import Status


def hear(mode: str, end: str) -> None:
    """Receive a cell; at the end print when each Status was decoded: ``[[cycle, ns], ...]``."""
    settings = (
        ZenohSettings(connect=[end])
        if mode == "client"
        else ZenohSettings(mode="peer", listen=[end], connect=[])
    )
    observer = ZenohLink.observer(settings, None)
    while True:
        try:
            observer.open()
            break
        except Exception:
            time.sleep(0.05)
    end_asked = threading.Event()

    def ask() -> None:
        sys.stdin.readline()
        end_asked.set()

    threading.Thread(target=ask, daemon=True).start()
    receiver, heard = KeyedReceiver(), list[tuple[int, int]]()
    while not end_asked.is_set():
        for unit in observer.read(0.1):
            messages = receiver.feed(Keyed(unit.key.split("/", 2)[2], unit.data))
            now_ns = time.monotonic_ns()
            heard += [(m.cycle, now_ns) for m in messages if isinstance(m, Status)]
    observer.close()
    print(json.dumps(heard))


def route(end: str) -> None:
    """Run a router at this endpoint."""
    session = open_session(ZenohSettings(mode="router", listen=[end]))
    sys.stdin.readline()
    session.close()


if __name__ == "__main__":
    if sys.argv[1] == "hear":
        hear(*sys.argv[2:])
    else:
        route(*sys.argv[2:])
