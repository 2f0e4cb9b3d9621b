"""The node's output in a recording, as the ROS 2 link would have published it.

The link's own functions make the messages (``hri_predict.protocol.ros.plain``). A recording keeps
every advice, but zones and forecasts at ``zones_hz`` and ``poses_hz``, rounded to 1 mm.
"""

import math
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import yaml

from hri_predict.base.files import load_yaml
from hri_predict.protocol.messages import Advice, Message, Pose, Status, Zone, ZoneCapsule
from hri_predict.protocol.ros.plain import PlainMessages, Sample
from hri_predict.recording.mcap.format import sent_from_dict, whole
from hri_predict.recording.mcap.messages import Told, read_messages, recording_info
from hri_predict.recording.recording import Recording

TOPICS = ("/status", "/advice", "/forecast", "/zones")
FAILS = (KeyError, ValueError, TypeError, IndexError, OverflowError, AttributeError, struct.error)
"""Raised by a message that this version does not know, or that is damaged."""


class Outputs:
    """Reads them.

    Args:
        recording: with ``outputs_ns``.
        frame_id: the room's frame in ROS.
        at_ns: a message's time in the bag.
        dropped: counts messages that cannot be converted.

    Attributes:
        frame_id: as above.
        full_speed_m_s: see ``full_speed``; ``None`` leaves the output out.
    """

    def __init__(
        self,
        recording: Recording,
        frame_id: str,
        at_ns: Callable[[Told], int],
        dropped: Counter[str],
    ) -> None:
        self.full_speed_m_s = full_speed(recording.config)
        self._recording, self.frame_id = recording, frame_id
        self._at_ns, self._dropped = at_ns, dropped

    def samples(self) -> Iterator[tuple[int, Sample]]:
        """Yield time (ns) and sample of each, as recorded.

        Raises:
            RecordingError, OSError: as ``read_messages``.
        """
        if self._recording.outputs_ns is None or self.full_speed_m_s is None:
            return
        first_ns, last_ns = self._recording.outputs_ns
        rate_hz = recording_info(self._recording.path).forecast_rate_hz
        now_ns = 0
        plain = PlainMessages(self.full_speed_m_s, self.frame_id, wall_ns=lambda: now_ns)
        for told in read_messages(self._recording.path, TOPICS):
            if not first_ns <= told.node_ns <= last_ns:
                continue
            now_ns = self._at_ns(told)
            try:
                samples = [s for m in messages_of(told, rate_hz) for s in plain.of(m)]
            except FAILS:
                self._dropped[f"messages on {told.topic} that this version cannot read"] += 1
                continue
            yield from ((now_ns, sample) for sample in samples)


def full_speed(config: str) -> float | None:
    """Return the full speed, 1.0 in speed fractions, m/s; ``None`` if a configuration has none.

    It is that of its first ``ros2`` link; or else the highest ``max_speed_m_s`` of its robots, by
    which fractions are lowest.
    """
    try:
        data = load_yaml(config)
    except (yaml.YAMLError, ValueError, RecursionError):
        return None
    links = [link for link in _mappings(data, "links") if link.get("kind") == "ros2"]
    stated = [link.get("full_speed_m_s") for link in links][:1]
    found = [robot.get("max_speed_m_s") for robot in _mappings(data, "robots")]
    speeds = [s for s in stated or found if isinstance(s, int | float) and 0 < s < math.inf]
    return max(map(float, speeds), default=None)


def messages_of(told: Told, rate_hz: float) -> list[Message]:
    """Return the node's messages of one recorded message.

    Raises:
        one of ``FAILS``: it is damaged, or this version does not know it.
    """
    data = told.data
    if told.topic == "/status":
        return [sent_from_dict(Status, data)]
    if told.topic == "/forecast":
        return list(_poses(data, rate_hz))
    if told.topic == "/zones":
        return list(_zones(data, rate_hz))
    return [sent_from_dict(Advice, data)]


def _poses(data: Mapping[str, Any], rate_hz: float) -> Iterator[Pose]:
    for p, person in enumerate(data["ids"]):
        age_s = (whole(data["now_ns"]) - whole(data["capture_ns"][p])) * 1e-9
        for k, step in enumerate(data["steps"]):
            joints = tuple((j, *_place(xyz)) for j, xyz in enumerate(data["positions"][p][k]))
            yield Pose(
                person=whole(person, 0, 65_535),
                step=step + 1,
                horizon_s=(step + 1) / rate_hz if rate_hz > 0 else math.nan,
                joints=joints,
                age_s=age_s,
            )


def _zones(data: Mapping[str, Any], rate_hz: float) -> Iterator[Zone]:
    for k, ahead_s in enumerate(data["times_s"]):
        for p, person in enumerate(data["ids"]):
            capsules = tuple(
                ZoneCapsule(s, _place(row[:3]), _place(row[3:6]), _number(row[6]))
                for s, row in enumerate(data["capsules"][p][k])
            )
            step = round(ahead_s * rate_hz) if rate_hz > 0 else k
            yield Zone(
                person=whole(person, 0, 65_535), step=step, horizon_s=ahead_s, capsules=capsules
            )


def _place(xyz: Any) -> tuple[float, float, float]:
    x, y, z = map(_number, xyz)
    return x, y, z


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _mappings(data: Any, key: str) -> list[dict[str, Any]]:
    found = data.get(key) if isinstance(data, dict) else None
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []
