"""Generate the parts of the C code in ``drivers/c`` that depend on the definition.

``hri-predict protocol c-header`` regenerates the parts between ``/* generated: begin`` and
``/* generated: end */``, and writes ``fuzz/corpus.txt``. The rest is written by hand.
"""

from collections.abc import Mapping

from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, LAST_NUMBER
from hri_predict.protocol.definition import BY_TYPE, DEFINITIONS, SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.fields import MAX_ROBOTS, PART_BYTES, ROBOT_STRIDE
from hri_predict.protocol.generate.blocks import Blocks
from hri_predict.protocol.generate.c_messages import (
    BODIES,
    ENUMS,
    SENT,
    codes,
    decoding,
    kinds,
    numbers,
    printing,
    snake,
    structures,
)
from hri_predict.protocol.generate.examples import EXAMPLES, encodings
from hri_predict.protocol.reception import FORGET_S
from hri_predict.protocol.robot_state import BASE_ROBOTS, MAX_JOINTS, ROBOT_STATE
from hri_predict.protocol.serial import MAX_ENCODED


def constants() -> dict[str, str]:
    """Name -> C literal of each constant that the C code takes from the definition."""
    rows = {
        "HRI_SCHEMA_VERSION": f"{SCHEMA_VERSION}u",
        "HRI_SCHEMA_HASH": f"0x{SCHEMA_HASH:08X}u",
        "HRI_DEFAULT_BASE_ID": f"0x{DEFAULT_BASE_ID:X}u",
        "HRI_LAST_NUMBER": f"0x{LAST_NUMBER:02X}u",
        "HRI_MAX_ROBOTS": f"{MAX_ROBOTS}u",
        "HRI_ROBOT_STRIDE": f"{ROBOT_STRIDE}u",
        "HRI_MAX_JOINTS": f"{MAX_JOINTS}u",
        "HRI_MAX_DELTA": f"{e2e.MAX_DELTA}u",
        "HRI_RESYNC": f"{e2e.RESYNC}u",
        "HRI_FORGET_MS": f"{round(FORGET_S * 1000)}u",
        "HRI_DATA_ID_16": f"0x{e2e.data_id_16(0):04X}u",
        "HRI_DATA_ID_32": f"0x{e2e.data_id_32(0):08X}u",
        "HRI_PART_BYTES": f"{PART_BYTES}u",
        **{f"HRI_PARTS_{snake(d)}": f"{d.parts}u" for d in SENT if d.per_robot},
        "HRI_PARTS_STATE": f"{ROBOT_STATE.parts}u",
        "HRI_PARTS_STATE_ALWAYS": f"{ROBOT_STATE.always}u",
        "HRI_BASE_ROBOTS": f"{BASE_ROBOTS}u",
        "HRI_EXTRA_STRIDE": f"{ROBOT_STATE.extra[0].stride}u",
        **{f"HRI_NUMBER_STATE_PART_{e.part}": f"0x{e.number:02X}u" for e in ROBOT_STATE.extra},
        **{f"HRI_{snake(d)}_ITEMS": f"{d.items_per_frame}u" for d in BODIES},
        **{f"HRI_ITEM_BYTES_{snake(d)}": f"{d.item_bytes}u" for d in BODIES},
        "HRI_SERIAL_BYTES": f"{MAX_ENCODED}u",
    }
    for d in DEFINITIONS:
        rows[f"HRI_NUMBER_{snake(d)}"] = f"0x{d.number:02X}u"
        rows[f"HRI_BYTES_{snake(d)}"] = f"{d.fixed_bytes}u"
    for enum, name in ENUMS.items():
        rows |= {f"HRI_{name}_{e.name}": f"{int(e)}u" for e in enum}
    return rows


def lines(rows: Mapping[str, str]) -> str:
    """Return the ``#define`` lines."""
    return "".join(f"#define {name} {value}\n" for name, value in rows.items())


BLOCKS: Blocks = {
    "constants": lambda: lines(constants()),
    "codes": lambda: lines(codes()),
    "kinds": kinds,
    "structures": structures,
    "decoding": decoding,
    "numbers": numbers,
    "printing": printing,
}


def corpus() -> str:
    """Return the worked examples of the node's messages for the fuzzer, one unit per line."""
    rows = ["# KIND [ID] BYTES; renew: hri-predict protocol files"]
    for message in EXAMPLES:
        if BY_TYPE[type(message)].sender == "node":
            for link, identifier, data in encodings(message):
                where = "" if identifier is None else f"{identifier:x} "
                rows.append(f"{link.lower()} {where}{data.hex()}")
    return "\n".join(rows) + "\n"
