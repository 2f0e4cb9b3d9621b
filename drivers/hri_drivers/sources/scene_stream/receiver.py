"""The receiver of the node's own scene stream: sessions, replays, parts, counters.

These rules refuse replays (``drivers/SCENE_STREAM.md`` describes their limits):

- Within a session the sequence must advance.
- A session is identified by its start time. A new session must start later than all sessions
  before. With a key, its first stamp must also be within ``max_skew_s`` of this machine's UTC
  clock: so even a newly started node refuses a recording of an older session.
- Two simultaneous senders contradict each other. For one second after a fresh datagram of an older
  session, the scenes of the newer one count as *room not seen*. So they do if two senders share one
  session, as copies of one sender in two processes do: a sequence then has two contents, or comes
  for the first time long after a later one.
- Without a key, strangers are not excluded, and the rules catch only mistakes: an earlier session
  (the sender's clock was set back) is accepted once the later one is silent.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from hri_drivers.sources.scene_stream.codec import (
    HEADER,
    Header,
    Refused,
    decode_body,
    names_crc,
    open_datagram,
    same_scene,
)
from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.sent import SentScene
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

SILENT_NS = 1_000_000_000
CONTRADICTED_NS = 1_000_000_000
"""Time for which neither sender is believed after a second one was heard."""
WINDOW = 512
"""Number of newest sequences remembered, at least (the window of RFC 4303 clause 3.4.3)."""
LATE_NS = 300_000_000
"""A network delivers no datagram over this time after a later one of the same sender."""
_CANONICAL_CRC = names_crc(JOINTS)


@dataclass(slots=True)
class _Received:
    """One sequence so far: header and arrival of the scene, and part -> hash of its datagram."""

    packed: bytes
    received_ns: int
    parts: dict[int, int] = field(default_factory=dict)


class SceneStream:
    """``hri_drivers.sources.live.Decoder`` of datagrams; see the module.

    Args:
        joint_map: the joints that the sender must have, in this order.
        counters: counts packets and refusals.
        key: checks the stream's authenticity; ``None``: only damage is checked.
        max_skew_s: largest error of the sender's UTC clock when its session starts.
        utc_ns: this machine's UTC clock, nanoseconds since 1970.

    Attributes:
        joint_map, counters: as given.
    """

    def __init__(
        self,
        *,
        joint_map: JointMap,
        counters: SourceCounters,
        key: Key | None = None,
        max_skew_s: float = 2.0,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.joint_map = joint_map
        self._names_crc = names_crc(joint_map.source_joints)
        self.counters = counters
        self._key = key
        self._max_skew_ns = round(max_skew_s * 1e9)
        self._utc_ns = utc_ns
        self._session = -1
        self._sequence = self._first = -1
        self._came: dict[int, _Received] = {}  # by sequence
        self._heard_ns = 0
        self._second_ns: int | None = None  # when a second sender was heard last
        self._parts: list[bytes | None] = []  # of the newest scene; empty when it is complete

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """Return the scene that this datagram completes, if any; never raises."""
        self.counters.packets += 1
        try:
            header, payload = open_datagram(data, self._key)
            self._check_joints(header)
            if not self._is_new(header, data, received_ns):
                return []
            self._heard_ns = received_ns
            body = self._join(header, payload)
            if body is None:
                return []
            scene = decode_body(header, body)
            if self._second_ns is not None and received_ns - self._second_ns < CONTRADICTED_NS:
                scene = replace(scene, sees_room=False, people=())
            return [scene]
        except Refused as refused:
            name = refused.counter
            setattr(self.counters, name, getattr(self.counters, name) + 1)
            self.counters.note(refused)
            return []

    def reset(self) -> None:
        """Discard incomplete scenes; keep the sessions, or a recording could be replayed."""
        self._give_up()

    def _check_joints(self, header: Header) -> None:
        if (header.names_crc, header.joints) != (
            self._names_crc,
            len(self.joint_map.source_joints),
        ):
            remedy = "give both the same names in the same order"
            if (header.names_crc, header.joints) == (_CANONICAL_CRC, len(JOINTS)):
                remedy = f"they are those of 'joint_map: canonical': set that, or {remedy}"
            raise Refused(
                "malformed",
                f"the sender's {header.joints} joints differ from those of joint map "
                f"'{self.joint_map.name}'; {remedy}",
            )

    def _is_new(self, header: Header, data: bytes, received_ns: int) -> bool:
        """Whether this datagram is new; the first of a scene starts it."""
        if header.session != self._session:
            if not self._may_start(header, received_ns):
                return False
            self._give_up()
            self._session, self._came = header.session, {}
            self._sequence = self._first = header.sequence
        elif header.sequence <= self._sequence:
            if self._contradicts(header, data, received_ns):
                self._second_ns = received_ns
                self._replayed(
                    "a second sender with the same session, or one that began again with it; give "
                    "each sender its own port, and each start a new session"
                )
                return False
            return self._continues(header, data, received_ns)
        else:
            self._give_up()
            self.counters.lost += header.sequence - self._sequence - 1
            self._sequence = header.sequence
        self._parts = [None] * header.parts
        self._remember(header, data, received_ns)
        return True

    def _contradicts(self, header: Header, data: bytes, received_ns: int) -> bool:
        """Whether a sequence that is not new cannot be of the sender of what was received."""
        came = self._came.get(header.sequence)
        if came is None:
            following = min(sequence for sequence in self._came if sequence > header.sequence)
            return received_ns - self._came[following].received_ns > LATE_NS
        if not same_scene(came.packed, data[: HEADER.size]):
            return True
        return came.parts.get(header.part, hash(data)) != hash(data)

    def _continues(self, header: Header, data: bytes, received_ns: int) -> bool:
        """Whether it is a missing part of the newest scene; otherwise count why it is dropped."""
        if header.sequence < self._sequence and header.sequence not in self._came:
            self.counters.out_of_order += 1
            self.counters.lost -= header.sequence > self._first
            self._remember(header, data, received_ns)
            return False
        newest = header.sequence == self._sequence
        if not newest or not self._parts or self._parts[header.part] is not None:
            self._replayed("received before")
            return False
        self._remember(header, data, received_ns)
        return True

    def _remember(self, header: Header, data: bytes, received_ns: int) -> None:
        scene = _Received(data[: HEADER.size], received_ns)
        self._came.setdefault(header.sequence, scene).parts[header.part] = hash(data)
        if len(self._came) > 2 * WINDOW:
            last = self._sequence - WINDOW
            self._came = {each: came for each, came in self._came.items() if each > last}

    def _may_start(self, header: Header, received_ns: int) -> bool:
        if self._key is None:
            silent = received_ns - self._heard_ns > SILENT_NS
            if header.session < self._session and not silent:
                self._second_ns = received_ns
                self._replayed("a second sender with an earlier session; stop one of the two")
                return False
            return True
        skew_ns = header.stamp_ns - self._utc_ns()
        if header.session < self._session:
            if abs(skew_ns) <= self._max_skew_ns:  # no recording: it is being sent now
                self._second_ns = received_ns
            self._replayed("an older session, or a second sender; restart the sender")
            return False
        if abs(skew_ns) > self._max_skew_ns:
            self._replayed(
                f"stamped {skew_ns * 1e-9:+.1f} s off this machine's UTC clock: a recording, or a "
                "wrong clock; synchronize both clocks with NTP, or raise max_skew_s"
            )
            return False
        if header.session > self._utc_ns() + self._max_skew_ns:
            self._replayed("the session starts in the future; set the sender's UTC clock")
            return False
        return True

    def _join(self, header: Header, payload: bytes) -> bytes | None:
        """Return the body once all its parts have arrived."""
        self._parts[header.part] = payload
        parts = [part for part in self._parts if part is not None]
        if len(parts) < header.parts:
            return None
        self._parts = []
        return b"".join(parts)

    def _give_up(self) -> None:
        """Drop the parts of a scene that will stay incomplete."""
        self.counters.incomplete += bool(self._parts)
        self._parts = []

    def _replayed(self, why: str) -> None:
        self.counters.replayed += 1
        self.counters.note(why)
