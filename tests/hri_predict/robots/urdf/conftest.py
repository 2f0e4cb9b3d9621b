"""The small URDF as a file, with its mesh."""

from pathlib import Path

import pytest

from tests.hri_predict.robots.urdf.small_urdf import CORNERS, URDF, stl


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    (tmp_path / "arm.stl").write_bytes(stl(CORNERS))
    path = tmp_path / "small.urdf"
    path.write_text(URDF.replace("MESH", "arm.stl"))
    return path
