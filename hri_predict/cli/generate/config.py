"""Write the JSON schema or the reference page of all configuration settings."""

import json
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.files import atomic_write
from hri_predict.cli.common import writing

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__)

DOCUMENT = Path("docs/configuration.md")


def schema_text() -> str:
    """The JSON schema as a file."""
    from hri_predict.cli.settings_page.schema import schema

    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


def write(path: Path, text: str) -> None:
    """Write a file completely or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    with writing(str(path), "name another file"):
        atomic_write(path, text.encode())


@app.command("schema")
def print_schema(
    path: Annotated[
        Path | None, typer.Argument(help="Write it into this file; default: print it.")
    ] = None,
) -> None:
    """Print the JSON schema of a configuration, for editors.

    It includes all installed sources, predictors and links, also those of third parties. An editor
    with a YAML language server uses it if the configuration starts with the line
    "# yaml-language-server: $schema=cell.schema.json".

    Example: hri-predict config schema cell.schema.json
    """
    if path is None:
        print(schema_text(), end="")
    else:
        write(path, schema_text())


@app.command()
def document(
    path: Annotated[Path, typer.Argument(help="The document.")] = DOCUMENT,
) -> None:
    """Write the page of all keys.

    Example: hri-predict config document docs/configuration.md
    """
    from hri_predict.cli.settings_page.page import page

    write(path, page())
