"""Write DBC files, document, C header and PLC projects from the definition of the messages."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import tell
from hri_predict.protocol.can import DEFAULT_BASE_ID
from hri_predict.protocol.generate import c_header, document, plcopen, scl, structured_text
from hri_predict.protocol.generate import dbc as dbc_files

app = typer.Typer(no_args_is_help=True, help=__doc__)


@app.command()
def dbc(
    folder: Annotated[Path, typer.Argument(help="Folder for both files.")] = Path("drivers/dbc"),
    base_id: Annotated[
        str, typer.Option(metavar="ID", help="Base id on the bus, such as 0x680.")
    ] = f"{DEFAULT_BASE_ID:#x}",
    extended: Annotated[bool, typer.Option("--extended", help="Use 29-bit ids.")] = False,
) -> None:
    """Write the DBC files of classic CAN and of CAN FD.

    Example: hri-predict protocol dbc . --base-id 0x680
    """
    try:
        base = int(base_id, 0)
    except ValueError:
        raise ConfigError(
            f"--base-id {base_id}: not a whole number; give one such as 0x680"
        ) from None
    if find_spec("cantools") is None:
        raise ConfigError("protocol dbc needs cantools; pip install 'hri-predict[dev]'")
    texts = {name: dbc_files.dbc_text(fd, base, extended) for fd, name in dbc_files.FILES.items()}
    tell([_write(folder / name, text) for name, text in texts.items()])


@app.command("document")
def renew_document(
    path: Annotated[Path, typer.Argument(help="The document.")] = Path("drivers/PROTOCOL.md"),
) -> None:
    """Renew the tables of PROTOCOL.md; the words around them stay.

    Example: hri-predict protocol document drivers/PROTOCOL.md
    """
    tell([_write(path, document.renewed(_read(path)))])


@app.command("c-header")
def renew_c_header(
    folder: Annotated[Path, typer.Argument(help="Folder of hri_predict.h and of fuzz/.")] = Path(
        "drivers/c"
    ),
) -> None:
    """Renew the constants in hri_predict.h, and the seeds of its fuzzer.

    Example: hri-predict protocol c-header drivers/c
    """
    header = folder / "hri_predict.h"
    renewed = _write(header, c_header.renewed(_read(header)))
    tell([renewed, _write(folder / "fuzz" / "corpus.txt", c_header.corpus())])


@app.command("plcopen")
def renew_plcopen(
    folder: Annotated[Path, typer.Argument(help="Folder of the .st files.")] = Path("drivers/plc"),
) -> None:
    """Write hri_predict.xml (PLCopen) and hri_predict.scl (TIA) from the structured text.

    Example: hri-predict protocol plcopen drivers/plc
    """
    units: list[structured_text.Unit] = []
    for name in structured_text.FILES:
        path = folder / name
        text = _read(path)
        try:
            units += structured_text.units(text)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from error
    texts = {"hri_predict.xml": plcopen.xml(units), "hri_predict.scl": scl.scl(units)}
    tell([_write(folder / name, text) for name, text in texts.items()])


def _read(path: Path) -> str:
    if path.exists() and not path.is_file():  # it is written afterwards; a device may never end
        raise ConfigError(f"{path}: cannot be read: not a file; check the path")
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
        raise ConfigError(f"{path}: cannot be read: {reason}; check the path") from error


def _write(path: Path, text: str) -> Path:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be written: {error.strerror}; name a folder that exists"
        ) from error
    return path
