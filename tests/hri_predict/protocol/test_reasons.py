"""The table of reasons: each row is whole, and rows that people's safety rests on say so."""

import pytest

from hri_predict.protocol.reason_row import Kind
from hri_predict.protocol.reasons import Reason


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_says_what_is_wrong_and_what_clears_it(reason: Reason) -> None:
    assert Reason(int(reason)) is reason
    assert 0 <= reason <= 255  # a byte on the wire
    assert reason.text
    assert bool(reason.clears_when) is (reason is not Reason.NONE)


def test_reasons_that_pass_into_each_other_have_an_order() -> None:
    ranks = [reason.row.rank for reason in Reason if reason.row.rank is not None]
    assert len(ranks) == len(set(ranks))
    steady = [Reason.PERSON_NEAR, Reason.PERSON_APPROACHING, Reason.RELEASE_PENDING, Reason.NONE]
    held = [reason.row.rank or 0 for reason in steady]
    assert held == sorted(held, reverse=True)


@pytest.mark.parametrize(
    ("cause", "reasons"),
    [
        (
            "blind",
            {
                Reason.SOURCE_BLIND,
                Reason.INPUT_STALE,
                Reason.INPUT_FROZEN,
                Reason.INPUT_REPEATS,
            },
        ),
        ("lost", {Reason.ROOM_NOT_SEEN_EMPTY, Reason.STATE_UNTRUSTED}),
    ],
)
def test_a_room_that_was_not_seen_latches(cause: str, reasons: set[Reason]) -> None:
    assert {reason for reason in Reason if reason.row.latches == cause} >= reasons


@pytest.mark.parametrize("reason", Reason)
def test_what_follows_from_a_reason_agrees_with_its_kind(reason: Reason) -> None:
    row = reason.row
    assert not row.latches or row.kind in (Kind.INPUT, Kind.MEMORY)
    assert not (row.by_distance or row.in_view) or row.kind is Kind.PEOPLE
    assert not row.contradicts or row.kind is Kind.ROBOT
    assert not row.widens_zones or row.kind in (Kind.PREDICTOR, Kind.FORECAST)
    if not row.is_trouble:  # none of these may hide that the node sees or does less than it should
        assert row.kind in (Kind.FORECAST, Kind.MODE)
    assert Reason.MUTED.row.is_trouble
