import pytest

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
