"""Text of unknown encoding, and how far a long loop is."""

import pytest

from hri_predict.recording.bounded import decoded, watched, watching

TEXT = "time_s,H\u00fcfte\n0.5,1\n"


@pytest.mark.parametrize(
    "encoding",
    ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252"],
)
def test_text_is_decoded_with_and_without_a_mark(encoding):
    assert decoded(TEXT.encode(encoding)) == TEXT


def test_bytes_that_are_not_text_keep_their_zeros():
    assert "\0" in decoded(b"\x02P\x00\x00\x01\x00" * 100)


def test_a_watcher_hears_of_long_loops_alone_while_it_watches():
    heard = []
    assert list(watched(range(1200), "reading", 1200)) == list(range(1200))
    with watching(lambda *what: heard.append(what)):
        assert list(watched(range(1200), "reading", 1200)) == list(range(1200))
    assert list(watched(range(3), "reading", 3)) == [0, 1, 2]
    assert heard == [("reading", done, 1200) for done in (0, 500, 1000)]
