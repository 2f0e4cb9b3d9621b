"""YAML as its writer meant it: nothing is taken twice, nothing grows when it is read.

PyYAML's safe loader keeps the last of two equal keys without a word, unfolds aliases to any size,
and lets the errors of Python's own conversions through.
"""

from typing import Any

import yaml

MAX_CHARACTERS = 1_000_000  # of a file; the longest that is shipped has 8000
MAX_VALUES = 100_000  # with every alias written out
MAX_SCALAR = 2000  # characters of one value; half of the longest path


def load_yaml(text: str) -> Any:
    """Read one YAML document of plain values.

    Raises:
        yaml.YAMLError: not YAML, a key that stands twice in one mapping, an alias within itself or
            a document that aliases blow up, or a scalar that is too long, holds a control character
            or is not what its form or tag says.
        RecursionError: nested too deeply.
    """
    return yaml.load(text, Loader=_Loader)  # derived from the safe loader


class _Loader(yaml.SafeLoader):
    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _check(node, {})
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, KeyError, AttributeError, TypeError, OverflowError) as error:
            kind = node.tag.rsplit(":", 1)[-1]
            raise _error(f"{_short(node)} is not a valid {kind}", node) from error


def _check(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Values in ``node`` with every alias written out; ``sizes`` of nodes that were seen (0: is
    being looked into)."""
    if isinstance(node, yaml.ScalarNode):
        _check_scalar(node)
        return 1
    if id(node) in sizes:
        if sizes[id(node)] == 0:
            raise _error("an alias stands within what it stands for", node)
        return sizes[id(node)]
    sizes[id(node)] = 0
    if isinstance(node, yaml.MappingNode):
        _check_keys(node)
        children = [child for pair in node.value for child in pair]
    else:
        children = node.value
    size = 1 + sum(_check(child, sizes) for child in children)
    if size > MAX_VALUES:
        raise _error(f"more than {MAX_VALUES} values, with its aliases written out", node)
    sizes[id(node)] = size
    return size


def _check_scalar(node: yaml.ScalarNode) -> None:
    if len(node.value) > MAX_SCALAR:
        raise _error(f"a value of more than {MAX_SCALAR} characters", node)
    if any((ord(c) < 32 and c not in "\n\t") or ord(c) == 127 for c in node.value):
        raise _error(f"{_short(node)} holds a control character", node)


def _check_keys(node: yaml.MappingNode) -> None:
    first: dict[str, int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            continue
        line = key.start_mark.line + 1
        if key.value in first:
            raise _error(f"key {_short(key)} stands already in line {first[key.value]}", key)
        first[key.value] = line


def _short(node: yaml.Node) -> str:
    text = repr(node.value) if isinstance(node, yaml.ScalarNode) else node.tag
    return text if len(text) < 60 else text[:57] + "..."


def _error(problem: str, node: yaml.Node) -> yaml.YAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
