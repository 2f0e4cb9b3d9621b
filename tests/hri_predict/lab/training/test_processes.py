"""How the processes of a run part."""

import pytest
from torch import distributed

from hri_predict.lab.training.processes import Processes


@pytest.fixture
def calls(monkeypatch):
    """What is asked of ``torch.distributed``, in order."""
    found = []
    for name in ("barrier", "destroy_process_group"):
        monkeypatch.setattr(distributed, name, lambda name=name: found.append(name))
    return found


def test_nobody_leaves_before_all_are_done(calls):
    with Processes(0, 2):
        assert calls == []
    assert calls == ["barrier", "destroy_process_group"]


def test_one_that_failed_does_not_wait_for_the_others(calls):
    with pytest.raises(ValueError, match="mine"), Processes(1, 2):
        raise ValueError("mine")
    assert calls == ["destroy_process_group"]


def test_one_whose_others_failed_leaves_in_peace(calls, monkeypatch):
    def closed():
        raise RuntimeError("connection closed by peer")

    monkeypatch.setattr(distributed, "barrier", closed)
    with Processes(0, 2):
        pass
    assert calls == ["destroy_process_group"]


def test_one_alone_has_nobody_to_part_from(calls):
    with Processes():
        pass
    assert calls == []
