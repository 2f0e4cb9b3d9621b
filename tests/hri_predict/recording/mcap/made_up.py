"""Made-up scenes and ticks, recorded."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hri_predict.base.geometry import Capsules
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.link import Received
from hri_predict.contracts.predictor import Forecast
from hri_predict.contracts.scene import Person, Scene
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import (
    Level,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.zones.types import Zones
from tests.messages import make_advice, make_state, make_status

JOINTS = 6


def info(**more: Any) -> RecordingInfo:
    fields = {"joint_map": load_joint_map("assembly_arms"), "rate_hz": 30.0}
    fields |= {"declares_noise": True, "config": "rate_hz: 25\n", "predictor": "zero_velocity"}
    fields["robots"] = (("arm", ("base", "forearm")),)
    return RecordingInfo(**(fields | more))  # type: ignore[arg-type]


def scene(k: int, people: int = 1, sees_room: bool = True) -> Scene:
    rng = np.random.default_rng(k)
    found = []
    for i in range(people):
        observed = rng.random(JOINTS) < 0.8
        positions = np.where(observed[:, None], rng.normal(size=(JOINTS, 3)), np.nan)
        found.append(Person(10 + i, positions, observed, error_m=0.5 * (k % 3)))
    return Scene(1_000_000 * k + 17, 3 * k, sees_room, tuple(found))


def tick(k: int, people: int = 1) -> Tick:
    rng = np.random.default_rng(100 + k)
    ids = tuple(range(10, 10 + people))
    snapshot: Any = SimpleNamespace(
        now_ns=40_000_000 * k,
        ids=ids,
        capture_ns=np.full(people, 40_000_000 * k - 5),
        last_positions=rng.normal(size=(people, 21, 3)),
        lost=(),
        reasons=(),
        counters={},
    )
    capsules = Capsules(
        rng.normal(size=(people, 26, 17, 3)),
        rng.normal(size=(people, 26, 17, 3)),
        rng.random((people, 26, 17)),
    )
    names = tuple(f"segment{i}" for i in range(17))
    zones = Zones(ids, names, np.linspace(0.0, 1.0, 26), capsules)
    assessment: Any = SimpleNamespace(zones=zones, reasons=(), named_zones=(), grounds=())
    return Tick(
        now_ns=40_000_000 * k,
        status=make_status(people=people, cycle=k, predictor=1),
        advices=(make_advice(Level.SLOW, Reason.PERSON_NEAR, separation_m=0.71, detail="l_hand"),),
        snapshot=snapshot,
        forecast=Forecast(rng.normal(size=(people, 25, 21, 3)), None),
        assessment=assessment,
    )


def record(path: Path, ticks: int, threaded: bool = False, **more: Any) -> Recorder:
    with Recorder(path, info(), threaded=threaded, **more) as recorder:
        for k in range(ticks):
            recorder.on_scene(scene(k), 1_000_000 * k + 40)
            state = make_state((0.1 * k, -1.0), (0.0, 0.5), counter=k % 256)
            recorder.on_received("serial", Received(state, 1_000_000 * k + 50))
            recorder.on_tick(tick(k))
            recorder.sent("serial", b"\x01\x02", 1_000_000 * k + 60)
            frame = SimpleNamespace(arbitration_id=0x123, data=bytes(range(8)))
            recorder.sent("can", frame, 1_000_000 * k + 61)
    return recorder
