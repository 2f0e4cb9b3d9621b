"""``kind: rokoko``: the actors of Rokoko Studio, through its custom streaming.

Source: Rokoko, "Custom Streaming", JSON v3 (support.rokoko.com, article 4410416376977 and its
sample), and the maker's plug-in for Unity, which uses all numbers unchanged in Unity's frame::

    {"version": 3, "fps": 60,
     "scene": {"timestamp": 14.62,                seconds
               "actors": [{"name": "Ann",
                           "meta": {"hasBody": true, ...},
                           "body": {"hip": {"position": {"x": 0, "y": 0.9, "z": 0},
                                            "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}},
                                    ...}}]}}

Positions are global, in metres: x to the right, y up, z forward, left-handed. Rotations (global,
quaternions x, y, z, w) are not needed. Studio may compress a datagram as one LZ4 frame.
"""

import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from pydantic import Field

from hri_drivers.sources.mocap.frames import (
    MAX_PEOPLE,
    Frame,
    FrameError,
    json_object,
    member,
    person,
    place_of,
    shown,
    stamp_of_s,
)
from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.mocap.source import MocapSource
from hri_drivers.sources.sent import SentPerson
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

LZ4_MAGIC = b"\x04\x22\x4d\x18"
MAX_JSON = 1 << 20
"""Maximum bytes of a decompressed capture; five actors with faces and fingers need about 100 kB."""
NEEDS_LZ4 = (
    "LZ4 needs a package that is not installed; run: pip install 'hri-predict[rokoko]', or select "
    "JSON v3 without compression in Rokoko Studio"
)
_VERSION = re.compile(r"[34]([.,]\d+)?$", re.ASCII)


class RokokoReader:
    """See ``hri_drivers.sources.mocap.frames.Reader``; each datagram is a capture.

    An actor's name identifies the person; each new name gets the next id.

    Args:
        joints: names of body parts, the joints of the source.
        counters: counts ``unknown_joints``.
    """

    def __init__(self, joints: Sequence[str], counters: SourceCounters) -> None:
        self._joints = joints
        self._counters = counters
        self._ids: dict[str, int] = {}

    def reset(self) -> None:
        """Do nothing: each datagram is complete."""

    def pause(self) -> None:
        """Do nothing: each datagram is complete."""

    def read(self, data: bytes) -> Frame | None:
        """See ``Reader``."""
        found = json_object(_decompressed(data) if data.startswith(LZ4_MAGIC) else data)
        if not _VERSION.match(str(found.get("version"))):  # 3, 3.0, or "3,0"
            raise FrameError(
                f"version {shown(str(found.get('version')))}; select JSON v3 in Rokoko Studio"
            )
        if "scene" not in found:
            raise FrameError("JSON v2, by its content; select JSON v3 in Rokoko Studio")
        scene = member(found, "scene", dict)
        actors = member(scene, "actors", list)
        if len(actors) > MAX_PEOPLE:
            raise FrameError(f"more than {MAX_PEOPLE} actors")
        names = [member(actor, "name", str) for actor in actors]
        if len(set(names)) < len(names):
            raise FrameError("two actors have the same name; rename one in Rokoko Studio")
        people = [self._person(name, actor) for name, actor in zip(names, actors, strict=True)]
        return Frame(
            stamp_ns=stamp_of_s(scene.get("timestamp")),
            people=tuple(each for each in people if each is not None),
            complete=None not in people,
        )

    def _person(self, name: str, actor: Mapping[str, Any]) -> SentPerson | None:
        """The actor's body; ``None`` for an actor without a suit."""
        if not member(member(actor, "meta", dict), "hasBody", bool):
            return None
        body = member(actor, "body", dict)
        positions = np.full((len(self._joints), 3), np.nan)
        for index, joint in enumerate(self._joints):
            part = body.get(joint)
            if part is not None:
                positions[index] = place_of(member(body[joint], "position", dict))
        if not np.isfinite(positions).any():
            raise FrameError("an actor without any joint of the joint map; correct 'joint_map'")
        return person(self._id(name), positions, origin_seen=False)

    def _id(self, name: str) -> int:
        if name not in self._ids:
            if len(self._ids) >= 1000:
                raise FrameError("more than 1000 names of actors since the start")
            self._ids[name] = len(self._ids) + 1
        return self._ids[name]


def has_lz4() -> bool:
    """Whether compressed captures can be read."""
    return find_spec("lz4") is not None


def _decompressed(data: bytes) -> bytes:
    if not has_lz4():
        raise FrameError(NEEDS_LZ4)
    from lz4.frame import LZ4FrameDecompressor

    try:
        decompressor = LZ4FrameDecompressor()
        found: bytes = decompressor.decompress(data, max_length=MAX_JSON)
    except (RuntimeError, ValueError, MemoryError, EOFError):
        raise FrameError("a damaged LZ4 frame") from None
    if not decompressor.eof:
        raise FrameError(f"an LZ4 frame that is cut short, or has more than {MAX_JSON} bytes")
    return found


DEFAULT_PORT = 14043


class RokokoSettings(MocapSettings):
    """``source:`` of ``kind: rokoko``."""

    kind: Literal["rokoko"]
    joint_map: str = Field(
        "rokoko23", description="joint map of an actor's body parts, or your own map"
    )
    keeps_ids: bool = Field(True, description="an actor who returns is the same person")
    port: int = Field(
        DEFAULT_PORT, ge=0, le=65535, description="UDP port that Rokoko Studio sends to"
    )

    @property
    def notes(self) -> list[str]:
        """Notes for ``check``: network exposure, and the package that compressed streams need."""
        return [*super().notes, *([] if has_lz4() else [NEEDS_LZ4])]


class RokokoSource(MocapSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = RokokoSettings
    root = "hip"

    def _make_reader(
        self, settings: RokokoSettings, joint_map: JointMap, counters: SourceCounters
    ) -> RokokoReader:
        return RokokoReader(joint_map.source_joints, counters)
