"""``python -m hri_predict`` is ``hri-predict``."""

from hri_predict.cli import main

main()
