"""The receiver of the node's own scene stream: sessions, replays, parts, counters.

These rules refuse replays (``drivers/SCENE_STREAM.md`` says what they protect from and what not):

- Within a session the sequence must advance.
- The start time of a session is its name. A new session must start later than all sessions before.
  With a key, its first stamp must also be within ``max_skew_s`` of this machine's UTC clock: so
  even a node that has just started refuses a recording of an older session.
- Two senders at once contradict each other. For one second after a fresh datagram of an older
  session, the scenes of the newer one count as *room not seen*.
- Without a key nothing keeps strangers out, and the rules only catch mistakes: an earlier session
  (the sender's clock was set back) is accepted once the later one is silent.
"""

import time
from collections.abc import Callable
from dataclasses import replace

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
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

SILENT_NS = 1_000_000_000
CONTRADICTED_NS = 1_000_000_000
"""For this long after a second sender was heard, neither is believed."""
WINDOW = 64
"""Number of newest sequences remembered (the window of RFC 4303 clause 3.4.3)."""


class SceneStream:
    """``hri_drivers.sources.live.Decoder`` of datagrams; see the module.

    Args:
        joint_map: the joints that the sender must have, in this order.
        counters: counts packets and what is refused.
        key: the stream must be authentic; ``None``: only undamaged.
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
        self._came = 0  # bit i: whether sequence - i has arrived
        self._heard_ns = 0
        self._second_ns: int | None = None  # when a second sender was heard last
        self._packed = b""  # header of the incomplete scene
        self._parts: list[bytes | None] = []  # its parts; empty when it is complete

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
        """Forget incomplete scenes; sessions stay, or a recording could be replayed."""
        self._give_up()

    def _check_joints(self, header: Header) -> None:
        if (header.names_crc, header.joints) != (
            self._names_crc,
            len(self.joint_map.source_joints),
        ):
            raise Refused(
                "malformed",
                f"the sender's {header.joints} joints differ from those of joint map "
                f"'{self.joint_map.name}'; give both the same names in the same order",
            )

    def _is_new(self, header: Header, data: bytes, received_ns: int) -> bool:
        """Whether this datagram is new; the first of a scene starts it."""
        if header.session != self._session:
            if not self._may_start(header, received_ns):
                return False
            self._give_up()
            self._session, self._came = header.session, 1
            self._sequence = self._first = header.sequence
        elif header.sequence < self._sequence:
            self._note_late(header.sequence)
            return False
        elif header.sequence == self._sequence:
            if not self._parts or self._parts[header.part] is not None:
                self._replayed("received before")
                return False
            if not same_scene(self._packed, data[: HEADER.size]):
                raise Refused("malformed", "two scenes have the same sequence")
            return True
        else:
            self._give_up()
            self._advance(header.sequence - self._sequence)
            self._sequence = header.sequence
        self._packed = data[: HEADER.size]
        self._parts = [None] * header.parts
        return True

    def _advance(self, by: int) -> None:
        self.counters.lost += by - 1
        self._came = 1 | (self._came << by if by < WINDOW else 0) & (1 << WINDOW) - 1

    def _note_late(self, sequence: int) -> None:
        """Count a scene older than the newest: a replay if it came before, else out of order."""
        back = self._sequence - sequence
        bit = 1 << back if back < WINDOW else 0
        if not bit or self._came & bit:
            self._replayed("received before")
            return
        self._came |= bit
        self.counters.out_of_order += 1
        self.counters.lost -= sequence > self._first

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
                f"stamped {skew_ns * 1e-9:+.1f} s off this machine's UTC clock: a recording, or "
                "a wrong clock; set both clocks by NTP, or raise max_skew_s"
            )
            return False
        if header.session > self._utc_ns() + self._max_skew_ns:
            self._replayed("the session begins in the future; set the sender's UTC clock")
            return False
        return True

    def _join(self, header: Header, payload: bytes) -> bytes | None:
        """Return the body once all its parts are there."""
        self._parts[header.part] = payload
        parts = [part for part in self._parts if part is not None]
        if len(parts) < header.parts:
            return None
        self._parts = []
        return b"".join(parts)

    def _give_up(self) -> None:
        """Drop the parts of a scene that will not be complete."""
        self.counters.incomplete += bool(self._parts)
        self._parts = []

    def _replayed(self, why: str) -> None:
        self.counters.replayed += 1
        self.counters.note(why)
