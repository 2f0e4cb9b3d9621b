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
        at = at[_index(at, key, change)] if isinstance(at, list) else at.setdefault(key, empty)
        if isinstance(at, list):
            _index(at, after, change, key)
        elif not isinstance(at, dict):
            raise ConfigError(f"--set {change}: '{key}' has no keys; see the configuration")
    at[_index(at, path[-1], change) if isinstance(at, list) else path[-1]] = value


def _index(entries: list[Any], index: str, change: str, key: str = "") -> int:
    """Return the number of an entry that a list has.

    Raises:
        ConfigError: it has no such entry.
    """
    number = whole(index)
    if number is None or number >= len(entries):
        has = f"entries 0 to {len(entries) - 1}" if entries else "no entries yet"
        raise ConfigError(f"--set {change}: '{key}' is a list and has {has}; name one of them")
    return number
