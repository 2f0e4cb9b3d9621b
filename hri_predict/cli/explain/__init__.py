"""``explain`` and ``report``: what recordings say of a moment, and of a shift."""
