"""Working distances: ``hri-predict simulate --distance``."""
