"""``alerts``: show the configured alert hooks, and test each one."""

import json
import threading
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, failure
from hri_predict.cli.common import JsonOption
from hri_predict.operation.alerting.alert import Trial
from hri_predict.operation.alerting.hook import failure_text, without
from hri_predict.operation.alerting.kinds import sender_of
from hri_predict.operation.alerting.sender import HookContext, Sender
from hri_predict.operation.alerting.settings import HookSettings
from hri_predict.run import config as configuration
from hri_predict.run.config import Config

SLACK_S = 2.0
"""Extra time allowed beyond the hook's own limit, for name lookup and TLS."""


def alerts(
    config: Annotated[Path, typer.Argument(help="The node's YAML configuration.")],
    test: Annotated[
        bool, typer.Option("--test", help="Send a test alert through each hook.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show the configured alert hooks; with --test, try each one and print its response.

    Exit status 1 if one fails. A test alert is marked as a test and does not refer to any robot.

    Example: hri-predict alerts cell.yaml --test
    """
    loaded = configuration.load(config)
    hooks = loaded.node.alerts.hooks
    if not hooks:
        raise ConfigError(f"{loaded.path}: alerts: no hooks; add one under alerts.to")
    found = try_hooks(loaded) if test else hook_facts(loaded)
    if as_json:
        print(json.dumps(found))
    else:
        for hook in found:
            print("; ".join(filter(None, (_head(hook), *hook["notes"]))))
    if not all(hook.get("ok", True) for hook in found):
        raise typer.Exit(1)


def hook_facts(config: Config) -> list[dict[str, Any]]:
    """Return the name, kind and warnings of each hook. Each is built, but no connection is opened.

    Raises:
        ConfigError: a secret, a certificate or a package is missing.
    """
    for hook in config.node.alerts.hooks:
        sender_of(hook, _place(config))
    return [
        {"name": hook.label, "kind": hook.kind, "notes": hook.notes}
        for hook in config.node.alerts.hooks
    ]


def try_hooks(config: Config) -> list[dict[str, Any]]:
    """Send a test alert through all hooks in parallel; ``ok`` and ``answer`` hold each result.

    Raises:
        ConfigError: a secret, a certificate or a package is missing.
    """
    facts = hook_facts(config)
    place = _place(config)
    trials = [_Trying(hook, sender_of(hook, place)) for hook in config.node.alerts.hooks]
    for trial in trials:
        trial.start()
    return [fact | trial.result() for fact, trial in zip(facts, trials, strict=True)]


class _Trying(threading.Thread):
    """One attempt, limited in time."""

    def __init__(self, hook: HookSettings, sender: Sender) -> None:
        super().__init__(daemon=True)
        self._sender, self._limit_s = sender, hook.timeout_s + SLACK_S
        self._until = time.monotonic() + self._limit_s
        self._result: dict[str, Any] = {}

    def run(self) -> None:
        at = datetime.now(UTC).isoformat(timespec="milliseconds")
        try:
            answer = self._sender.send(Trial(at=at), 0)
            self._result = {"ok": True, "answer": answer}
            self._sender.close()
        except BaseException as error:  # whatever a library raises, the others are tried
            text = without(self._sender.secrets, failure_text(failure(error)))
            self._result = self._result or {"ok": False, "answer": text}

    def result(self) -> dict[str, Any]:
        """Return the response, within the time limit."""
        self.join(max(self._until - time.monotonic(), 0.0))
        self._sender.abort()
        return self._result or {"ok": False, "answer": f"no answer within {self._limit_s:g} s"}


def _place(config: Config) -> HookContext:
    return HookContext(base_dir=config.base_dir, cell=config.path.stem, live=False)


def _head(hook: dict[str, Any]) -> str:
    if "ok" not in hook:
        return str(hook["name"])
    return f"{hook['name']}: {'ok' if hook['ok'] else 'FAILED'}: {hook['answer']}"
