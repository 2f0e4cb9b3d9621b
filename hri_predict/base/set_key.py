"""``--set KEY=VALUE`` on the command line: replaces one value of a configuration."""

import itertools
from typing import Any

import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import load_yaml, yaml_problem
from hri_predict.base.quantities.whole import whole


def set_key(data: dict[str, Any], change: str) -> None:
    """Set one ``key.key=value`` from the command line, with the value written as in YAML.

    Raises:
        ConfigError: it has another form; one line with the remedy.
    """
    keys, equals, text = change.partition("=")
    path = keys.strip().split(".")
    if not equals or not all(path):
        raise ConfigError(f"--set {change}: write it as key=value, such as train.epochs=20")
    try:
        value = load_yaml(text)
    except (yaml.YAMLError, RecursionError) as error:
        why = yaml_problem(error)
        raise ConfigError(f"--set {change}: its value is not valid YAML{why}; quote it") from error
    at: Any = data
    for key, after in itertools.pairwise(path):
        empty: Any = [] if after.isdecimal() else {}
        at = _entry(at, key) if isinstance(at, list) else at.setdefault(key, empty)
        if not isinstance(at, dict) and not (isinstance(at, list) and _entry(at, after)):
            raise ConfigError(f"--set {change}: '{key}' has no keys; see the configuration")
    at[path[-1]] = value


def _entry(entries: list[Any], index: str) -> Any:
    """Return the entry of a list at ``index``, or ``None``."""
    number = whole(index)
    return entries[number] if number is not None and number < len(entries) else None
