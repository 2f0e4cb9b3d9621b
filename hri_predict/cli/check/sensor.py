"""``check --touched`` and ``--listen``: check the sensor's pose and the people's posture."""

import json
import math
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import transform
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.check.floor import (
    ANKLE_M,
    LEAST_CAPTURES,
    floor_lines,
    floor_of,
    impossible,
    shows_sides,
    verified,
)
from hri_predict.cli.register.points import point_from
from hri_predict.cli.register.sight import choose_joint, opened, place_of, stamps_remedy
from hri_predict.cli.register.solve import quaternion
from hri_predict.contracts.joint_map import METRES_PER_UNIT
from hri_predict.contracts.source import StatesFrame, live_part
from hri_predict.people.body.axes import ALIKE, all_axes
from hri_predict.people.body.posture import posture_of, shows_down
from hri_predict.people.body.posture_watch import Verdict, refusal_of
from hri_predict.people.body.relative import hips_are_origin
from hri_predict.people.body.size import most_are_not_human_sized
from hri_predict.people.body.stature import fitting_unit, is_adult, stature_m
from hri_predict.run import assemble
from hri_predict.run.config import Config

# -- check --touched: is the sensor where room_from_source says it is? -----------------------------

WATCH_S = 3.0


def measure_touch(config: Config, touched: str, joint: str | None = None) -> dict[str, Any]:
    """Observe the source and compare a joint with the point that it touches.

    One point shows the sensor's displacement, but not its rotation: see ``register``.

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
        print("if the sensor is turned, other points may be off by more: hri-predict register")
    else:
        print("ok: within risk.person_uncertainty_m")
    return fine


# -- check --listen: do the people of a live source stand on the floor, and if not, what would? ----

IN_SCENE = ("json", "websocket", "zed_livelink")
"""Kinds of source with units and axes in each scene; those of the joint map are ignored."""
IN_SOURCE = ("mvn", "recording")
"""Kinds of source whose own block has keys for units and axes, which replace the joint map's."""
STANDS = 0.95
"""Cosine above which people stand straight: the axes are right, and only the floor is wrong."""
Heard = dict[int, tuple[Floats, Bools]]
"""Captures of each person, (n, J, 3) and (n, J), placed by the configuration."""


def listen(config: Config, seconds: float) -> dict[str, Any]:
    """Listen to the source for this time and check its people.

    Raises:
        ConfigError: nothing was heard, with the reason.
    """
    with opened(assemble.build_source(config)) as sensor:
        people, scenes = sensor.everybody(seconds)
        if not scenes:
            raise ConfigError(f"--listen: no scene arrived in {seconds:g} s: {sensor.trouble()}")
        joint_map, live = sensor.source.joint_map, live_part(sensor.source)
        to_metres = joint_map.rotation * joint_map.scale_to_m
        if isinstance(sensor.source, StatesFrame) and sensor.source.stated is not None:
            to_metres = sensor.source.stated
    scale_to_m = float(np.cbrt(abs(np.linalg.det(to_metres))))
    unknown = live.counters.last_error if live and live.counters.unknown_joints else None
    seen = [observed for _, observed in people.values()]
    never = joint_map.mapped & ~np.concatenate([np.zeros((1, len(JOINTS)), bool), *seen]).any(0)
    heard = {
        "scenes": scenes,
        "people": len(people),
        "judged": 0,
        "refused": [],
        "remedy": None,
        "floor": None,
        "ankles_m": None,
        "heights_m": {},
        "sides": False,
        "unknown_joints": unknown,
        "stamps": stamps_remedy(sensor.captured_ns, sensor.arrived_ns),
        "never_came": [name for name, lacks in zip(JOINTS, never, strict=True) if lacks],
    }
    if (wrong_size := size_remedy(config, people, scale_to_m)) is not None:
        return heard | {"refused": ["not of human size"], "remedy": wrong_size}
    origin = np.asarray(config.source.room_from_source.xyz, np.float64)
    if any(hips_are_origin(*person, origin) for person in people.values()):
        return heard | {
            "refused": ["relative to the hips: their positions in the room are not sent"],
            "remedy": "let the tracker send positions in the room, not relative to the hips "
            "(MediaPipe's world landmarks have none)",
        }
    people = {n: p for n, p in people.items() if len(p[0]) >= LEAST_CAPTURES}
    why = refusals(config, people, np.eye(4))
    unchecked = config.node.people.posture_unchecked is not None
    judged = 0 if unchecked else sum(any(map(shows_down, seen)) for _, seen in people.values())
    return heard | {
        "people": len(people),
        "judged": judged,
        "refused": sorted({verdict.text for verdict in why}),
        "remedy": remedy(config, people, to_metres / scale_to_m) if why else None,
        **({} if why or unchecked else _on_floor(config, people)),
    }


