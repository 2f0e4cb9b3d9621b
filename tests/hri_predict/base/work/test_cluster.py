"""A real scheduler and real workers on loopback: the same results, and a killed worker loses none.

Workers are processes that the tests end by their id. Nothing listens beyond 127.0.0.1.
"""

import os
import signal
import sys

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.work import cluster as module
from hri_predict.base.work.cluster import Cluster
from hri_predict.base.work.workers_for import workers_for
from tests.hri_predict.base.machine import jobs
from tests.hri_predict.base.machine.dask_processes import scheduler, worker

pytest.importorskip("distributed", reason="needs the extra 'cluster'")
pytestmark = pytest.mark.realtime


def test_nobody_at_the_address_is_one_line(monkeypatch):
    monkeypatch.setattr(module, "CONNECT_S", 0.3)
    with pytest.raises(ConfigError, match="no Dask scheduler answers there; start one"):
        workers_for(1, "tcp://127.0.0.1:9")


def test_a_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"pip install 'hri-predict\[cluster\]'"):
        workers_for(1, "tcp://127.0.0.1:8786")


@pytest.mark.long
def test_a_killed_worker_loses_nothing_and_other_files_are_refused(tmp_path, monkeypatch):
    data = tmp_path / "data.bin"
    data.write_bytes(b"walk")
    with scheduler(tmp_path) as address:
        monkeypatch.setattr(module, "WORKER_S", 0.3)
        with pytest.raises(ConfigError, match="the scheduler has no worker; start some"):
            Cluster(address)
        monkeypatch.setattr(module, "WORKER_S", 60.0)
        with (
            worker(address, tmp_path / "a") as first,
            worker(address, tmp_path / "b"),
            Cluster(address, [data]) as workers,
        ):
            workers._client.wait_for_workers(2, timeout=60)
            tasks = [(n, str(tmp_path)) for n in range(30)]
            results = workers.each(jobs.slow_square, tasks)
            found = dict([next(results)])
            while not (tmp_path / str(first.pid)).exists():  # it does some of them
                found.update([next(results)])
            os.kill(first.pid, signal.SIGKILL)
            found.update(results)
            assert found == {n: n * n for n, _ in tasks}
            with pytest.raises(ConfigError, match="two: cannot be done"):
                workers.in_order(jobs.refused, [(2,)])
            data.write_bytes(b"run")  # the workers see what the command does not
            with pytest.raises(ConfigError, match=r"data\.bin is another file for worker"):
                refuse_cached(workers)


def refuse_cached(workers: Cluster) -> None:
    """Ask for the file as it was, under another expectation, so that no answer is remembered."""
    workers._files = (*workers._files, *workers._files)
    workers.in_order(jobs.square, [(1,)])


@pytest.mark.long
def test_other_software_is_refused(tmp_path):
    with scheduler(tmp_path) as address, worker(address, tmp_path / "a"), Cluster(address) as ours:
        ours._software = (("hri-predict", "0.0.1"),)
        with pytest.raises(ConfigError, match=r"has hri-predict .*, this command 0\.0\.1"):
            ours.in_order(jobs.square, [(1,)])
