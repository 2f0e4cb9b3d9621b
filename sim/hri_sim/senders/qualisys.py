"""A stand-in for Qualisys Track Manager: packets of the RT protocol, and a server for one client.

Written from the "QTM Real-time Server Protocol Documentation"; it shares no code with the reader.
"""

import contextlib
import socket
import threading
from collections.abc import Iterator, Mapping
from struct import Struct, pack

import numpy as np

from hri_predict.base.arrays import Floats
from hri_sim.senders.body_points import BodyPoints

_SPINE = ("Hips", "Spine", "Spine1", "Spine2", "Neck", "Head")
_ARM = ("Shoulder", "Arm", "ForeArm", "ForeArmRoll", "Hand")
_LEG = ("UpLeg", "Leg", "Foot", "ToeBase")
SEGMENTS = (*_SPINE, *(f"{side}{part}" for side in ("Left", "Right") for part in (*_ARM, *_LEG)))
FIRST_ID = 11
MOST_BYTES = 65_536
"""Maximum size of a client's packet."""
_HEADER = Struct("<II")


def packet(kind: int, content: bytes) -> bytes:
    """Return a packet with its header."""
    return pack("<II", 8 + len(content), kind) + content


def parameters(names: list[str]) -> bytes:
    """Return the answer to ``GetParameters Skeleton``: nested segments, as from version 1.21."""
    inner = "".join(f'<Segment Name="{n}" ID="{FIRST_ID + k}">' for k, n in enumerate(SEGMENTS))
    skeleton = f"<Scale>1</Scale><Segments>{inner}{'</Segment>' * len(SEGMENTS)}</Segments>"
    found = "".join(f'<Skeleton Name="{name}">{skeleton}</Skeleton>' for name in names)
    text = f"<QTM_Parameters_Ver_1.25><Skeletons>{found}</Skeletons></QTM_Parameters_Ver_1.25>"
    return packet(2, text.encode() + b"\0")


def data(number: int, time_us: int, people: Mapping[str, Floats], *, local: bool = False) -> bytes:
    """Return a data packet.

    Args:
        number: frame number.
        time_us: QTM's time.
        people: by name, (21, 3) canonical joints in metres: x forward, y left, z up.
        local: whether segments are relative to their parents.
    """
    skeletons = b""
    for joints in people.values():
        places = segments_of(joints) * 1000.0
        if local:
            places[1:] = [100.0, 50.0, 200.0]
        skeletons += pack("<I", len(SEGMENTS)) + b"".join(
            pack("<I3f4f", FIRST_ID + k, *place, 0.0, 0.0, 0.0, 1.0)
            for k, place in enumerate(places)
        )
    content = pack("<I", len(people)) + skeletons
    component = pack("<II", 8 + len(content), 18) + content
    other = pack("<IIIHH", 16, 1, 0, 0, 0)  # no 3D markers
    return packet(3, pack("<qII", time_us, number, 2) + other + component)


def segments_of(joints: Floats) -> Floats:
    """Return (24, 3) of QTM's segments, in the axes of the joints."""
    body = BodyPoints(np.asarray(joints))
    found = [body.at("waist"), body.between("waist", "torso", 0.5), body.at("torso")]
    found += [body.between("torso", "neck", 0.4), body.at("neck"), body.at("head")]
    for side in "lr":
        collar, shoulder, elbow, wrist, *leg = body.limbs(side)
        roll = body.between(f"{side}_elbow", f"{side}_wrist", 0.5)
        found += [collar, shoulder, elbow, roll, wrist, *leg]
    return np.array(found)


class Qtm:
    """A server on this machine that answers one client, and sends data to it on request.

    Attributes:
        port: for little-endian clients.
    """

    def __init__(self, names: list[str], port: int = 0) -> None:
        self._answers = {
            "Version": packet(1, b"Version set to 1.25\0"),
            "GetParameters": parameters(names),
        }
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = int(self._listener.getsockname()[1])
        self._streams: socket.socket | None = None
        self._sending = threading.Lock()
        threading.Thread(target=self._serve, name="qtm", daemon=True).start()

    def send(self, unit: bytes) -> None:
        """Send a data packet to the client that requested data."""
        if (client := self._streams) is not None:  # the other thread may end it at any time
            self._put(client, unit)

    def close(self) -> None:
        """Stop."""
        self._listener.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                with client, contextlib.suppress(OSError):
                    self._put(client, packet(1, b"QTM RT Interface connected\0"))
                    for verb in _verbs(client):
                        if verb in self._answers:
                            self._put(client, self._answers[verb])
                        elif verb == "StreamFrames":
                            self._streams = client
                self._streams = None

    def _put(self, client: socket.socket, unit: bytes) -> None:
        """Send a whole packet; answers and data come from two threads."""
        with self._sending, contextlib.suppress(OSError):
            client.sendall(unit)


def _verbs(client: socket.socket) -> Iterator[str]:
    """The first word of each command, until the client closes or sends something else."""
    come = b""
    while data := client.recv(4096):
        come += data
        while len(come) >= _HEADER.size:
            size, _ = _HEADER.unpack_from(come)
            if not _HEADER.size <= size <= MOST_BYTES:
                return
            if len(come) < size:
                break
            text, come = come[_HEADER.size : size], come[size:]
            yield text.split(b"\0")[0].decode(errors="replace").split(" ")[0]
