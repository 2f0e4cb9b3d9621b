"""Generated parts of a file, between two markers; the surrounding text is kept."""

import re
from collections.abc import Callable, Mapping

from hri_predict.base.errors import ConfigError

Blocks = Mapping[str, Callable[[], str]]

DOCUMENT = r"(<!-- table: ([\w ]+) -->\n).*?(<!-- end -->)"
CODE = (
    r"([/(]\* generated: begin ([\w ]+?) \(renew: [^)]*\) \*[/)]\n).*?"
    r"([/(]\* generated: end \*[/)])"
)


def renewed(text: str, blocks: Blocks, marks: str = CODE) -> str:
    """Return the text with each marked part generated again.

    Raises:
        ConfigError: no function generates a part of this name.
    """

    def part(match: re.Match[str]) -> str:
        name = match[2]
        if name not in blocks:
            kind = "table" if marks == DOCUMENT else "block"
            raise ConfigError(f"no {kind} '{name}'; available: {', '.join(sorted(blocks))}")
        return f"{match[1]}{blocks[name]()}{match[3]}"

    return re.sub(marks, part, text, flags=re.DOTALL)


def names(text: str, marks: str = CODE) -> list[str]:
    """Return the names of the marked parts of a text."""
    return [match[2] for match in re.finditer(marks, text, flags=re.DOTALL)]
