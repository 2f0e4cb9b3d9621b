"""What structured text sends is, byte for byte, what the C code sends."""

import random
import subprocess
from pathlib import Path
from typing import Any

from hri_predict.protocol.can import DEFAULT_BASE_ID
from tests.hri_drivers.plc.conftest import everything
from tests.hri_drivers.plc.structured_text import Unit

NAMES = ("BaseXUm", "BaseYUm", "BaseYawUrad", "BaseXUmS", "BaseYUmS", "BaseYawUradS")
STATES, FIRST = 60, 65_500


def amounts(drawn: random.Random, count: int) -> list[int]:
    """Whole numbers of 32 bits: any, near the ends of the ranges, on halves of steps."""
    ends = (0, 8_192_000, 32_768_000, 3_141_593, 6_283_185, 2**31 - 1, -(2**31))
    kinds = (
        lambda: drawn.randrange(-(2**31), 2**31),
        lambda: max(-(2**31), min(2**31 - 1, drawn.choice(ends) + drawn.randrange(-300, 301))),
        lambda: 125 * drawn.randrange(-40_000, 40_000),
        lambda: -drawn.choice(ends[1:5]) + drawn.randrange(-300, 301),
    )
    return [drawn.choice(kinds)() for _ in range(count)]


def sent(blocks: dict[str, Unit], state: dict[str, Any], link: str) -> str:
    """As the C driver prints it."""
    block = blocks["HRI_STATE"]
    block(**state)
    given = {name: block.variables[name] for name in ("Payload", "Needed", "Bytes")}
    v = blocks["HRI_CAN_SEND"].variables
    if link == "classic":
        blocks["HRI_CAN_SEND"](**given)
        units = [
            f"{v['Ids'][i]:x}:{bytes(v['Frames'][8 * i : 8 * i + 8]).hex()}"
            for i in range(v["FrameCount"])
        ]
        return " ".join(units)
    del given["Needed"]
    blocks["HRI_SERIAL_SEND"](**given)
    v = blocks["HRI_SERIAL_SEND"].variables
    return f"0:{bytes(v['Line'][: v['LineBytes']]).hex()}"


def test_structured_text_sends_the_same_bytes_as_the_c_code(build: Any) -> None:
    drawn = random.Random(17)
    program = build(Path(__file__).with_name("driver.c"))
    for code, link in ((0, "classic"), (2, "serial")):
        lines = [f"init {code} 0 {DEFAULT_BASE_ID} 0 150 400 0 500 {FIRST}"]
        blocks, want = everything(), []
        for _ in range(STATES):
            joints, moves = drawn.randrange(10), drawn.randrange(2)
            places, speeds = amounts(drawn, joints), amounts(drawn, joints)
            base = amounts(drawn, 6)
            mode, request, tool = drawn.randrange(5), drawn.randrange(4), drawn.randrange(256)
            enabling, confirmed = drawn.randrange(2), drawn.randrange(2)
            more = (request, enabling, tool, confirmed, moves, *base)
            lines.append(" ".join(map(str, ("state", mode, joints, *places, *speeds, *more))))
            state = {
                "RobotMode": mode,
                "Joints": joints,
                "PositionUrad": places + [0] * (9 - joints),
                "VelocityUradS": speeds + [0] * (9 - joints),
                "Request": request,
                "Enabling": enabling,
                "Tool": tool,
                "ToolConfirmed": confirmed,
                "BaseMoves": moves,
                "FirstCounter": FIRST,
                "NowMs": 0,
                **dict(zip(NAMES, base, strict=True)),
            }
            want.append(sent(blocks, state, link))
        done = subprocess.run(
            [program], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True
        )
        assert done.stdout.splitlines()[1:] == want, link
