"""What a receiver of another version makes of what it hears: nothing, and it says why."""

import pytest

from hri_predict.protocol import reception
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Schema
from hri_predict.protocol.reception import SchemaGate

OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)
VERSION_1 = Schema(1, 0xD680A301)  # the last one of that version
BUILT_FOR = f"this receiver is built for version {SCHEMA_VERSION}, hash {SCHEMA_HASH:#010x}"


def after(*schemas: Schema) -> SchemaGate:
    gate = SchemaGate()
    for schema in schemas:
        gate.take(schema)
    return gate


def test_the_gate_is_closed_until_our_schema_has_come() -> None:
    assert not after().open
    assert after().why == f"no Schema received yet; {BUILT_FOR}"
    assert after(OURS).open
    assert after(OURS).why == ""


def test_another_version_or_hash_closes_it_and_is_named() -> None:
    for other, named in (
        (Schema(SCHEMA_VERSION + 1, SCHEMA_HASH), f"version {SCHEMA_VERSION + 1}, "),
        (Schema(SCHEMA_VERSION, 0xAB), "hash 0x000000ab"),
    ):
        gate = after(OURS, other)
        assert not gate.open
        assert gate.why.startswith("received Schema of ")
        assert named in gate.why
        assert gate.why.endswith(BUILT_FOR)
        gate.take(OURS)
        assert gate.open


def test_a_receiver_of_version_1_stays_closed_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reception, "OURS", VERSION_1)
    gate = after(OURS)
    assert not gate.open
    assert gate.why == (
        f"received Schema of version {SCHEMA_VERSION}, hash {SCHEMA_HASH:#010x}; "
        "this receiver is built for version 1, hash 0xd680a301"
    )


def test_version_1_is_not_ours() -> None:
    assert not after(VERSION_1).open
    assert "received Schema of version 1, hash 0xd680a301" in after(VERSION_1).why


def test_what_was_heard_before_a_silence_does_not_count() -> None:
    gate = after(OURS)
    gate.reset()
    assert not gate.open
    assert gate.heard is None
