"""hri-predict: where will the people near this robot be, and what should it do about it.

The way of a frame: source -> people -> predictor -> risk -> publisher -> links. Each stage is a
module of this package and knows only the next one's contract.
"""

__version__ = "0.1.0"
