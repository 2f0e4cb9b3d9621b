"""A mock controller as a separate process, in real time.

    python -m hri_sim.controllers.process JOB.json

It prints one JSON line ``{"port": ...}`` when the port is ready, and one with its report on exit.
It exits on SIGTERM or when its standard input closes. In the second case it first waits up to two
seconds for its arm to stop, so that the death of its parent node is just a silent link.
"""

import contextlib
import gc
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.wires.transport import Transport
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import HriPredictError, LinkError
from hri_predict.contracts import registry
from hri_predict.robots.model import RobotSettings
from hri_sim.controllers.controller import ControllerSettings
from hri_sim.controllers.station import Post, Station, at_far_end, codec_for
from hri_sim.controllers.wiring import Wiring
from hri_sim.wires.pty import PtyTransport, open_pty
from hri_sim.wires.slcan_adapter import SlcanAdapter

_LINGER_S = 2.0


def job_for(post: Post, wiring: Path, channels: Sequence[str], factor: float) -> dict[str, Any]:
    """Return the contents of the job file of a controller's process, as plain data."""
    return {
        "link": post.link.model_dump(),
        "settings": post.settings.model_dump(),
        "robot": post.robot.model_dump(),
        "robot_index": post.robot_index,
        "base_dir": None if post.base_dir is None else str(Path(post.base_dir).resolve()),
        "full_speed_m_s": post.full_speed_m_s,
        "wiring": str(wiring),
        "channels": list(channels),
        "factor": factor,
    }


def main(arguments: Sequence[str]) -> int:
    """Run the controller of one job file; return the exit status."""
    try:
        job = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
        post = _post(job)
        wiring = Wiring.open(Path(job["wiring"]), job["channels"])
        station: Station[Any] = Station(post, codec_for(post.link), wiring)
        clock = MonotonicClock(job["factor"])
        wire, port = _far_end(post)
        transport = at_far_end(wire, post.settings, post.name, clock)
        transport.open()
    except (HriPredictError, OSError, IndexError, KeyError, ValueError) as error:
        print(f"hri_sim.controllers.process: {error}", file=sys.stderr)
        return 2
    ended, orphaned = threading.Event(), threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C is for the node, which then ends this process
    threading.Thread(target=_wait_for_end_of_input, args=(orphaned,), daemon=True).start()
    gc.collect()
    gc.freeze()
    _tell({"port": port})
    try:
        _run(station=station, transport=transport, clock=clock, ended=ended, orphaned=orphaned)
    finally:
        transport.close()
        _tell(asdict(station.core.report()))
    return 0


def _tell(what: dict[str, Any]) -> None:
    """Print one line of JSON; ignore errors, because a killed node does not read it."""
    try:
        print(json.dumps(what), flush=True)
    except OSError:
        # What could not be written is still kept, and Python would try again at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(
    *,
    station: Station[Any],
    transport: Transport[Any],
    clock: MonotonicClock,
    ended: threading.Event,
    orphaned: threading.Event,
) -> None:
    linger_until_ns: int | None = None
    units: list[Any] = []
    while not ended.is_set():
        now_ns = clock.now_ns()
        for unit in station.cycle(units, now_ns):
            if getattr(transport, "hung_up", False):
                continue  # no process has the other end open
            try:
                transport.write(unit)
            except LinkError:
                station.core.write_failed()
        if orphaned.is_set():
            linger_until_ns = linger_until_ns or now_ns + int(_LINGER_S * 1e9)
            if station.at_rest or now_ns >= linger_until_ns:
                return
        # The next cycle begins after one period, or as soon as a unit arrives. A missed deadline
        # is not caught up: that would make the next cycles late, too.
        units = _units_until(transport, clock, now_ns + station.period_ns)


def _units_until(transport: Transport[Any], clock: MonotonicClock, deadline_ns: int) -> list[Any]:
    while True:
        remaining_s = (deadline_ns - clock.now_ns()) * 1e-9 / clock.factor
        try:
            units = transport.read(max(0.0, remaining_s))
        except LinkError:
            clock.wait_until(deadline_ns)
            return []
        if units or remaining_s <= 0:
            return units


def _post(job: dict[str, Any]) -> Post:
    kind = registry.load("links", job["link"]["kind"])
    base_dir = job["base_dir"]
    return Post(
        link=kind.settings_model.model_validate(job["link"]),
        settings=ControllerSettings.model_validate(job["settings"]),
        robot=RobotSettings.model_validate(job["robot"]),
        robot_index=job["robot_index"],
        base_dir=None if base_dir is None else Path(base_dir),
        full_speed_m_s=job["full_speed_m_s"],
    )


def _far_end(post: Post) -> tuple[Transport[Any], str]:
    """Open the other end of the link: a pseudo-terminal, or the bus itself if it is shared."""
    link = post.link
    if isinstance(link, CanLinkSettings) and link.interface != "slcan":
        if link.channel is None:
            raise LinkError(
                f"link '{link.name}': set the channel of interface '{link.interface}' that the "
                "mock controller shares (for udp_multicast an address such as 239.74.163.2)"
            )
        return CanLink.make_transport(link), link.channel
    master, port = open_pty()
    if isinstance(link, CanLinkSettings):
        return SlcanAdapter(master), port
    return PtyTransport(master), port


def _wait_for_end_of_input(orphaned: threading.Event) -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 4096):
            pass
    orphaned.set()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
