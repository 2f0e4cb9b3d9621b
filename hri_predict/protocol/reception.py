"""What every receiver does alike: judge counters and the schema, and count whatever is wrong."""

from dataclasses import dataclass

from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.e2e import CounterCheck, Verdict
from hri_predict.protocol.messages import Schema

OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)
FORGET_S = 1.0  # silence after which another node, of another version even, may come


@dataclass(slots=True)
class ReceiveCounters:
    """What a receiver met since it was made.

    Attributes:
        received: messages handed on.
        crc_errors: frames with a wrong CRC.
        counter_errors: messages repeated, out of order, or missing between two received ones.
        malformed: right CRC, but wrong length or values; or bytes that frame nothing.
        incomplete: messages of several frames of which not all came.
        ignored: frames of other senders, which are not ours to judge.
    """

    received: int = 0
    crc_errors: int = 0
    counter_errors: int = 0
    malformed: int = 0
    incomplete: int = 0
    ignored: int = 0


def fresh(check: CounterCheck, counter: int, counters: ReceiveCounters) -> bool:
    """Judge a counter and count what is wrong with it."""
    verdict = check.check(counter)
    if verdict is Verdict.OK:
        return True
    if verdict is Verdict.SOME_LOST:
        counters.counter_errors += check.lost
        return True
    counters.counter_errors += 1
    return False


class SchemaGate:
    """Whether what is heard means what this program takes it for.

    Closed until a Schema of our version and hash has come, and again after one of another: the
    bytes of other definitions pass the CRC and mean something else.

    Attributes:
        heard: the newest Schema, ``None`` if there was none.
    """

    def __init__(self) -> None:
        self.heard: Schema | None = None

    def take(self, schema: Schema) -> None:
        """Take the Schema that has come."""
        self.heard = schema

    def reset(self) -> None:
        """Forget it, as after a silence of ``FORGET_S``."""
        self.heard = None

    @property
    def open(self) -> bool:
        """Whether messages may be believed."""
        return self.heard == OURS

    @property
    def why(self) -> str:
        """Why not, "" if they may: which version and hash were heard, and which this is for."""
        if self.open:
            return ""
        if self.heard is None:
            return f"no Schema heard yet; this is built for {_named(OURS)}"
        return f"heard Schema of {_named(self.heard)}; this is built for {_named(OURS)}"


def _named(schema: Schema) -> str:
    return f"version {schema.version}, hash {schema.hash:#010x}"
