"""Arbitrary text as one line of printable characters, or as one level of an MQTT topic."""

from urllib.parse import quote

MAX_LINE = 1000
"""Maximum number of characters; the node's alerts are less than half as long."""


def one_line(text: str, limit: int = MAX_LINE) -> str:
    """Return ``text`` on one line: each unprintable character, such as a line break, becomes a
    space.

    The names of robots or zones could otherwise add headers to an e-mail, or lines to a log.
    """
    line = "".join(c if c.isprintable() else " " for c in text)
    return line if len(line) <= limit else line[: limit - 3] + "..."


def ascii_word(text: str, limit: int) -> str:
    """``text`` as printable ASCII without spaces, at most ``limit`` long; ``-`` where it is empty.

    RFC 5424 requires this of the fields of a syslog header (section 6).
    """
    return "".join(c if "!" <= c <= "~" else "_" for c in text)[:limit] or "-"


def topic_level(name: str) -> str:
    """``name`` as one level of an MQTT topic; different names give different levels.

    Characters with a meaning in topics (``/``, ``+``, ``#``), ``%`` and unprintable characters are
    percent-encoded as in a URL. MQTT 3.1.1, section 4.7.
    """
    return "".join(
        c if c.isprintable() and c not in "/+#%" else quote(c, safe="", errors="surrogatepass")
        for c in name
    )
