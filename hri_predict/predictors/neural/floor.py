"""Minimum time of a network's arithmetic on one core: number of products over the core's rate.

Only products count: those of matrices and convolutions. Exponentials, sums, normalisation and
moving data come on top, so no program reaches the floor.
"""

import time

import torch
from torch.utils.flop_counter import FlopCounterMode

from hri_predict.predictors.neural.network import BodyFrames, Network

_SIZE = 512  # three such matrices take 3 MiB: larger than a first cache, within a core's second
_TRIALS = 20


def products(network: Network, people: int) -> int:
    """Number of multiply-add pairs in a lean forecast for ``people``."""
    steps, joints = network.shape.history_steps, network.shape.joints
    window = BodyFrames(
        torch.zeros(people, steps, joints, 3), torch.ones(people, steps, joints, dtype=torch.bool)
    )
    lean = network.lean()
    with FlopCounterMode(display=False) as counted, torch.no_grad():
        lean(window)
    return int(counted.get_total_flops()) // 2


def products_per_second() -> float:
    """Multiply-add pairs per second of one core, single precision: best of several matrix products.

    Limits torch to one thread while it measures.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        one, other = torch.rand(_SIZE, _SIZE), torch.rand(_SIZE, _SIZE)
        taken = []
        for _ in range(_TRIALS):
            begin = time.perf_counter()
            torch.mm(one, other)
            taken.append(time.perf_counter() - begin)
    finally:
        torch.set_num_threads(threads)
    return _SIZE**3 / min(taken)
