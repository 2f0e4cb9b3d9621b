"""OSC packets: those of an independent program, and any bytes."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.vmc.osc import Message, OscError, messages


def built(address: str, *arguments: Any) -> Any:
    builders = pytest.importorskip("pythonosc.osc_message_builder", reason="needs the extra dev")
    builder = builders.OscMessageBuilder(address)
    for each in arguments:
        builder.add_arg(each)
    return builder


def test_a_message_worked_by_hand() -> None:
    data = bytes.fromhex("2F610000 2C696673 00000000 00000007 3F800000 686F0000")
    assert messages(data) == [Message("/a", (7, 1.0, "ho"))]


def test_bundles_of_bundles_are_read_in_order() -> None:
    bundles = pytest.importorskip("pythonosc.osc_bundle_builder", reason="needs the extra dev")
    inner = bundles.OscBundleBuilder(bundles.IMMEDIATELY)
    inner.add_content(built("/b", "Hüfte", 0.5).build())
    outer = bundles.OscBundleBuilder(bundles.IMMEDIATELY)
    outer.add_content(built("/a", 1, True, None).build())
    outer.add_content(inner.build())
    outer.add_content(built("/c").build())
    assert messages(outer.build().dgram) == [
        Message("/a", (1, True, None)),
        Message("/b", ("Hüfte", 0.5)),
        Message("/c", ()),
    ]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "text without end"),
        (b"hello\0\0\0", "neither a message nor a bundle"),
        (b"#bundle\0\0", "without its time"),
        (b"#bundle\0" + bytes(8) + b"\0\0\0\x08/a\0\0", "element of 8 bytes"),
        (b"#bundle\0" + bytes(8) + b"\0\0\0\0", "element of 0 bytes"),
        (b"/a\0\0i\0\0\0", "without type tags"),
        (b"/a\0\0,i\0\0\0", "ends within an argument"),
        (b"/a\0\0,zz\0", "an argument of type 'z'"),
        (b"/\xff\0\0", "not UTF-8"),
    ],
)
def test_what_is_not_a_packet_is_refused(data: bytes, says: str) -> None:
    with pytest.raises(OscError, match=says):
        messages(data)


def test_bundles_that_are_nested_without_end_are_refused() -> None:
    data = b"/a\0\0"
    for _ in range(500):
        data = b"#bundle\0" + bytes(8) + len(data).to_bytes(4, "big") + data
    with pytest.raises(OscError, match="deep"):
        messages(data)


@given(st.binary(max_size=200))
def test_any_bytes_are_messages_or_refused(data: bytes) -> None:
    for packet in (data, b"#bundle\0" + bytes(8) + len(data).to_bytes(4, "big") + data):
        try:
            found = messages(packet)
        except OscError:
            continue
        assert all(message.address.startswith("/") for message in found)
