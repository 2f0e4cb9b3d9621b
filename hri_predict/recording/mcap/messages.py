"""Reads a recording, message by message, with UTC: for explaining a run later.

    about = recording_info("cell-20260309T140000Z.mcap")
    for message in read_messages(path, ["/status", "/advice"], start_utc_ns=..., end_utc_ns=...):
        print(message.utc, message.data["level"])
    then = moment(path, utc_ns)          # everything as it was known then

Of a truncated file (after a kill or a power failure), everything before the cut is returned.
"""

import json
import shlex
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from mcap.records import Channel, Footer, Message, Metadata

from hri_predict.base.errors import RecordingError
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.recording.mcap.clocks import iso
from hri_predict.recording.mcap.info import METADATA, RecordingInfo
from hri_predict.recording.mcap.reader import CUT, records
from hri_predict.recording.mcap.schemas import with_unknown

SLOWEST_S = 2.0
"""Time span that ``moment`` searches; every topic has a message at least each second."""


@dataclass(frozen=True, slots=True)
class Told:
    """A message of a recording.

    Attributes:
        topic: see ``schemas``; in recordings of format 1 every robot's advice is on /advice.
        utc_ns: when, UTC; in recordings without UTC (``RecordingInfo.has_utc``), the node's clock.
        node_ns: the same on the node's clock.
        data: the message; ``None`` is what was not known.
    """

    topic: str
    utc_ns: int
    node_ns: int
    data: dict[str, Any]

    @property
    def utc(self) -> str:
        """``2026-03-09T14:03:07.123456Z``."""
        return iso(self.utc_ns)


@dataclass(slots=True)
class Moment:
    """State known to the node at one instant: the newest earlier message of each topic and source.

    Attributes:
        status, scene, forecast, zones, node: as the topics say; ``None``: there was none.
        advice: by robot.
        received: the newest message of each link.
    """

    status: Told | None = None
    scene: Told | None = None
    forecast: Told | None = None
    zones: Told | None = None
    node: Told | None = None
    advice: dict[str, Told] = field(default_factory=dict)
    received: dict[str, Told] = field(default_factory=dict)


def recording_info(path: str | Path) -> RecordingInfo:
    """Return a recording's description of itself: configuration, robots with their capsules, has it
    UTC.

    Raises:
        RecordingError: it is not a recording of this node, or not a file.
        OSError: it cannot be read.
    """
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):  # to open a pipe may take forever
        raise RecordingError(f"recording {path}: is a device or a pipe, not a file; name another")
    with path.open("rb") as file:
        try:
            for record in records(file):
                if isinstance(record, Metadata) and record.name == METADATA:
                    return RecordingInfo.from_metadata(record.metadata)
        except RecordingError as error:
            raise RecordingError(f"recording {path}: {error}") from error
        except CUT:
            pass
    raise RecordingError(f"recording {path}: {_not_ours(path)}")


def _not_ours(path: Path) -> str:
    """Return why a file that this node did not record is refused, with a remedy that works."""
    if path.suffix.lower() in YAML_ENDINGS:
        return "is a configuration; give the .mcap that 'hri-predict run --record' wrote"
    return (
        "was not recorded by hri-predict; name another file, or record a replay of this one: "
        f"hri-predict replay {shlex.quote(str(path))} --record "
        f"{shlex.quote(f'{path.stem}_run.mcap')} --speed max"
    )


def read_messages(
    path: str | Path,
    topics: Collection[str] | None = None,
    *,
    start_utc_ns: int | None = None,
    end_utc_ns: int | None = None,
    on_cut: Callable[[], None] | None = None,
) -> Iterator[Told]:
    """Yield the messages in file order, from ``start_utc_ns`` to before ``end_utc_ns``.

    Args:
        path: the file.
        topics: only these; ``/advice`` means that of all robots. ``None``: all.
        start_utc_ns, end_utc_ns: see ``Told.utc_ns``.
        on_cut: called where the file ends before its end: it was cut, or is damaged from there on,
            or is still being written.

    Raises:
        RecordingError: a message is damaged.
        OSError: it cannot be read.
    """
    names: dict[int, str] = {}
    with Path(path).open("rb") as file:
        wanted = None if topics is None else partial(_is_wanted, topics=topics)
        found = records(file, start_utc_ns, end_utc_ns, wanted)
        while True:
            try:
                record = next(found, None)
            except CUT:
                record = None
            if record is None or isinstance(record, Footer):
                if record is None and on_cut is not None:
                    on_cut()
                return
            if isinstance(record, Channel):
                names[record.id] = record.topic
            elif isinstance(record, Message):
                topic = names.get(record.channel_id, "")
                early = start_utc_ns is not None and record.log_time < start_utc_ns
                late = end_utc_ns is not None and record.log_time >= end_utc_ns
                if not (early or late) and _is_wanted(topic, topics):
                    data = _decoded(path, topic, record.data)
                    yield Told(topic, record.log_time, record.publish_time, data)


def moment(path: str | Path, utc_ns: int) -> Moment:
    """Return the node's knowledge at ``utc_ns``; empty where nothing was recorded in the seconds
    before.

    Raises:
        RecordingError, OSError: as ``read_messages``.
    """
    then = Moment()
    start_ns = utc_ns - round(SLOWEST_S * 1e9)
    for told in read_messages(path, start_utc_ns=start_ns, end_utc_ns=utc_ns + 1):
        name = told.topic.removeprefix("/")
        if name in ("status", "scene", "forecast", "zones", "node"):
            setattr(then, name, told)
        elif name.split("/")[0] == "advice":
            then.advice[str(told.data.get("name", told.data.get("robot")))] = told
        elif name == "received":
            then.received[str(told.data.get("link"))] = told
    return then


def _is_wanted(topic: str, topics: Collection[str] | None) -> bool:
    if topics is None or topic in topics:
        return True
    return topic.startswith("/advice/") and "/advice" in topics


def _decoded(path: str | Path, topic: str, data: bytes) -> dict[str, Any]:
    try:
        decoded = json.loads(data)
        if not isinstance(decoded, dict):
            raise ValueError("no object")
    except (ValueError, RecursionError) as error:
        raise RecordingError(
            f"recording {path}: a message on {topic} is damaged ({error}); it cannot be used"
        ) from error
    return with_unknown(topic, decoded)
