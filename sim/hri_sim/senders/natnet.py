"""A stand-in for OptiTrack Motive: NatNet 4.1 packets, and a server that answers a client.

Written from the NatNet SDK's "Data Types"; it shares no code with the reader.
"""

import contextlib
import socket
import threading
from collections.abc import Mapping, Sequence
from struct import pack, unpack_from

import numpy as np

from hri_predict.base.arrays import Floats
from hri_sim.senders.body_points import BodyPoints

SERVER_INFO, MODELS, FRAME = 1, 5, 7
BONES = (
    "Hip", "Ab", "Chest", "Neck", "Head",
    "LShoulder", "LUArm", "LFArm", "LHand", "RShoulder", "RUArm", "RFArm", "RHand",
    "LThigh", "LShin", "LFoot", "LToe", "RThigh", "RShin", "RFoot", "RToe",
)  # fmt: skip
PARENTS = (0, 1, 2, 3, 4, 3, 6, 7, 8, 3, 10, 11, 12, 1, 14, 15, 16, 1, 18, 19, 20)
"""Ids (from 1) of the bones' parents; 0 of the root."""
OFFSET = (0.1, 0.2, 0.3)
_QUATERNION = (0.5, 0.5, 0.5, 0.5)


def packet(message: int, payload: bytes) -> bytes:
    """Return a packet with its header."""
    return pack("<HH", message, len(payload)) + payload


def server_info(version: Sequence[int] = (4, 1, 0, 0)) -> bytes:
    """Return the answer to a client that connects."""
    name = b"Motive".ljust(256, b"\0")
    return packet(SERVER_INFO, name + bytes((3, 1, 0, 0)) + bytes(version) + bytes(8))


def model_definitions(skeletons: Mapping[int, str], minor: int = 1) -> bytes:
    """Return descriptions: a rigid body that is not a person, then these skeletons, by id."""
    datasets = [pack("<ii", 1, 12) + b"Wand".ljust(12, b"\0")]
    for number, name in skeletons.items():
        bones = b"".join(
            _text(f"{name}_{bone}") + pack("<ii3f", k + 1, parent, *OFFSET)
            + (pack("<4f", *_QUATERNION) if minor >= 2 else b"")
            + pack("<i3fi", 1, 0.0, 0.0, 0.0, 0) + _text("marker")
            for k, (bone, parent) in enumerate(zip(BONES, PARENTS, strict=True))
        )  # fmt: skip
        found = _text(name) + pack("<ii", number, len(BONES)) + bones
        datasets.append(pack("<ii", 2, len(found)) + found)
    return packet(MODELS, pack("<i", len(datasets)) + b"".join(datasets))


def frame(
    number: int,
    time_s: float,
    people: Mapping[int, Floats],
    *,
    untracked: Sequence[str] = (),
    local: bool = False,
    changed: bool = False,
) -> bytes:
    """Return a frame of data.

    Args:
        number: frame number.
        time_s: Motive's time.
        people: by skeleton id, (21, 3) canonical joints: x forward, y left, z up.
        untracked: bones whose tracking-valid bit is not set.
        local: whether bones are relative to their parents.
        changed: whether to report that the models have changed.
    """
    marker_set = _text("all") + pack("<i3f", 1, 1.0, 2.0, 3.0)
    skeletons = b"".join(_skeleton(k, j, untracked, local) for k, j in people.items())
    parts = [
        pack("<i", number),
        _section(1, marker_set),
        _section(2, pack("<6f", *range(6))),
        _section(0, b""),
        _section(len(people), skeletons),
        *(_section(0, b"") for _ in range(4)),
        pack("<II", 0, 0),
        pack("<dQQQII", time_s, 1, 2, 3, 0, 0),
        pack("<hi", 2 if changed else 0, 0),
    ]
    return packet(FRAME, b"".join(parts))


def _section(count: int, content: bytes) -> bytes:
    return pack("<ii", count, len(content)) + content


def _skeleton(number: int, joints: Floats, untracked: Sequence[str], local: bool) -> bytes:
    places = bones_of(joints)
    bones = b"".join(
        pack(
            "<i3f4ffh",
            number << 16 | (k + 1),
            *(OFFSET if local and k else places[k]),
            *_QUATERNION,
            0.001,
            0 if bone in untracked else 1,
        )
        for k, bone in enumerate(BONES)
    )
    return pack("<ii", number, len(BONES)) + bones


def bones_of(joints: Floats) -> Floats:
    """Return (21, 3) of Motive's bones in its frame: y up, z forward, x left."""
    body = BodyPoints(np.asarray(joints)[:, [1, 2, 0]])
    spine = [
        body.at("waist"),
        body.between("waist", "torso", 0.7),
        body.between("torso", "neck", 0.3),
        body.at("neck"),
        body.at("head"),
    ]
    left, right = body.limbs("l"), body.limbs("r")
    return np.array([*spine, *left[:4], *right[:4], *left[4:], *right[4:]])


def _text(text: str) -> bytes:
    return text.encode() + b"\0"


class Motive:
    """A server on this machine, in unicast: answers a client, and sends frames to it.

    Args:
        skeletons: names by id.
        port: command port; 0: any free port.

    Attributes:
        port: command port.
    """

    def __init__(self, skeletons: Mapping[int, str], port: int = 0) -> None:
        self._answers = {0: server_info(), 4: model_definitions(skeletons)}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self.port = int(self._socket.getsockname()[1])
        self._client: tuple[str, int] | None = None
        threading.Thread(target=self._answer, name="motive", daemon=True).start()

    def send(self, unit: bytes) -> None:
        """Send a frame to the client, if there is one."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(unit, self._client)

    def close(self) -> None:
        """Stop."""
        self._socket.close()

    def _answer(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                asked, client = self._socket.recvfrom(1024)
                if len(asked) < 2:  # no message
                    continue
                self._client = client
                (message,) = unpack_from("<H", asked)
                if message in self._answers:
                    with contextlib.suppress(OSError):  # that client has gone
                        self._socket.sendto(self._answers[message], client)
