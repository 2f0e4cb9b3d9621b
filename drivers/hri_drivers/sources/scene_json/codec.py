"""A scene as a JSON object, for programs without a better way to send their observations.

One object is one scene, with everything needed to read it::

    {"format": "hri-scene/1",
     "sequence": 1201,                rises by one with each capture, even if not sent
     "stamp_s": 48.033,               capture time, seconds of the sender's own clock
     "sees_room": true,               false: the sensor does not know who is there
     "units": "m",                    or "mm"
     "axes": ["x", "y", "z"],         the axes that point forward, left and up
     "left_handed": false,            true if the sender's axes are left-handed; optional
     "people": [
        {"id": 1,                     0 to 65535, the same for the same body from scene to scene
         "joints": {"l_wrist": [0.41, 0.2, 1.1],         x, y, z
                    "r_wrist": [0.43, -0.2, 1.1, 0.9],   optionally a confidence, 0 to 1
                    "head": null},                       not observed; or leave it out
         "error_m": 0.4}]}            all joints may be off by this together, metres; optional

``people`` is ``[]`` when the sender sees that the room is empty. Joints have the names of a joint
map, whatever their case and separators; others are ignored and counted. On a stream, one object is
one line (UTF-8, ended by a line feed).
"""

import json
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NoReturn, Self

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import HriPredictError, nearest
from hri_predict.base.settings import Settings, validated
from hri_predict.contracts.joint_map import METRES_PER_UNIT, axes_rotation
from hri_predict.contracts.scene import MAX_ERROR_M
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.serial import Delimited

MOST_NAMED = 8
"""Maximum number of unknown joints that a message names."""
MAX_BYTES = 65_536
"""Maximum size of a scene in bytes; ten people with a hundred joints each need half of it."""
MAX_PEOPLE = 64
MAX_STAMP_S = 1e10  # the year 2286; nanoseconds of it fit in 64 bits
_MESSAGE_LENGTH = 200


def _confident(place: list[float]) -> list[float]:
    if len(place) == 4 and not 0.0 <= place[3] <= 1.0:
        raise ValueError("a joint's fourth number is its confidence, 0 to 1")
    return place


Coordinates = Annotated[list[float], Field(min_length=3, max_length=4), AfterValidator(_confident)]


class SceneJsonError(HriPredictError):
    """The data are not a valid scene; the message names the key and the remedy."""


class _Strict(Settings):
    model_config = ConfigDict(strict=True)


class PersonMessage(_Strict):
    """An entry of ``people``."""

    id: int = Field(ge=0, le=65535)
    joints: dict[str, Coordinates | None] = Field(max_length=1000)
    error_m: float = Field(0.0, ge=0, le=MAX_ERROR_M)


class SceneMessage(_Strict):
    """The object; see the module."""

    format: Literal["hri-scene/1"]
    sequence: int = Field(ge=0, lt=1 << 63)
    stamp_s: float = Field(ge=-MAX_STAMP_S, le=MAX_STAMP_S)
    sees_room: bool
    units: Literal["m", "mm"]
    axes: Annotated[list[str], Field(min_length=3, max_length=3)]
    left_handed: bool = False
    people: list[PersonMessage] = Field(max_length=MAX_PEOPLE)

    @model_validator(mode="after")
    def _handed(self) -> Self:
        axes_rotation(self.axes, self.left_handed)
        return self

    def to_metres(self) -> Floats:
        """(3, 3) from the sender's coordinates to metres forward, left and up."""
        return axes_rotation(self.axes, self.left_handed) * METRES_PER_UNIT[self.units]


