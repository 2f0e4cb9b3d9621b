"""Generate every file in ``drivers`` that depends on the definition of the messages.

Some files are generated completely. In others, only the marked parts are regenerated.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.generate import (
    blocks,
    c_header,
    dbc,
    document,
    plcopen,
    register_tables,
    scl,
    st_messages,
    structured_text,
)

COMMAND = "hri-predict protocol files"
RENEWED: dict[str, Callable[[str], str]] = {
    "PROTOCOL.md": lambda text: blocks.renewed(text, document.BLOCKS, blocks.DOCUMENT),
    "MODBUS.md": lambda text: blocks.renewed(text, register_tables.MODBUS, blocks.DOCUMENT),
    "OPCUA.md": lambda text: blocks.renewed(text, register_tables.OPCUA, blocks.DOCUMENT),
    **dict.fromkeys(
        ("c/hri_predict.h", "c/hri_decode.c", "c/examples/decode.c"),
        lambda text: blocks.renewed(text, c_header.BLOCKS),
    ),
    **{f"plc/{name}": st_messages.renewed for name in structured_text.FILES},
}
WRITTEN: dict[str, Callable[[], str]] = {
    f"dbc/{dbc.FILES[False]}": lambda: dbc.dbc_text(False),
    f"dbc/{dbc.FILES[True]}": lambda: dbc.dbc_text(True),
    "c/fuzz/corpus.txt": c_header.corpus,
}
PROJECTS = {"plc/hri_predict.xml": plcopen.xml, "plc/hri_predict.scl": scl.scl}


def generated(folder: Path, part: str = "") -> dict[Path, str]:
    """Return the text of all files by path.

    Args:
        folder: ``drivers``, or the requested part of it.
        part: only files below this part, such as ``c/``.

    Raises:
        ConfigError: a file with parts to keep cannot be read or parsed.
    """

    def places(names: Iterable[str]) -> dict[str, Path]:
        return {n: folder / n.removeprefix(part) for n in names if n.startswith(part)}

    texts = {path: RENEWED[name](read(path)) for name, path in places(RENEWED).items()}
    texts |= {path: WRITTEN[name]() for name, path in places(WRITTEN).items()}
    projects = places(PROJECTS)
    if projects:
        sources = places(f"plc/{name}" for name in structured_text.FILES).values()
        units = [unit for path in sources for unit in _units(path, texts[path])]
        texts |= {path: PROJECTS[name](units) for name, path in projects.items()}
    return texts


def _units(path: Path, text: str) -> list[structured_text.Unit]:
    try:
        return list(structured_text.units(text))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def read(path: Path) -> str:
    """Return the text of a file to be regenerated; refuse devices, whose data may never end.

    Raises:
        ConfigError: it is not a file, or not text.
    """
    if path.exists() and not path.is_file():
        raise ConfigError(f"{path}: cannot be read: not a file; check the path")
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
        raise ConfigError(f"{path}: cannot be read: {reason}; check the path") from error
