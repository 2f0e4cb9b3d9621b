"""Generate DBC files, document, C header and PLC projects from the message definitions."""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import tell, writing
from hri_predict.protocol.can import DEFAULT_BASE_ID
from hri_predict.protocol.generate import blocks, document
from hri_predict.protocol.generate import dbc as dbc_files
from hri_predict.protocol.generate.files import generated, read

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__)


@app.command()
def files(
    folder: Annotated[Path, typer.Argument(help="Folder for the files.")] = Path("drivers"),
) -> None:
    """Write every file generated from the message definitions.

    Run it from the root of the repository after each change of a definition.

    Example: hri-predict protocol files
    """
    _check_cantools("files")
    _write_all(generated(folder))


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
    _check_cantools("dbc")
    names = dbc_files.FILES.items()
    _write_all({folder / name: dbc_files.dbc_text(fd, base, extended) for fd, name in names})


@app.command("document")
def renew_document(
    path: Annotated[Path, typer.Argument(help="The document.")] = Path("drivers/PROTOCOL.md"),
) -> None:
    """Regenerate the tables of PROTOCOL.md; the text around them is kept.

    Example: hri-predict protocol document drivers/PROTOCOL.md
    """
    _write_all({path: blocks.renewed(read(path), document.BLOCKS, blocks.DOCUMENT)})


@app.command("c-header")
def renew_c_header(
    folder: Annotated[Path, typer.Argument(help="Folder of hri_predict.h and fuzz/.")] = Path(
        "drivers/c"
    ),
) -> None:
    """Regenerate the generated parts of the C code, and the seeds of its fuzzer.

    Example: hri-predict protocol c-header drivers/c
    """
    _write_all(generated(folder, "c/"))


@app.command("plcopen")
def renew_plcopen(
    folder: Annotated[Path, typer.Argument(help="Folder of the .st files.")] = Path("drivers/plc"),
) -> None:
    """Regenerate the structured text, hri_predict.xml (PLCopen) and hri_predict.scl (TIA).

    Example: hri-predict protocol plcopen drivers/plc
    """
    _write_all(generated(folder, "plc/"))


def _check_cantools(command: str) -> None:
    if find_spec("cantools") is None:
        raise ConfigError(
            f"protocol {command} needs cantools; install it with: pip install 'hri-predict[dbc]'"
        )


def _write_all(texts: Mapping[Path, str]) -> None:
    """Write all files, and print their names."""
    for path, text in texts.items():
        with writing(str(path), "name a folder that exists"):
            path.write_text(text, encoding="utf-8")
    tell(list(texts))