def _on_floor(config: Config, people: Heard) -> dict[str, Any]:
    """Return what people whose posture is possible show of the floor and of their sides."""
    facts = floor_of(people, config.node.people.floor_m)
    found = {
        "floor": facts.floor.value,
        "ankles_m": facts.ankles_m,
        "heights_m": facts.heights_m,
        "sides": shows_sides(people),
    }
    wrong = impossible(facts, config.source.room_from_source.xyz[2])
    return found if wrong is None else found | {"refused": [wrong[0]], "remedy": wrong[1]}


def show(found: dict[str, Any], config: Config, as_json: bool) -> bool:
    """Print the findings; return whether a person was verified and all names are known."""
    unchecked = config.node.people.posture_unchecked is not None
    fine = not found["refused"] and not found["unknown_joints"] and not found.get("stamps")
    fine = fine and bool(found["people"] if unchecked else found["judged"] and verified(found))
    if as_json:
        print(json.dumps(found))
        return fine
    print(f"heard {found['scenes']} scenes, people: {found['people']}")
    if found["unknown_joints"]:
        print(f"wrong: the sender sends {found['unknown_joints']}")
        print("remedy: write these names as in the joint map, or add them to source.joint_map")
    if found.get("stamps"):
        print(f"wrong: {found['stamps']}")
    if found["people"] and found["never_came"]:
        print(
            f"mapped, but never received: {', '.join(found['never_came'])}; is the whole body in "
            f"view?"
        )
    reason = config.node.people.posture_unchecked
    if found["refused"]:
        print(f"wrong: bodies are {'; '.join(found['refused'])}")
        print(f"remedy: {found['remedy']}")
    elif reason is not None:
        print(f"not checked against gravity and the floor: {reason}")
    elif not found["judged"]:
        print(
            "the orientation could not be verified: have a person stand in view, trunk and "
            "legs visible"
        )
    else:
        print("\n".join(floor_lines(found, fine)))
    return fine


def size_remedy(config: Config, people: Heard, scale_to_m: float) -> str | None:
    """Return the unit in which bodies are of human size; ``None`` if most captures already are.

    Args:
        config: gives the kind of source, and so where units are stated.
        people: as received.
        scale_to_m: metres per unit as stated now, in the scenes or otherwise in the joint map.
    """
    bodies = [(b, o) for each in people.values() for b, o in zip(*each, strict=True) if o.any()]
    stature = stature_m(bodies)
    small = most_are_not_human_sized(bodies)
    if not small and (stature is None or is_adult(stature)):
        return None
    if stature is None or (fitting := fitting_unit(stature, scale_to_m)) is None:
        return "no known unit gives human size; check the tracker's scale and its joints' names"
    unit_m, right = fitting
    now = next((n for n, m in METRES_PER_UNIT.items() if math.isclose(m, scale_to_m)), "others")
    wanted = f"{unit_m:.6g}" if " " in right else right
    would = f"they would be of human size with units: {wanted} instead of {now}"
    kind = config.source.kind
    if kind in IN_SCENE and right not in ("m", "mm"):
        return (
            f"{would}; let the sender multiply its coordinates by {unit_m:.6g} and state "
            f"units: m in each scene"
        )
    if kind in IN_SCENE:
        return f"{would}; let the sender state it in each scene"
    if kind == "recording":
        return f"{would}; put unit_m: {unit_m:.6g} into source"
    return f"{would}; put it into {'source' if kind in IN_SOURCE else 'the joint map'}"


def refusals(config: Config, people: Heard, correction: Floats) -> list[Verdict]:
    """Return why people are rejected after everything is moved by ``correction`` (4, 4)."""
    found = (
        refusal_of(
            transform(correction, positions),
            observed,
            config.node.people,
            config.source.field_of_view,
        )
        for positions, observed in people.values()
    )
    return [verdict for verdict in found if verdict is not None]


