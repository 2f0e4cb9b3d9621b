"""Recorded controllers in a replay without links."""

from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from hri_predict.contracts.link import LinkCounters
from hri_predict.recording.played_link import PlayedLink, played_links


@pytest.mark.parametrize(
    ("source", "robots", "warned"),
    [
        (SimpleNamespace(received=()), ["arm"], True),
        (SimpleNamespace(received=()), [], False),
        (SimpleNamespace(received=[("plc", None)]), ["arm"], False),
        (SimpleNamespace(), ["arm"], False),  # not a recording
    ],
)
def test_a_recording_without_robot_states_says_so(caplog, source, robots, warned):
    played_links(source, Mock(), robots)
    assert ("the recording has no robot states, so arm stays unknown" in caplog.text) == warned


def test_a_link_that_is_not_opened_counts_no_message_as_too_late():
    """*superseded* would mean a slow line, and nothing is opened."""
    link = PlayedLink("plc", Mock(received=()), Mock())
    link.post(Mock())
    link.post(Mock())
    assert link.counters == LinkCounters()
