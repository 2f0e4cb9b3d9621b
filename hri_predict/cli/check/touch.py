"""``check --touched``: is the sensor where ``room_from_source`` says it is?"""

import json
from typing import Any

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.cli.register.points import point_from
from hri_predict.cli.register.sight import choose_joint, opened, place_of
from hri_predict.run import assemble
from hri_predict.run.config import Config

WATCH_S = 3.0


def measure_touch(config: Config, touched: str, joint: str | None = None) -> dict[str, Any]:
    """Watch the source for a while and compare a joint with the point that the joint touches.

    One point shows how far the sensor is displaced, not how it is turned: see ``register``.

    Args:
        config: with the source.
        touched: x,y,z in the room, metres.
        joint: canonical joint; default: a hand, else a wrist, that the source's joint map has.

    Raises:
        ConfigError: the point or the joint is wrong, no sender is there, or the joint was seen too
            rarely or moved.
    """
    point = point_from(touched, 3, "--touched")
    try:
        with opened(assemble.build_source(config)) as sensor:
            joint = choose_joint(sensor.source, joint)
            place = place_of(sensor, sensor.watch(WATCH_S), joint)
    except ConfigError as error:
        raise ConfigError(f"--touched: {error}") from error
    error_m = point - place.middle
    corrected = np.asarray(config.source.room_from_source.xyz) + error_m
    return {
        "joint": joint,
        "touched": point.tolist(),
        "seen": [round(v, 4) for v in place.middle.tolist()],
        "spread_m": round(place.spread_m, 4),
        "off_m": round(float(np.linalg.norm(error_m)), 4),
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
        print("if the sensor is turned, this point says nothing of others: hri-predict register")
    else:
        print("ok: within risk.person_uncertainty_m")
    return fine
