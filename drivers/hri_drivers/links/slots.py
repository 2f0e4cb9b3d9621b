"""Messages waiting to be sent: one slot per subject, newest wins; and the bulk budget."""

import threading
from dataclasses import dataclass

from hri_predict.protocol.codec import robot_of
from hri_predict.protocol.definition import BY_TYPE, DEFINITIONS
from hri_predict.protocol.messages import Acknowledge, Message, Pose, Zone

BULK = tuple(d.type for d in DEFINITIONS if d.item)
_BULK_CLASS = max(d.priority for d in DEFINITIONS)
MAX_EDGES = 64  # distinct acknowledgements that may wait; nobody presses that fast

Key = tuple[int, ...]


def slot_key(message: Message) -> Key:
    """The subject of a message: a newer message about the same subject replaces the older.

    The first element is the priority. An Acknowledge is an edge: its key contains its own id, so no
    other Acknowledge replaces it.
    """
    match message:
        case Zone(person=person, step=step) | Pose(person=person, step=step):
            subject = (person, step)
        case Acknowledge(latch_id=latch_id, ack_id=ack_id):
            subject = (latch_id, ack_id)
        case _:
            subject = (robot_of(message), 0)
    definition = BY_TYPE[type(message)]
    return (definition.priority, definition.number, *subject)


class Slots:
    """Newest-wins slots, thread-safe for several posting threads and one draining thread.

    Within one priority the subject that has waited longest goes first, so that every person and
    horizon step gets its turn even if few fit. The number of subjects limits the number of slots.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._classes: tuple[dict[Key, Message], ...] = tuple({} for _ in range(_BULK_CLASS + 1))

    def post(self, message: Message) -> Message | None:
        """Put ``message`` into its slot; return the message that it displaced, if any."""
        key = slot_key(message)
        slots = self._classes[key[0]]
        with self._lock:
            displaced = slots.get(key)
            slots[key] = message  # the new message takes the old one's place in the queue
            if isinstance(message, Acknowledge):
                displaced = None  # the same edge again: nothing is lost
                if len(slots) > MAX_EDGES:
                    displaced = slots.pop(next(iter(slots)))
            return displaced

    def put_back(self, message: Message) -> bool:
        """Put back a message that could not be written; ``False`` if a newer one is posted."""
        key = slot_key(message)
        slots = self._classes[key[0]]
        with self._lock:
            if key in slots:
                return False
            waiting = list(slots.items())
            slots.clear()
            slots[key] = message
            slots.update(waiting)
            return True

    def pop(self, with_bulk: bool = True) -> Message | None:
        """Take the most urgent message; Zone and Pose only if ``with_bulk``."""
        with self._lock:
            for priority, slots in enumerate(self._classes):
                if slots and (with_bulk or priority < _BULK_CLASS):
                    return slots.pop(next(iter(slots)))
            return None

    def pop_bulk(self) -> Message | None:
        """Take the Zone or Pose that has waited longest."""
        with self._lock:
            slots = self._classes[_BULK_CLASS]
            return slots.pop(next(iter(slots))) if slots else None

    def has_bulk(self) -> bool:
        """Whether a Zone or Pose waits."""
        return bool(self._classes[_BULK_CLASS])

    def __len__(self) -> int:
        with self._lock:
            return sum(len(slots) for slots in self._classes)


@dataclass(slots=True)
class Budget:
    """Token bucket of wire time for Zone and Pose.

    Attributes:
        rate: average wire time that may be used, seconds per second.
        depth_s: wire time that one burst may use, seconds; longer messages are never sent on this
            wire.
    """

    rate: float
    depth_s: float = 0.1
    _tokens_s: float = 0.0
    _last_ns: int | None = None

    def fits(self, wire_s: float, now_ns: int) -> bool:
        """Whether ``wire_s`` seconds of wire time may be used now."""
        if self._last_ns is not None:
            elapsed_s = max(0, now_ns - self._last_ns) * 1e-9
            self._tokens_s = min(self.depth_s, self._tokens_s + self.rate * elapsed_s)
        else:
            self._tokens_s = max(self.depth_s, 0.0)
        self._last_ns = now_ns
        return self.rate > 0 and wire_s <= self._tokens_s

    def spend(self, wire_s: float) -> None:
        """Subtract the wire time that was used."""
        self._tokens_s -= wire_s
