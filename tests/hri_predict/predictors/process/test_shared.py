import fcntl
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import PredictorError
from hri_predict.contracts.predictor import Forecast
from hri_predict.predictors.process.shared import SharedWindows, Sizes, bytes_of, create, set_size

SIZES = Sizes(people=3, history=4, horizon=5, joints=2)


@pytest.fixture
def both():
    """Both sides of one memory."""
    memory = create()
    set_size(memory, SIZES)
    node, worker = SharedWindows(memory, SIZES), SharedWindows(memory, SIZES)
    os.close(memory)
    return node, worker


def window(people, seed=0):
    random = np.random.default_rng(seed)
    shape = (people, SIZES.history, SIZES.joints)
    return random.normal(size=(*shape, 3)), random.random(shape) > 0.5


def forecast(people, seed=0, std=True):
    random = np.random.default_rng(seed)
    shape = (people, SIZES.horizon, SIZES.joints)
    return Forecast(random.normal(size=(*shape, 3)), random.random(shape) if std else None)


@pytest.mark.parametrize("people", [0, 1, 3])
def test_a_window_arrives_as_it_was_written(both, people):
    node, worker = both
    history, observed = window(people)
    node.post(1, history, observed)
    number, there, seen = worker.take(after=0)
    assert number == 1
    np.testing.assert_array_equal(there, history)
    np.testing.assert_array_equal(seen, observed)
    assert worker.take(after=1) is None


@pytest.mark.parametrize("std", [True, False])
def test_a_forecast_arrives_as_it_was_written(both, std):
    node, worker = both
    told = forecast(2, std=std)
    worker.give(7, told)
    got = node.answer(7)
    np.testing.assert_array_equal(got.positions, told.positions)
    assert (got.std is None) is not std
    if std:
        np.testing.assert_array_equal(got.std, told.std)


def test_the_newest_window_wins(both):
    node, worker = both
    for number in (1, 2, 3):
        node.post(number, *window(1, seed=number))
    number, there, _ = worker.take(after=0)
    assert number == 3
    np.testing.assert_array_equal(there, window(1, seed=3)[0])


def test_an_answer_to_another_window_is_none(both):
    node, worker = both
    worker.give(4, forecast(1))
    assert node.answer(3) is None
    assert node.answer(5) is None
    assert node.answer(4) is not None


def test_what_is_being_written_is_not_taken(both):
    """The first number says that the writing of window 2 has begun, the last that 1 was whole."""
    node, worker = both
    node.post(1, *window(1))
    node._asked[0] = 2
    assert worker.take(after=0) is None
    worker.give(1, forecast(1))
    worker._given[0] = 2
    assert node.answer(1) is None


def test_why_there_is_none_arrives_cut_to_size(both):
    node, worker = both
    worker.refuse(1, "äh " * 1000)
    problem = node.answer(1)
    assert isinstance(problem, PredictorError)
    assert str(problem).startswith("äh äh")
    assert len(str(problem).encode()) < 600


def test_too_many_people_are_refused(both):
    with pytest.raises(PredictorError, match="does not fit"):
        both[0].post(1, *window(4))


def test_neither_side_can_change_the_size():
    memory = create()
    set_size(memory, SIZES)
    with pytest.raises(PermissionError):
        os.ftruncate(memory, 0)
    with pytest.raises(PermissionError):
        fcntl.fcntl(memory, fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE)
    os.close(memory)


def test_absurd_sizes_take_no_memory():
    memory = create()
    with pytest.raises(PredictorError, match=r"predictor\.process to false"):
        set_size(memory, Sizes(people=64, history=100_000, horizon=100_000, joints=21))
    assert os.fstat(memory).st_size == 0
    os.close(memory)


@given(*(st.integers(1, 40) for _ in range(4)))
def test_everything_has_room_and_nothing_overlaps(people, history, horizon, joints):
    sizes = Sizes(people=people, history=history, horizon=horizon, joints=joints)
    memory = create()
    set_size(memory, sizes)
    windows = SharedWindows(memory, sizes)
    os.close(memory)
    assert windows._next <= bytes_of(sizes)
    arrays = [each for each in vars(windows).values() if isinstance(each, np.ndarray)]
    assert len(arrays) == 9
    for fill, array in enumerate(arrays):
        array[...] = fill % 2
    for fill, array in enumerate(arrays):
        assert (array == fill % 2).all()
