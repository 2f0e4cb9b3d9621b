"""Common part of all receivers: counter and schema checks, and error counts."""

from dataclasses import dataclass

from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.e2e import CounterCheck, Verdict
from hri_predict.protocol.messages import Schema

OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)
FORGET_S = 1.0  # after this silence, another node may answer, even one of another version

ERRORS = ("crc_errors", "counter_errors", "malformed", "incomplete")
"""Fields of ``ReceiveCounters`` that must stop a controller if they grow too fast."""


@dataclass(slots=True, kw_only=True)
class ReceiveCounters:
    """Counts of a receiver since it was created.

    Attributes:
        received: messages passed on.
        crc_errors: frames with a wrong CRC.
        counter_errors: messages that were repeated, out of order or lost.
        malformed: frames with a correct CRC but wrong length or values, and bytes outside a frame.
        incomplete: multi-frame messages with missing frames.
        ignored: frames from other senders, which are not checked.
    """

    received: int = 0
    crc_errors: int = 0
    counter_errors: int = 0
    malformed: int = 0
    incomplete: int = 0
    ignored: int = 0


def fresh(check: CounterCheck, counter: int, counters: ReceiveCounters) -> bool:
    """Return whether the counter is fresh; count counter errors."""
    verdict = check.check(counter)
    if verdict is Verdict.OK:
        return True
    if verdict is Verdict.SOME_LOST:
        counters.counter_errors += check.lost
        return True
    counters.counter_errors += 1
    return False


class SchemaGate:
    """Tracks whether received messages use our definitions.

    Closed until a Schema with our version and hash arrives, and closed again by any other Schema.
    Bytes encoded with other definitions would pass the CRC but be misread.

    Attributes:
        heard: the newest Schema; ``None`` if none was received.
    """

    def __init__(self) -> None:
        self.heard: Schema | None = None

    def take(self, schema: Schema) -> None:
        """Process a received Schema."""
        self.heard = schema

    def reset(self) -> None:
        """Forget the Schema, as after a silence of ``FORGET_S``."""
        self.heard = None

    @property
    def open(self) -> bool:
        """Whether messages may be used."""
        return self.heard == OURS

    @property
    def why(self) -> str:
        """Why the gate is closed: both versions and hashes; "" if it is open."""
        if self.open:
            return ""
        if self.heard is None:
            return f"no Schema received yet; this receiver is built for {_named(OURS)}"
        return f"received Schema of {_named(self.heard)}; this receiver is built for {_named(OURS)}"


def _named(schema: Schema) -> str:
    return f"version {schema.version}, hash {schema.hash:#010x}"
