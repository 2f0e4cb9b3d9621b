"""Our structured text, ready to be called."""

from pathlib import Path

import pytest

from tests.hri_drivers.plc.structured_text import Units, load

PLC = Path(__file__).resolve().parents[3] / "drivers" / "plc"
SOURCES = [PLC / f"hri_{name}.st" for name in ("fields", "advice", "send", "serial", "modbus")]


def everything() -> Units:
    """New instances of all functions and function blocks, by name."""
    return load(*(path.read_text(encoding="ascii") for path in SOURCES))


@pytest.fixture
def units() -> Units:
    return everything()
