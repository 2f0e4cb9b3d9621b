"""Scenes to datagrams and back; two implementations; what is damaged or forged is refused."""

import re
import zlib
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.scene_stream.codec import (
    CHUNK,
    MAX_DATAGRAM,
    Refused,
    decode_body,
    encode,
    open_datagram,
)
from hri_drivers.sources.sent import SentPerson, SentScene
from tests.hri_drivers.sources.scene_streaming import (
    CORPUS,
    KEY,
    ROOT,
    SECRET,
    UTC,
    hri_sender,
    names,
    person,
    same,
    scene,
)

ERROR_M = st.just(0.0) | st.floats(0, 20, width=32)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[SentScene, int]:
    """Any scene that a stream carries, and its number of joints."""
    joints = draw(st.integers(1, 128))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    people = []
    for number in draw(st.lists(st.integers(0, 65535), max_size=16)):
        observed = rng.random(joints) < 0.8
        positions = rng.normal(size=(joints, 3)).astype(np.float32).astype(np.float64)
        positions[~observed] = np.nan
        people.append(SentPerson(number, positions, observed, draw(ERROR_M)))
    stamp, sequence = draw(st.integers(-(2**63), 2**63 - 1)), draw(st.integers(0, 2**63 - 1))
    return SentScene(
        stamp_ns=stamp, sequence=sequence, sees_room=draw(st.booleans()), people=tuple(people)
    ), joints


@given(scenes(), st.sampled_from([None, KEY]), st.integers(0, 2**64 - 1))
def test_a_scene_comes_back_to_the_last_bit(drawn, key, session):
    sent, joints = drawn
    datagrams = encode(replace(sent, session=session), names(joints), key)
    opened = [open_datagram(data, key) for data in datagrams]
    assert all(len(data) <= MAX_DATAGRAM for data in datagrams)
    assert [header.part for header, _ in opened] == list(range(len(datagrams)))
    assert all(len(payload) == CHUNK for _, payload in opened[:-1])
    assert all(header.session == session for header, _ in opened)
    assert same(decode_body(opened[0][0], b"".join(payload for _, payload in opened)), sent)


@pytest.mark.parametrize("key", [None, KEY])
def test_the_copied_sender_writes_the_same_bytes(key, tmp_path):
    module, file = hri_sender(), tmp_path / "key"
    file.write_bytes(SECRET + b"\n")
    sender = module.SceneSender("127.0.0.1", 9, names(40), file if key else None)
    for people in range(5):
        mine = scene(people, people, 40)
        errors = [()] * people if people % 2 else [(0.3 * i,) for i in range(people)]
        positions = [
            (p.id, [*p.positions[:-1], None], *error)
            for p, error in zip(mine.people, errors, strict=True)
        ]
        seen = np.array([True] * 39 + [False])
        last = [
            SentPerson(p.id, p.positions, seen, *error)
            for p, error in zip(mine.people, errors, strict=True)
        ]
        hidden = SentScene(
            stamp_ns=UTC,
            sequence=people,
            sees_room=True,
            people=tuple(last),
            session=sender.session,
        )
        assert sender.encode(positions, True, UTC) == encode(hidden, names(40), key)
    sender.close()


def test_four_people_of_25_joints_fit_one_datagram():
    assert [len(d) for d in encode(scene(0, 4, 25), names(25), KEY)] == [1280]


def test_the_worked_examples():
    text = (ROOT / "drivers" / "SCENE_STREAM.md").read_text(encoding="utf-8")
    examples = [bytes.fromhex(h) for h in re.findall(r"```hex\n(.*?)```", text, re.DOTALL)]
    assert [len(e) for e in examples] == [71, 75, 83]
    keys, errors_m = (None, None, KEY), (0.0, np.float32(0.4), 0.0)
    for data, key, error_m in zip(examples, keys, errors_m, strict=True):
        header, body = open_datagram(data, key)
        assert (header.session, header.stamp_ns) == (UTC, UTC + 1_400_000_000)
        found = decode_body(header, body)
        assert (found.sequence, found.sees_room) == (41, True)
        (seen,) = found.people
        assert (seen.id, seen.error_m) == (7, error_m)
        assert seen.observed.tolist() == [True, False]
        assert seen.positions[0].tolist() == [0.5, -0.25, 1.0]
        assert encode(found, ["l_wrist", "r_wrist"], key) == [data]


@pytest.mark.parametrize("key", [None, KEY])
def test_no_error_of_one_bit_is_accepted(key):
    (data,) = encode(scene(), names(4), key)
    for bit in range(8 * len(data)):
        with pytest.raises(Refused):
            open_datagram(flipped(data, [bit]), key)


