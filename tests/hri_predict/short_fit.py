"""A learned scale in a fraction of a second, for tests of what is built on it."""

from contextlib import contextmanager

import pytest

from hri_predict.lab.calibration import scale_fit


@contextmanager
def short_fit(steps=30, batch=512):
    """Scales are fitted in fewer and smaller steps: coarse, but factors make up for it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scale_fit, "STEPS", steps)
        patch.setattr(scale_fit, "BATCH", batch)
        yield
