"""Origin of a set of weights: code and data."""

import hashlib
import subprocess
from pathlib import Path

import numpy as np
from torch import Tensor

from hri_predict.lab.training.windows.samples import SampleSource


def fingerprint(source: SampleSource) -> str:
    """SHA-256 of the rest pose, one training batch and the first validation windows."""
    digest = hashlib.sha256(" ".join(source.actions).encode())
    tensors: list[Tensor] = [source.rest()]
    for samples in (source.batch(np.random.default_rng(0), 64), next(source.validation(), None)):
        if samples is not None:
            tensors += [samples.history, samples.observed, samples.future, samples.known]
    for tensor in tensors:
        digest.update(tensor.contiguous().numpy().tobytes())
    return digest.hexdigest()


def commit() -> str | None:
    """The checkout's commit, marked if files differ; ``None`` for an installed package."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    here = Path(__file__).resolve().parent
    try:
        done = subprocess.run(command, cwd=here, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