def test_no_error_of_two_or_three_bits_is_accepted():
    (data,) = encode(scene(0, 4, 25), names(25))
    rng = np.random.default_rng(0)
    protected = range(8 * 6, 8 * len(data))  # what is before is compared as it stands
    for count in (2, 3):
        for _ in range(600):
            with pytest.raises(Refused):
                open_datagram(flipped(data, rng.choice(protected, count, replace=False)))


@given(st.binary(max_size=1500), st.sampled_from([None, KEY]))
def test_random_bytes_are_refused(data, key):
    for start in (b"", b"HRIS\x01", b"HRIS\x01\x03"):
        with pytest.raises(Refused):
            open_datagram(start + data, key)


@given(st.data())
def test_a_right_tag_does_not_make_a_wrong_datagram_right(data):
    """Any byte but its tag exchanged, and tagged anew: refused, or a scene within its bounds."""
    (whole,) = encode(scene(0, 2), names(4), KEY)
    changed = bytearray(whole[:-16])
    for index in data.draw(st.lists(st.integers(0, len(changed) - 1), max_size=4)):
        changed[index] = data.draw(st.integers(0, 255))
    try:
        header, payload = open_datagram(bytes(changed) + KEY.tag(bytes(changed)), KEY)
        if header.parts == 1:
            assert len(decode_body(header, payload).people) == header.people <= 16
    except Refused:
        pass


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_joint_that_is_observed_and_no_number_is_refused(value):
    one = person(1, 4)
    one.positions[2, 1] = value
    (data,) = encode(SentScene(stamp_ns=UTC, sequence=0, sees_room=True, people=(one,)), names(4))
    header, body = open_datagram(data)
    with pytest.raises(Refused, match="not a number") as caught:
        decode_body(header, body)
    assert caught.value.counter == "malformed"


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.001, 20.001, 3e38])
def test_an_error_that_can_be_none_is_refused(value):
    everybody = (person(1, 4), replace(person(2, 4), error_m=value))
    (data,) = encode(
        SentScene(stamp_ns=UTC, sequence=0, sees_room=True, people=everybody), names(4)
    )
    header, body = open_datagram(data)
    with pytest.raises(Refused, match="send 0 to 20") as caught:
        decode_body(header, body)
    assert caught.value.counter == "malformed"


def test_the_flag_of_errors_is_set_only_where_there_is_one():
    """So a node that does not know it refuses the scene, and takes all others."""
    exact = scene(0, 2)
    (without,) = encode(exact, names(4))
    one, other = exact.people
    (stated,) = encode(replace(exact, people=(one, replace(other, error_m=0.25))), names(4))
    assert (without[5], stated[5]) == (0x01, 0x05)
    assert len(stated) == len(without) + 2 * 4
    with pytest.raises(Refused, match="length does not fit"):
        opened(without, flags=0x05)
    with pytest.raises(Refused, match="length does not fit"):
        opened(stated, flags=0x01)


def opened(data: bytes, *, flags: int) -> None:
    """A datagram with other flags, and the tag that fits."""
    changed = data[:5] + bytes([flags]) + data[6:-4]
    open_datagram(changed + zlib.crc32(changed).to_bytes(4, "little"))


@pytest.mark.parametrize("error_m", [-1, 20.5, float("nan"), float("inf")])
def test_the_copied_sender_refuses_an_error_that_can_be_none(error_m):
    sender = hri_sender().SceneSender("127.0.0.1", 9, ["head"])
    with pytest.raises(ValueError, match=r"person 3: error .* give 0 to 20"):
        sender.encode([(3, [None], error_m)], True, UTC)
    assert sender.sequence == 0
    sender.close()


@pytest.mark.parametrize("keys", [(None, KEY), (KEY, None)])
def test_key_or_no_key_must_be_agreed_upon(keys):
    (data,) = encode(scene(), names(4), keys[0])
    with pytest.raises(Refused) as caught:
        open_datagram(data, keys[1])
    assert caught.value.counter == "unauthenticated"


def test_another_version_is_named():
    (data,) = encode(scene(), names(4))
    with pytest.raises(Refused, match="version 2; this node reads version 1"):
        open_datagram(data[:4] + b"\x02" + data[5:])


def test_the_corpus_is_refused_or_a_scene():
    seeds = sorted(CORPUS.iterdir())
    outcomes = {seed.stem: _outcome(seed.read_bytes()) for seed in seeds}
    assert {"one_person", "stated_error", "nobody", "blind", "first_of_three"} <= {
        name for name, outcome in outcomes.items() if outcome == "taken"
    }
    assert {outcome for name, outcome in outcomes.items() if name.startswith("bad_")} == {
        "malformed", "crc_errors", "unauthenticated",
    }  # fmt: skip


def _outcome(data: bytes) -> str:
    try:
        open_datagram(data)
    except Refused as refused:
        return refused.counter
    return "taken"


def flipped(data: bytes, bits: Iterable[int]) -> bytes:
    changed = bytearray(data)
    for bit in bits:
        changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
