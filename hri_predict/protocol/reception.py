"""What every receiver does alike: judge counters, and count whatever is wrong."""

from dataclasses import dataclass

from hri_predict.protocol.e2e import CounterCheck, Verdict


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
