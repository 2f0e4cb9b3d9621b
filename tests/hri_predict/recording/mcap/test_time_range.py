"""The part of a recording that is asked for is the same as that part of the whole."""

import pytest

from hri_predict.recording import read_messages
from hri_predict.run.session import Options, run
from tests.hri_predict.viewing.staged import cell


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("within")
    path = folder / "cell.mcap"
    run(cell(folder).quiet(), Options(factor=None, duration_s=4.0, record=path))
    return path


@pytest.mark.long
def test_a_span_holds_the_messages_of_that_span(recording):
    whole = list(read_messages(recording))
    start, end = whole[0].utc_ns + 1_000_000_000, whole[0].utc_ns + 2_000_000_000
    part = list(read_messages(recording, start_utc_ns=start, end_utc_ns=end))
    assert part == [told for told in whole if start <= told.utc_ns < end]
    assert len(part) > 100


def test_topics_are_those_that_were_asked_for(recording):
    whole = list(read_messages(recording))
    part = list(read_messages(recording, ("/advice", "/zones")))
    assert part == [t for t in whole if t.topic.startswith(("/advice", "/zones"))]
    assert {t.topic for t in part} == {"/advice/arm", "/zones"}


def test_a_whole_recording_is_not_told_as_cut_and_a_cut_one_is(recording, tmp_path):
    cuts: list[str] = []
    start = next(read_messages(recording)).utc_ns
    list(read_messages(recording, ("/advice",), on_cut=lambda: cuts.append("topics")))
    list(read_messages(recording, start_utc_ns=start, on_cut=lambda: cuts.append("span")))
    assert cuts == []
    cut = tmp_path / "cut.mcap"
    data = recording.read_bytes()
    cut.write_bytes(data[: int(len(data) * 0.7)])
    found = list(read_messages(cut, ("/advice",), on_cut=lambda: cuts.append("cut")))
    assert cuts == ["cut"]
    assert found == list(read_messages(recording, ("/advice",)))[: len(found)]
    assert len(found) > 20


@pytest.mark.parametrize("span", [(None, 0), (2**62, None)])
def test_a_span_without_messages_is_empty(recording, span):
    start, end = span
    assert list(read_messages(recording, start_utc_ns=start, end_utc_ns=end)) == []
