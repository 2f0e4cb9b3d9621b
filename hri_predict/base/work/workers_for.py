"""Workers for a command's offline work; see ``workers``."""

from collections.abc import Sequence
from pathlib import Path

from hri_predict.base.work.cluster import Cluster
from hri_predict.base.work.workers import Processes, ThisProcess, Workers


def workers_for(jobs: int, cluster: str | None = None, reads: Sequence[Path] = ()) -> Workers:
    """Return the workers.

    Args:
        jobs: number of processes; 1: this one.
        cluster: address of a Dask scheduler whose workers are used instead.
        reads: files that the tasks read. A cluster's workers must have the same files.

    Raises:
        ConfigError: no scheduler answers at the address, or the extra is missing.
    """
    if cluster is not None:
        return Cluster(cluster, reads)
    return ThisProcess() if jobs == 1 else Processes(jobs)
