"""Two senders, a process each, over UDP into one node: one falls silent, and comes back."""

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.wires.ports import free_udp_port

pytestmark = pytest.mark.realtime

SENDER = Path(__file__).resolve().parents[3] / "drivers" / "python" / "hri_sender.py"
PATIENCE_S = 120.0
"""The node runs until all has happened, or for so long on a machine that is very busy."""
PORTS = {"back": free_udp_port(), "front": free_udp_port()}
RATES = {"back": 25, "front": 30}


class Stages(View):
    """Waits for one condition after the other, and acts when it holds."""

    def __init__(self, stages: list[tuple[Callable[[Scene], bool], Callable[[], object]]]) -> None:
        self.left = stages
        self.silent: list[Tick] = []

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        if self.left and self.left[0][0](scene):
            self.left.pop(0)[1]()

    def on_tick(self, tick: Tick) -> None:
        if not self.left:
            signal.raise_signal(signal.SIGINT)
        if tick.snapshot and any("back is silent" in d.text for d in tick.snapshot.doubts):
            self.silent.append(tick)


def send(name: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, SENDER, "--port", str(PORTS[name]), "--rate", str(RATES[name])]
    )


def seen_by_both(scene: Scene) -> bool:
    names = [name for person in scene.people for name, _ in person.seen_as]
    return len(scene.people) == 1 and names == ["back", "front"] and not scene.doubts


def test_two_senders_show_one_person_and_a_silent_one_is_named() -> None:
    shipped = configuration.load(configuration.shipped("two_sensors.yaml"))
    source = shipped.source.model_dump()
    for name, port in PORTS.items():
        source["sensors"][name] |= {"port": port, "rate_hz": RATES[name]}
    senders = {name: send(name) for name in PORTS}
    try:
        stages = Stages(
            [
                (seen_by_both, lambda: senders["back"].kill()),
                (
                    lambda s: any("back is silent" in d.text for d in s.doubts),
                    lambda: senders.update(again=send("back")),
                ),
                (seen_by_both, lambda: None),
            ]
        )
        summary = run(
            shipped.quiet().with_source(source), Options(duration_s=PATIENCE_S, view=stages)
        )
    finally:
        for sender in senders.values():
            sender.kill()
            sender.wait()
    assert not stages.left
    assert stages.silent
    assert {tick.advices[0].level for tick in stages.silent} <= {Level.UNKNOWN, Level.STOP}
    assert summary.source["kind"] == "merged"
    assert summary.source["live"]["packets"] > 0
    assert summary.source["live"]["restarts"] >= 1
