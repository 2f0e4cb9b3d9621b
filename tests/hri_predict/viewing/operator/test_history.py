from hypothesis import given
from hypothesis import strategies as st

from hri_predict.viewing.operator.state import KEPT, History


def change(number: int, level: str = "STOP") -> dict:
    return {"number": number, "level": level, "robot": 0, "reason": "r", "utc_s": 0.0}


@given(st.lists(st.integers(1, 30), max_size=20))
def test_each_change_is_kept_once_whatever_pictures_repeat(ends):
    """Pictures carry the newest changes again and again, and each end is one picture's."""
    history = History()
    for end in ends:
        history.add([change(n) for n in range(1, end + 1)])
    numbers = [row["number"] for row in history.rows()]
    assert numbers == list(range(max(ends, default=0), 0, -1))
    assert history.missed == 0


def test_changes_that_never_came_are_counted():
    history = History()
    history.add([change(1)])
    history.add([change(5)])
    assert history.missed == 3


def test_an_alert_is_read_when_somebody_says_so():
    history = History()
    history.add([change(1), change(2, "CLEAR"), change(3)])
    assert [row["read"] for row in history.rows()] == [False, True, False]
    assert history.acknowledge(3)
    assert [row["read"] for row in history.rows()] == [True, True, False]


def test_an_alert_that_is_not_there_cannot_be_read():
    assert not History().acknowledge(7)


def test_a_cell_that_flaps_pushes_out_its_own_alerts_and_not_the_others():
    history = History()
    history.add([change(1) | {"cell": "quiet"}])
    for n in range(2, 3 * KEPT):
        history.add([change(n) | {"cell": "flaps"}])
    assert len(history.rows()) == KEPT
    assert history.rows()[-1]["cell"] == "quiet"
    assert history.forgotten == 3 * KEPT - 1 - KEPT


def test_all_up_to_a_number_are_read_at_once():
    history = History()
    history.add([change(n) for n in (1, 2, 3)])
    version = history.version
    assert history.acknowledge(2, with_older=True)
    assert [row["read"] for row in history.rows()] == [False, True, True]
    assert history.version != version
    assert not history.acknowledge(0, with_older=True)


def test_the_history_is_bounded():
    history = History()
    for n in range(1, 3 * KEPT):
        history.add([change(n)])
    assert len(history.rows()) == KEPT
    assert history.missed == 0
