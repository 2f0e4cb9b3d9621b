"""``conformance``: check that a predictor, source or link meets its contract."""

import contextlib
import json
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.set_key import set_key
from hri_predict.base.settings import validated
from hri_predict.cli.common import JsonOption
from hri_predict.contracts import registry
from hri_predict.library.conformance.checks import NOTHING_CAME, CheckResult
from hri_predict.run import config as configuration

KINDS: dict[str, registry.PartKind] = {
    "predictor": "predictors",
    "source": "sources",
    "link": "links",
}
_STYLES = {"pass": "green", "fail": "bold red", "skipped": "yellow"}


def conformance(
    *,
    part: Annotated[
        str, typer.Argument(help="predictor:NAME, source:NAME or link:NAME; or NAME alone.")
    ],
    config: Annotated[
        Path | None, typer.Option(help="Read its settings from this node configuration.")
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", help="key=value: one of its settings. Repeatable."),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=0.1, max=600, help="Time to listen to a sender, in seconds.")
    ] = 2.0,
    limit: Annotated[
        float, typer.Option(min=1, max=3600, help="Give up after this many seconds.")
    ] = 300.0,
    as_json: JsonOption = False,
) -> int:
    """Check a predictor, source or link, such as your own, against its contract.

    A source that listens to a sender needs a running one; a link's device is not opened.

    Example: hri-predict conformance link:serial --set port=/dev/ttyUSB0

    Exit status 1: a check failed.
    """
    with ending_within(limit, part):
        kind, name = _part(part)
        data, base_dir = _settings(kind, name, config)
        for text in change or []:
            set_key(data, text)
        findings = _checked(kind=kind, name=name, data=data, base_dir=base_dir, seconds=seconds)
    failed = sum(finding.verdict == "fail" for finding in findings)
    if as_json:
        told = {"part": f"{kind}:{name}", "failed": failed, "checks": [asdict(f) for f in findings]}
        print(json.dumps(told))
    else:
        console = Console()
        console.print(_table(f"{kind} {name}", findings))
        console.print(f"{kind} {name}: {_verdict(findings)}", highlight=False, soft_wrap=True)
    return 1 if failed else 0


def _verdict(findings: Sequence[CheckResult]) -> str:
    """Return the outcome of all checks as one line."""
    failed = sum(finding.verdict == "fail" for finding in findings)
    skipped = [finding.detail for finding in findings if finding.verdict == "skipped"]
    unheard = [detail for detail in skipped if detail.startswith(NOTHING_CAME)]
    verdict = f"{failed} of {len(findings)} checks failed" if failed else "keeps its contract"
    if unheard:
        told = verdict if failed else "no check failed"
        return (
            f"{told}, but {len(unheard)} of {len(findings)} checks were skipped: {unheard[0]}, "
            f"and check again"
        )
    return verdict + (f" ({len(skipped)} checks skipped)" if skipped else "")


@contextlib.contextmanager
def ending_within(seconds: float, part: str) -> Iterator[None]:
    """Exit with one line and status 1 if the body takes longer.

    A part that hangs in its own code cannot be interrupted in any other way.
    """

    def give_up() -> None:
        print(f"error: {part}: hangs: not finished after {seconds:g} s (--limit)", file=sys.stderr)
        sys.stderr.flush()
        os._exit(1)

    timer = threading.Timer(seconds, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _part(text: str) -> tuple[str, str]:
    """Return the kind and the name of a part."""
    kind, colon, name = text.partition(":")
    if colon:
        if kind not in KINDS:
            raise ConfigError(
                f"{text}: a part is one of {', '.join(KINDS)}{nearest(kind, KINDS)}; "
                f"write it as predictor:NAME"
            )
        registry.load(KINDS[kind], name)  # complains with what there is
        return kind, name
    found = [kind for kind, group in KINDS.items() if text in registry.names(group)]
    if len(found) == 1:
        return found[0], text
    if found:
        raise ConfigError(
            f"{text}: ambiguous; write one of: {', '.join(f'{k}:{text}' for k in found)}"
        )
    known = [name for group in KINDS.values() for name in registry.names(group)]
    hint = nearest(text, known, cutoff=0.7)  # a part of one's own is no misspelling
    raise ConfigError(f"{text}: no such predictor, source or link{hint}")


def _settings(kind: str, name: str, config: Path | None) -> tuple[dict[str, Any], Path]:
    """Return the part's configured settings, and the folder that relative paths start from."""
    key = "name" if kind == "predictor" else "kind"
    if config is None:
        data: dict[str, Any] = {key: name}
        if kind == "link":
            data["name"] = "conformance"
        required = {"room_from_source": {}, "rate_hz": 30.0}
        fields = registry.load(KINDS[kind], name).settings_model.model_fields
        missing = {k: v for k, v in required.items() if k in fields and fields[k].is_required()}
        return data | missing, Path.cwd()
    loaded = configuration.load(config)
    blocks = {"predictor": [loaded.node.predictor], "source": [loaded.node.source]}
    for block in blocks.get(kind, loaded.node.links):
        if block.get(key) == name:
            return dict(block), loaded.base_dir
    raise ConfigError(f"--config {config}: no {kind} {name}; name one of its own")


def _checked(
    *, kind: str, name: str, data: dict[str, Any], base_dir: Path, seconds: float
) -> list[CheckResult]:
    where = f"{kind} {name}"
    if kind == "predictor":
        from hri_predict.library.conformance.predictors import check_predictor

        model = registry.load("predictors", name).settings_model
        return check_predictor(name, validated(model, data, where).resolved(base_dir))
    if kind == "source":
        from hri_predict.library.conformance.sources import check_source

        settings = validated(registry.load("sources", name).settings_model, data, where)
        return check_source(name, settings, base_dir, seconds)
    from hri_predict.library.conformance.links import check_link

    link = validated(registry.load("links", name).settings_model, data, where)
    return check_link(name, link.resolved(base_dir))


def _table(title: str, findings: Sequence[CheckResult]) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("check")
    table.add_column("result")
    table.add_column("detail", overflow="fold")
    for f in findings:
        table.add_row(f.check, f"[{_STYLES[f.verdict]}]{f.verdict}[/]", escape(f.detail))
    return table
