"""``check --touched``: is the sensor where ``room_from_source`` says it is?"""

import json
import math
from typing import Any

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.clock import MonotonicClock
from hri_predict.errors import ConfigError
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.skeleton import CANONICAL
from hri_predict.source import Source, wait_for

WATCH_S = 3.0
LEAST_SIGHTS = 10
STILL_M = 0.03


def measure_touch(config: Config, touched: str, joint: str) -> dict[str, Any]:
    """Watch the source for a while and compare a joint with the point that the joint touches.

    One point shows how far the sensor is displaced, not how it is turned. A second point, a metre
    away, shows that.

    Raises:
        ConfigError: the point or the joint is wrong, or the joint was seen too rarely or moved.
    """
    point = _point(touched)
    index = CANONICAL.index(joint)
    seen = _sights(assemble.build_source(config), index)
    if len(seen) < LEAST_SIGHTS:
        raise ConfigError(
            f"--joint {joint}: seen {len(seen)} times in {WATCH_S:g} s; keep it in view, or name "
            f"another joint ({', '.join(CANONICAL.joints)})"
        )
    middle = np.median(seen, axis=0)
    spread = float(np.linalg.norm(seen.std(axis=0)))
    if spread > STILL_M:
        raise ConfigError(
            f"--joint {joint}: it moved by {spread * 1e3:.0f} mm in {WATCH_S:g} s; keep it still "
            f"on the point and repeat"
        )
    error = point - middle
    corrected = np.asarray(config.source.room_from_source.xyz) + error
    return {
        "joint": joint,
        "touched": point.tolist(),
        "seen": [round(v, 4) for v in middle.tolist()],
        "spread_m": round(spread, 4),
        "off_m": round(float(np.linalg.norm(error)), 4),
        "allowed_m": config.node.risk.person_uncertainty_m,
        "room_from_source_xyz": [round(v, 4) for v in corrected.tolist()],
    }


def show_touch(found: dict[str, Any], as_json: bool) -> bool:
    """Print the result and the remedy; return whether the joint is near enough to the point."""
    fine = bool(found["off_m"] <= found["allowed_m"])
    if as_json:
        print(json.dumps(found))
        return fine
    print(f"touched  {found['touched']}")
    print(f"seen     {found['seen']}, spread {found['spread_m'] * 1e3:.0f} mm ({found['joint']})")
    print(f"off by   {found['off_m'] * 1e3:.0f} mm; allowed {found['allowed_m'] * 1e3:.0f} mm")
    if not fine:
        print(f"remedy: source.room_from_source.xyz: {found['room_from_source_xyz']}")
        print("then touch a second point a metre away: if it is off too, the sensor is turned")
    else:
        print("ok: within risk.person_uncertainty_m")
    return fine


def _point(text: str) -> Floats:
    try:
        point = [float(part) for part in text.split(",")]
    except ValueError:
        point = []
    if len(point) != 3 or not all(math.isfinite(v) for v in point):
        raise ConfigError(f"--touched {text}: give three numbers: x,y,z (m)")
    return np.array(point)


def _sights(source: Source, joint: int) -> Floats:
    """Return the observed positions (n, 3) of the joint, in the room frame.

    Raises:
        ConfigError: more than one person is in view.
    """
    clock = MonotonicClock()
    start_ns = clock.now_ns()
    end_ns = start_ns + round(WATCH_S * 1e9)
    source.open(start_ns)
    seen = []
    try:
        while (due_ns := source.next_ns()) is not None and clock.now_ns() < end_ns:
            wait_for(source, min(due_ns, end_ns), clock)
            while (scene := source.poll(clock.now_ns())) is not None:
                if len(scene.people) > 1:
                    raise ConfigError("--touched: more than one person is in view; leave only one")
                for person in scene.people:
                    positions, observed = source.joint_map.map(person.positions, person.observed)
                    if observed[joint]:
                        seen.append(positions[joint])
    finally:
        source.close()
    return np.array(seen).reshape(-1, 3)
