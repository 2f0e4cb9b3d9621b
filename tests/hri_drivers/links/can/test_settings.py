"""What a CAN link may be configured with; links of one bus; which ids pass."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from hri_drivers.links.can.link import CanLink
from hri_drivers.links.can.settings import CanLinkSettings, check_together, id_filters
from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.check import examine
from hri_predict.protocol.wire import classic_bits
from hri_predict.run import config as configuration

CONFIGS = Path(__file__).resolve().parents[4] / "configs"


def link(name: str = "plc", **more: Any) -> CanLinkSettings:
    given = {"interface": "socketcan", "channel": "can0"} | more
    return CanLinkSettings(name=name, **given)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"isotp": {"peer_id": 0x6C7}, "fd": True}, "isotp is for classic CAN"),
        ({"isotp": {"peer_id": 0x6C5}}, "isotp.peer_id 0x6c5: choose one up to 0x7ff outside"),
        ({"isotp": {"peer_id": 0x800}}, "isotp.peer_id 0x800"),
        ({"isotp": {"peer_id": 0x6C7, "id": 0x680}}, "isotp.id 0x680"),
        ({"isotp": {"peer_id": 0x6C6}}, "both 0x6c6"),
        ({"isotp": {"peer_id": 0x6C7}, "listen_only": True}, "listen_only: true forbids it"),
        ({"isotp": {"peer_id": 0x6C7}, "zones": False}, "zones: false forbids it"),
        ({"isotp": {"peer_id": 0x6C7}, "simulate": {}}, "the mock controller cannot be one"),
        ({"isotp": {}}, "peer_id"),
        ({"listen_only": True, "interface": "gs_usb"}, "no such mode for 'gs_usb'"),
        ({"base_id": 0x7A1}, "base_id 0x7a1 leaves no room for 11-bit ids"),
        ({"base_id": 0x1FFFFFC0, "extended": True}, "29-bit"),
    ],
)
def test_what_cannot_be_is_refused_with_a_remedy(wrong, words):
    with pytest.raises(ValidationError) as caught:
        link(**wrong)
    assert words in str(caught.value)


def test_a_channel_may_be_a_number_as_kvaser_and_vector_count_theirs():
    assert link(interface="kvaser", channel=0).channel == "0"


def test_ids_at_the_edges_are_right():
    assert link(base_id=0x7A0).ids[-1] == 0x7FF
    assert link(base_id=0x1FFFFFA0, extended=True).ids[-1] == 0x1FFFFFFF
    assert link(isotp={"peer_id": 0}).ids[0] == 0
    assert link().ids == [*range(0x680, 0x6C6), *range(0x6C8, 0x6E0)]  # ISO-TP's between
    assert link().heard_ids == [*range(0x680, 0x6C7), *range(0x6C8, 0x6E0)]
    assert link(fd=True).heard_ids == [*range(0x680, 0x6C6)]


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ({}, {}, "both use the id 0x680"),
        ({}, {"base_id": 0x6C5}, "both use the id 0x6c5; give 'b' a base_id outside"),
        ({}, {"base_id": 0x63B}, "both use the id 0x680"),
        ({"isotp": {"peer_id": 0x700}}, {"base_id": 0x700}, "both use the id 0x700"),
        (
            {"isotp": {"peer_id": 0x6C7}},
            {"base_id": 0x580, "isotp": {"peer_id": 0x6C7}},
            "both use the id 0x6c7; give 'b' another isotp.peer_id",
        ),
        (
            {},
            {"base_id": 0x580, "isotp": {"peer_id": 0x5C7, "id": 0x680}},
            "both use the id 0x680; give 'b' another isotp.id",
        ),
        ({}, {"base_id": 0x600, "bitrate": 250_000}, "data_bitrate differ"),
        ({"extended": True}, {"extended": True}, "both use the id 0x680"),
        (
            {"interface": "slcan", "channel": "/dev/ttyACM0"},
            {"interface": "slcan", "channel": "/dev/ttyACM0", "base_id": 0x600},
            "an adapter serves one",
        ),
    ],
)
def test_links_on_one_bus_whose_ids_meet_are_refused(first, second, words):
    with pytest.raises(ConfigError, match="links 'a' and 'b' both use") as caught:
        check_together([link("a", **first), link("b", **second)])
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "second",
    [
        {"base_id": 0x6E0},
        {"base_id": 0x620},
        {"channel": "can1"},
        {"extended": True},
        {"simulate": {}, "channel": None},
    ],
)
def test_links_that_do_not_meet_are_fine(second):
    check_together([link("a"), link("b", **second)])


@pytest.mark.parametrize(
    "option", ["interface", "bustype", "channel", "bitrate", "fd", "data_bitrate"]
)
def test_options_do_not_undo_the_links_own_keys(option):
    with pytest.raises(ValidationError, match=f"options.{option}: set the link's own"):
        link("a", options={option: 1})
    with pytest.raises(ValidationError, match="a link must not receive its own frames"):
        link("a", options={"receive_own_messages": True})


def test_check_refuses_such_a_configuration_and_explains_links(tmp_path):
    data = yaml.safe_load((CONFIGS / "demo.yaml").read_text(encoding="utf-8"))
    data["links"] = [
        {"name": "a", "kind": "can", "interface": "socketcan", "channel": "can0"},
        {"name": "b", "kind": "can", "interface": "socketcan", "channel": "can0"},
    ]
    data["predictor"] = {"name": "constant_velocity", "horizon_s": 1.2}
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"cell.yaml:\d+: links: links 'a' and 'b' both use can0"):
        configuration.load(path)
    data["links"][1] |= {"base_id": 0x600, "listen_only": True}
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    notes = "\n".join(examine(configuration.load(path))["notes"])
    assert "link a: classic CAN without 'isotp': this link does not send zones and poses" in notes
    assert "link b: listen_only: the link receives RobotState" in notes
    assert "ip link set can0 up type can bitrate 500000 listen-only on" in notes


def test_a_link_with_a_peer_says_nothing_of_zones():
    assert link(isotp={"peer_id": 0x6C7}).notes == []
    assert link(fd=True).notes == []


@given(
    st.sets(st.integers(0, 0x7FF), min_size=1, max_size=40).map(sorted)
    | st.integers(0, 0x7B9).map(lambda base: [*range(base, base + 0x46)])
)
def test_exact_filters_let_these_ids_pass_and_no_other(ids):
    def passing(filters: Sequence[Any]) -> set[int]:
        return {
            i for i in range(0x800) if any((i ^ f["can_id"]) & f["can_mask"] == 0 for f in filters)
        }

    assert passing(id_filters(ids, False, exact=True)) == set(ids)
    one = id_filters(ids, False, exact=False)
    assert len(one) == 1
    assert passing(one) >= set(ids)


def test_few_filters_are_enough_for_a_link():
    assert len(id_filters(link().heard_ids, False, exact=True)) <= 6
    (widest,) = id_filters(link(extended=True).heard_ids, True, exact=False)
    assert widest == {"can_id": 0x680, "can_mask": 0x1FFFFF80, "extended": True}


def test_a_link_that_only_listens_loads_the_bus_with_what_it_hears_alone():
    load = CanLink.load(link(listen_only=True), 25.0, [0, 1])
    assert set(load.details) == {"RobotState"}
    assert 0 < load.load < CanLink.load(link(), 25.0, [0, 1]).load


def test_with_isotp_an_advice_may_wait_for_what_is_written_ahead_and_one_frame():
    frame_s = classic_bits(8) / 500_000
    assert link().blocking_s == pytest.approx(frame_s)
    assert link(isotp={"peer_id": 0x6C7}).blocking_s == pytest.approx(frame_s + 0.002)


def test_listening_with_slcan_and_pcan_is_asked_of_the_driver():
    for interface, key in (("slcan", "listen_only"), ("pcan", "state")):
        transport = CanLink.make_transport(
            link(interface=interface, channel="somewhere", listen_only=True)
        )
        assert transport._arguments[key]
    with pytest.raises(ValidationError, match="no such mode for 'ixxat'"):
        link(interface="ixxat", listen_only=True)
