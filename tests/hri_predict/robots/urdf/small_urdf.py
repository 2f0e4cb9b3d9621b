"""A small URDF for the tests, and the command line that converts it."""

import struct
from pathlib import Path

import numpy as np

from tests.commands import status_of

URDF = Path(__file__).with_name("small.urdf").read_text(encoding="utf-8")
CORNERS = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.04, 0.04) for z in (-0.03, 0.05)])


def stl(points: np.ndarray) -> bytes:
    """A binary STL with every point in some triangle."""
    triangles = [
        points[[i, (i + 1) % len(points), (i + 3) % len(points)]] for i in range(len(points))
    ]
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *t.ravel(), 0) for t in triangles)
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + body


STOP = ["--deceleration", "2", "--brake-delay", "0.1", "--payload-kg", "1"]
CHAIN = ["--base", "plate", "--tip", "camera", "--leave-out", "finger"]


def run(path: Path, *arguments: str) -> int:
    """Exit status of ``hri-predict urdf``."""
    out = [] if "--out" in arguments else ["--out", str(path.parent / "mine.yaml")]
    return status_of("urdf", path, *arguments, *out)