@dataclass
class SceneReader:
    """Turns JSON objects into scenes.

    Args:
        joints: names of the source's joints, in order.
        min_confidence: minimum confidence of an observed joint.
        counters: counts ``unknown_joints`` and ``unsure_joints``.

    Attributes:
        stated: (3, 3) from the newest scene's units and axes to metres, forward, left and up.
    """

    joints: Sequence[str]
    min_confidence: float
    counters: SourceCounters
    unknown: list[str] = field(default_factory=list)
    stated: Floats | None = field(default=None, init=False)

    def read(self, data: bytes | str) -> SentScene:
        """Return the scene in one object, in metres: x forward, y left, z up.

        Raises:
            SceneJsonError: the data are not a valid scene. No input raises any other exception.
        """
        message = _parsed(data)
        ids = [person.id for person in message.people]
        if len(set(ids)) < len(ids):
            raise SceneJsonError("scene: people: two have the same id; give each body its own")
        self.stated = message.to_metres()
        return SentScene(
            stamp_ns=round(message.stamp_s * 1e9),
            sequence=message.sequence,
            sees_room=message.sees_room,
            people=tuple(self._person(person, message) for person in message.people),
        )

    def _person(self, person: PersonMessage, message: SceneMessage) -> SentPerson:
        positions = np.full((len(self.joints), 3), np.nan)
        places = self._places(person.joints)
        for name, place in person.joints.items():
            index = places.get(name)
            if index is None:
                self._count_unknown(name)
            elif place is not None and self._is_sure(place):
                positions[index] = place[:3]
        with np.errstate(all="ignore"):
            metres = positions @ message.to_metres().T
        observed = np.asarray(np.isfinite(metres).all(axis=1))
        return SentPerson(person.id, metres, observed, person.error_m)

    def _places(self, names: Collection[str]) -> dict[str, int]:
        """Map each name to a joint; another spelling is accepted only if it is unambiguous."""
        places = {name: k for k, name in enumerate(self.joints)}
        if all(name in places for name in names):
            return places
        spelled, sent = Counter(map(_spelled, self.joints)), Counter(map(_spelled, names))
        alone = {_spelled(joint): k for joint, k in places.items() if spelled[_spelled(joint)] == 1}
        others = {name: _spelled(name) for name in names if name not in places}
        found = {name: alone[s] for name, s in others.items() if s in alone and sent[s] == 1}
        return places | found

    def _count_unknown(self, name: str) -> None:
        """Report the names that the joint map lacks: nothing else shows a joint lost to a typo."""
        self.counters.unknown_joints += 1
        shown = ascii(name[:40])[1:-1]
        if shown not in self.unknown and len(self.unknown) < MOST_NAMED:
            self.unknown.append(shown)
            self.counters.last_error = (
                f"joints that the joint map does not have: {', '.join(self.unknown)}"
                f"{nearest(self.unknown[0], self.joints)}"
            )

    def _is_sure(self, place: list[float]) -> bool:
        sure = len(place) == 3 or place[3] >= self.min_confidence
        self.counters.unsure_joints += not sure
        return sure


def _spelled(name: str) -> str:
    """A name in lower case without separators."""
    return re.sub(r"[\W_]", "", name.lower())


def _parsed(data: bytes | str) -> SceneMessage:
    if len(data) > MAX_BYTES:
        raise SceneJsonError(f"scene: longer than {MAX_BYTES} bytes; send fewer joints")
    try:
        text = data.decode("utf-8") if isinstance(data, bytes) else data
        found = json.loads(text, object_pairs_hook=_unique_keys, parse_constant=_no_constant)
        return validated(SceneMessage, found, "scene")
    except HriPredictError as error:
        raise SceneJsonError(plain(error)) from None
    except RecursionError:
        raise SceneJsonError("scene: nested too deeply; see the schema") from None
    except (ValueError, OverflowError) as error:  # JSON's and Unicode's errors are ValueErrors
        raise SceneJsonError(f"scene: not JSON in UTF-8: {plain(error)}; fix the sender") from None


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("an object has the same key twice")
    return found


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number; send null for a joint that is not observed")


def plain(error: Exception) -> str:
    """An error's text made safe for a log: one short line of ASCII."""
    line = " ".join(str(error).split())[:_MESSAGE_LENGTH]
    return line.encode("ascii", "backslashreplace").decode("ascii")


class LineSplitter:
    """Finds lines in a stream of bytes; buffers at most one of ``MAX_BYTES``.

    Only the start of a longer line is returned, which the reader refuses as too long.
    """

    def __init__(self) -> None:
        self._stream = Delimited(b"\n", MAX_BYTES)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they arrive; yield the lines that they complete, without empty ones."""
        for line in self._stream.feed(data):
            if line := line if len(line) > MAX_BYTES else line.strip():
                yield line
