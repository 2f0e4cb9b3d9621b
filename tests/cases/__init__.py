"""Inputs that the product got wrong, in a folder beside the project; ``CASES`` names another."""

import os
from pathlib import Path

CASES = Path(
    os.environ.get("CASES") or Path(__file__).resolve().parents[3] / "shared" / "cases"
).resolve()
