"""Text of any content as one line of printable characters, and as one level of an MQTT topic."""

from urllib.parse import quote

MAX_LINE = 1000
"""Characters: no alert that the node makes is half as long."""


def one_line(text: str, limit: int = MAX_LINE) -> str:
    """``text`` on one line: what does not print (line breaks among it) becomes a space.

    The names of robots or zones could otherwise add headers to an e-mail, or lines to a log.
    """
    line = "".join(c if c.isprintable() else " " for c in text)
    return line if len(line) <= limit else line[: limit - 3] + "..."


def ascii_word(text: str, limit: int) -> str:
    """``text`` as printable ASCII without spaces, at most ``limit`` long; ``-`` where it is empty.

    So RFC 5424 wants the fields of a syslog header (section 6).
    """
    return "".join(c if "!" <= c <= "~" else "_" for c in text)[:limit] or "-"


def topic_level(name: str) -> str:
    """``name`` as one level of an MQTT topic; two names never give the same.

    The characters that mean something in a topic (``/``, ``+``, ``#``), ``%`` and what does not
    print are written as in a URL. MQTT 3.1.1, section 4.7.
    """
    return "".join(
        c if c.isprintable() and c not in "/+#%" else quote(c, safe="", errors="surrogatepass")
        for c in name
    )
