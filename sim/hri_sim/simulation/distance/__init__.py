"""How near people may work: ``hri-predict simulate --distance``."""
