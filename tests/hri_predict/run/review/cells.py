"""A cell for the tests, with text replaced."""

from pathlib import Path

from hri_predict.run import config
from hri_predict.run.config import Config

CELL = """\
rate_hz: 25
source:
  kind: procedural
  room_from_source: {xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
  people: [{start: [1.0, 0.1], script: [{do: wait, seconds: 20}]}]
predictor: {name: constant_velocity, horizon_s: 1.2}
robots:
  - name: arm
    model: ur5e
    room_from_robot: {xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
    max_speed_m_s: 1.0
    motion: {kind: state, delay_s: 0.01}
people: {max_people: 16}
risk: {mode: predictive}
links:
  - {name: plc, kind: can, interface: virtual, channel: a, reaction_s: 0.05, delay_s: 0.01}
"""


def cell(folder: Path, *changes: tuple[str, str]) -> Config:
    """The cell with texts replaced."""
    text = CELL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return config.load(path)
