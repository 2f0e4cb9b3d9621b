"""Sends packets like a VMC performer, as a stand-in in tests, fault tables and trials.

Written from the VMC protocol's Marionette specification V2.7 and OSC 1.0; it shares no code with
the reader. Every bone is rotated, which reveals receivers that ignore rotations.
"""

import math
from collections.abc import Sequence
from functools import cache
from struct import pack

import numpy as np

from hri_predict.base.arrays import Floats
from hri_sim.senders.body_points import BodyPoints

OK = (1, 3, 1, 1)
"""Loaded, calibrated, in an MR mode, tracking."""
BUNDLE_MESSAGES = 15  # below 1500 bytes
IMMEDIATELY = pack(">Q", 1)
_ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")


def capture(
    joints: Floats,
    time_s: float,
    *,
    ok: Sequence[int] = OK,
    scale: float = 1.0,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    time_first: bool = False,
    leave_out: Sequence[str] = (),
) -> list[bytes]:
    """Return the packets of one capture.

    Args:
        joints: (21, 3) canonical joints in metres: x forward, y left, z up.
        time_s: the performer's time.
        ok: arguments of ``/VMC/Ext/OK``.
        scale, offset: scale and offset of the avatar; the joints are the wearer's.
        time_first: whether the time comes before the bones.
        leave_out: bones that this avatar lacks.
    """
    status = bundle([message("/VMC/Ext/OK", *ok), message("/VMC/Ext/T", float(time_s))])
    root, bones = avatar(joints, scale, offset, leave_out)
    messages = [message("/VMC/Ext/Root/Pos", "root", *root, *([scale] * 3), *offset)]
    messages += [message("/VMC/Ext/Bone/Pos", name, *pose) for name, pose in bones.items()]
    groups = [
        messages[at : at + BUNDLE_MESSAGES] for at in range(0, len(messages), BUNDLE_MESSAGES)
    ]
    packets = [bundle(group) for group in groups]
    return [status, *packets] if time_first else [*packets, status]


def avatar(
    joints: Floats,
    scale: float = 1.0,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    leave_out: Sequence[str] = (),
) -> tuple[list[float], dict[str, list[float]]]:
    """Return root and local bone poses in Unity's frame: position, quaternion x, y, z, w."""
    body = BodyPoints(np.asarray(joints)[:, [1, 2, 0]] * [-1.0, 1.0, 1.0] * scale + offset)
    parents, places = _hierarchy(body, leave_out)
    turns = {name: _turn(k) for k, name in enumerate(places)}
    floor = body.at("waist") * [1.0, 0.0, 1.0]
    turns["root"], places["root"] = _about_y(0.7), floor
    local = {}
    for name, parent in parents.items():
        back = _inverse(turns[parent])
        place = _turned(back, places[name] - places[parent])
        local[name] = [*place, *_product(back, turns[name])]
    return [*floor, *turns["root"]], local


def _hierarchy(
    body: BodyPoints, leave_out: Sequence[str]
) -> tuple[dict[str, str], dict[str, Floats]]:
    """Return the parents of the bones, and their positions."""
    spine = {
        "Hips": body.at("waist"),
        "Spine": body.between("waist", "torso", 0.4),
        "Chest": body.at("torso"),
        "UpperChest": body.between("torso", "neck", 0.4),
        "Neck": body.at("neck"),
        "Head": body.at("head"),
    }
    chains = [("root", spine)]
    for side, letter in (("Left", "l"), ("Right", "r")):
        points = body.limbs(letter)
        arm = {f"{side}{bone}": point for bone, point in zip(_ARM, points[:4], strict=True)}
        leg = {f"{side}{bone}": point for bone, point in zip(_LEG, points[4:], strict=True)}
        chest = next(b for b in ("UpperChest", "Chest", "Spine") if b not in leave_out)
        chains += [(chest, arm), ("root" if "Hips" in leave_out else "Hips", leg)]
    parents, places = {}, {}
    for parent, chain in chains:
        for name, place in chain.items():
            if name not in leave_out:
                parents[name], places[name] = parent, place
                parent = name
    return parents, places


def bundle(messages: Sequence[bytes]) -> bytes:
    """Return an OSC bundle of messages."""
    elements = b"".join(pack(">i", len(each)) + each for each in messages)
    return b"#bundle\0" + IMMEDIATELY + elements


def message(address: str, *arguments: str | int | float) -> bytes:
    """Return an OSC message."""
    tags, data = ",", b""
    for each in arguments:
        if isinstance(each, str):
            tags, data = tags + "s", data + _text(each)
        elif isinstance(each, int):
            tags, data = tags + "i", data + pack(">i", each)
        else:
            tags, data = tags + "f", data + pack(">f", each)
    return _text(address) + _text(tags) + data


def _text(text: str) -> bytes:
    data = text.encode("ascii") + b"\0"
    return data + b"\0" * (-len(data) % 4)


_Turn = tuple[float, float, float, float]


@cache
def _turn(k: int) -> _Turn:
    """Return a rotation that differs from bone to bone."""
    axis = np.array([math.sin(k), math.cos(2 * k), 0.5])
    x, y, z = axis / np.linalg.norm(axis) * math.sin(0.2 + 0.1 * k)
    return float(x), float(y), float(z), math.cos(0.2 + 0.1 * k)


def _about_y(angle: float) -> _Turn:
    return 0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)


def _inverse(q: _Turn) -> _Turn:
    return -q[0], -q[1], -q[2], q[3]


def _cross(u: Sequence[float], v: Sequence[float]) -> tuple[float, float, float]:
    """Return the cross product in plain numbers: numpy takes ten times as long for three."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def _product(a: _Turn, b: _Turn) -> _Turn:
    """Return the rotation that applies ``b``, then ``a``."""
    x, y, z = (a[3] * v + b[3] * u + w for u, v, w in zip(a[:3], b[:3], _cross(a, b), strict=True))
    return x, y, z, a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]


def _turned(q: _Turn, place: Floats) -> tuple[float, float, float]:
    px, py, pz = place.tolist()
    cx, cy, cz = (2 * each for each in _cross(q, (px, py, pz)))
    dx, dy, dz = _cross(q, (cx, cy, cz))
    return px + q[3] * cx + dx, py + q[3] * cy + dy, pz + q[3] * cz + dz