def remedy(config: Config, people: Heard, rotation: Floats) -> str:
    """Return, in one line, the configuration change that makes people stand.

    Args:
        config: as it is.
        people: as received with it.
        rotation: (3, 3) present rotation of the joint map.
    """
    now = refusals(config, people, np.eye(4))
    if now == [Verdict.OFF_FLOOR] * len(people) and uprightness(people, np.eye(4)) > STANDS:
        return _off_floor(config, people)
    if set(now) == {Verdict.OUT_OF_VIEW} and uprightness(people, np.eye(4)) > STANDS:
        return _out_of_view(people)
    pose = config.source.room_from_source.matrix()
    for hands in (1.0, -1.0):  # all proper axes before any that mirror
        best, chosen = 0.0, ""
        for axes, turn in all_axes(hands):
            correction = np.eye(4)
            correction[:3, :3] = turn @ rotation.T
            correction = pose @ correction @ np.linalg.inv(pose)
            upright = uprightness(people, correction)
            if upright > best + ALIKE and not refusals(config, people, correction):
                best = upright
                chosen = _named(
                    axes,
                    correction @ pose,
                    mirrored=hands < 0,
                    upright=set(now) == {Verdict.MIRRORED},
                    place=_place(config.source.kind),
                )
        if chosen:
            return chosen
    view = "source.field_of_view, " if Verdict.OUT_OF_VIEW in now else ""
    return (
        "no exchange of axes makes them stand; measure the pose with hri-predict register, and "
        f"check {view}people.floor_m and the joint map's joints and units"
    )


def uprightness(people: Heard, correction: Floats) -> float:
    """Cosine between gravity and the sum of all bodies' down, moved by ``correction``."""
    down = np.zeros(3)
    for captures in people.values():
        for posture in map(posture_of, *captures):
            down += posture.down
    length = float(np.linalg.norm(down))
    return float(-(correction[:3, :3] @ down)[2] / length) if length else 0.0


def _place(kind: str) -> str:
    """Return where the axes of a source of this kind are stated."""
    if kind in IN_SCENE:
        return "each scene that the sender writes"
    return "source" if kind in IN_SOURCE else "the joint map"


def _named(axes: list[str], matrix: Floats, *, mirrored: bool, upright: bool, place: str) -> str:
    shown = f"[{', '.join(axes)}]"
    end = "; then measure the heading and the place with hri-predict register"
    if mirrored:
        swap = "exchange left and right in the joint map, or " if upright else ""
        return f"{swap}put axes: {shown} with left_handed: true into {place}{end}"
    numbers = [round(float(v), 6) + 0.0 for v in quaternion(matrix[:3, :3])]
    return (
        f"bodies would stand with axes: {shown} in {place}, or with "
        f"source.room_from_source.quaternion_xyzw: {numbers}{end}"
    )


def _out_of_view(people: Heard) -> str:
    """Return the remedy for people who stand, but not where the source sees."""
    places = [np.median(positions[observed], axis=0) for positions, observed in people.values()]
    shown = ", ".join(f"[{x:.2f}, {y:.2f}, {z:.2f}]" for x, y, z in places[:3])
    return (
        f"the middles of bodies are at {shown} in the room: if people were there, enlarge "
        f"source.field_of_view (polygon, z_min, z_max); if not, measure the heading and the place "
        f"with hri-predict register"
    )


def _off_floor(config: Config, people: Heard) -> str:
    feet = [
        posture.feet_m
        for captures in people.values()
        for posture in map(posture_of, *captures)
        if posture.feet_m is not None
    ]
    floor_m = config.node.people.floor_m
    if not feet:
        return (
            f"people.floor_m is {floor_m:g}: correct it, or the "
            f"height in source.room_from_source.xyz"
        )
    at_m = float(np.median(feet))
    x, y, z = config.source.room_from_source.xyz
    raised = [x, y, round(z + floor_m + ANKLE_M - at_m, 3)]
    return (
        f"ankles are at {at_m:.2f} m and people.floor_m is {floor_m:g}: "
        f"source.room_from_source.xyz: {raised} puts them on the floor; or correct people.floor_m, "
        f"if it is {at_m - ANKLE_M:.2f}"
    )
