import asyncio
import threading

import pytest

from hri_predict.base.errors import failure as failure_of
from hri_predict.base.errors import first_line


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("not a place\nat all"), "not a place"),
        (AssertionError(), "AssertionError"),  # no text: a message says at least what it was
    ],
)
def test_the_first_line_of_an_error_is_never_missing(error, line):
    assert first_line(error) == line


class Panic(BaseException):
    """As a library in Rust raises it."""


@pytest.mark.parametrize("error", [asyncio.CancelledError(), Panic("at line 3"), SystemExit(0)])
def test_an_error_that_is_no_exception_is_a_failure_that_names_it(error):
    found = failure_of(error)
    assert str(found).startswith(f"{type(error).__name__}: ")
    assert found.__cause__ is error


def test_an_exception_stays_what_it_is():
    error = OSError("gone")
    assert failure_of(error) is error


@pytest.mark.parametrize("kind", [KeyboardInterrupt, GeneratorExit])
def test_what_asks_this_program_to_end_is_no_failure(kind):
    with pytest.raises(kind):
        failure_of(kind())


def test_no_other_thread_is_interrupted_by_ctrl_c():
    found: list[Exception] = []
    thread = threading.Thread(target=lambda: found.append(failure_of(KeyboardInterrupt())))
    thread.start()
    thread.join()
    assert str(found[0]) == "KeyboardInterrupt: KeyboardInterrupt"
