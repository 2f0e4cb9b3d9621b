"""Parsing and formatting of times."""

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta

from hri_predict.base.errors import ConfigError
from hri_predict.explaining.recordings import Recordings

NS = 1_000_000_000
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2})(?:\.(\d{1,9}))?)?Z?")
_DATED = re.compile(
    r"(\d{4}-\d{2}-\d{2})[T ](\d{1,2}:\d{2}(?::\d{2}(?:\.\d{1,9})?)?) ?(Z|[+-]\d{2}:?\d{2})?"
)
_SECONDS = re.compile(r"\d{1,9}(?:\.(\d{1,9}))?")
_FIRST_S = round(datetime(1, 1, 1, tzinfo=UTC).timestamp())
_LAST_S = round(datetime(9999, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp())
_HINT = "write 14:03:07 (UTC), 2026-03-09T14:03:07, or seconds since the start such as 12.4"


@dataclass(frozen=True, slots=True)
class AskedTime:
    """The time span given by a user: ``14:03:07`` is the whole second, ``14:03`` the minute."""

    start_ns: int
    width_ns: int


def asked(text: str, recordings: Recordings, flag: str = "--at") -> AskedTime:
    """Read a time.

    Raises:
        ConfigError: the text is not a time, has no date where one is needed, or the recordings have
            no UTC.
    """
    text = text.strip()
    if match := _SECONDS.fullmatch(text):
        width_ns = _width(match[1]) if match[1] else NS
        return AskedTime(recordings.start_ns + round(float(text) * NS), width_ns)
    where, match = f"{flag} {text}", _DATED.fullmatch(text)
    if match is None and not _CLOCK.fullmatch(text):
        raise ConfigError(f"{where}: not a time; {_HINT}")
    since, width_ns = _of_day(match[2] if match else text, where)
    if not recordings.info.has_utc:
        raise ConfigError(
            f"{where}: these recordings have no UTC (a virtual run, or an old format); write "
            f"seconds since the start, such as 12.4"
        )
    if match:
        return AskedTime(_midnight(match[1], where) + since - _zone(match[3]), width_ns)
    return AskedTime(_on_one_day(since, recordings, where), width_ns)


def shown(utc_ns: int, recordings: Recordings, digits: int = 1) -> str:
    """Return ``14:03:07.2``, or ``12.4 s`` since the start if there is no UTC."""
    if not recordings.info.has_utc:
        return f"{(utc_ns - recordings.start_ns) / NS:.{digits}f} s"
    seconds, rest = divmod(utc_ns, NS)
    text = f"{datetime.fromtimestamp(seconds, UTC):%H:%M:%S}"
    return f"{text}.{rest * 10**digits // NS:0{digits}d}" if digits else text


def dated(utc_ns: int, recordings: Recordings) -> str:
    """Return the time with its date, as accepted by ``--at``."""
    if not recordings.info.has_utc:
        return f"{(utc_ns - recordings.start_ns) / NS:.2f}"
    seconds, rest = divmod(utc_ns, NS)
    at = datetime.fromtimestamp(min(max(seconds, _FIRST_S), _LAST_S), UTC)
    return f"{at:%Y-%m-%dT%H:%M:%S}.{rest // 10_000_000:02d}"


def _width(decimals: str) -> int:
    return NS // 10 ** len(decimals)


def _of_day(text: str, where: str) -> tuple[int, int]:
    match = _CLOCK.fullmatch(text)
    assert match is not None
    hours, minutes, seconds, decimals = match.groups()
    if int(hours) > 23 or int(minutes) > 59 or int(seconds or 0) > 59:
        raise ConfigError(f"{where}: not a time of day; {_HINT}")
    whole = (int(hours) * 60 + int(minutes)) * 60 + int(seconds or 0)
    part = round(float(f"0.{decimals}") * NS) if decimals else 0
    width_ns = 60 * NS if seconds is None else _width(decimals or "")
    return whole * NS + part, width_ns


def _midnight(date: str, where: str) -> int:
    try:
        return round(datetime.fromisoformat(date).replace(tzinfo=UTC).timestamp()) * NS
    except (ValueError, OverflowError) as error:
        raise ConfigError(f"{where}: not a date; {_HINT}") from error


def _zone(text: str | None) -> int:
    if text in (None, "", "Z"):
        return 0
    sign = -1 if text.startswith("-") else 1
    digits = text[1:].replace(":", "")
    return sign * (int(digits[:2]) * 60 + int(digits[2:])) * 60 * NS


def _on_one_day(since_ns: int, recordings: Recordings, where: str) -> int:
    """Return the only moment with this time of day in the recordings' range."""
    start_ns, end_ns = recordings.start_ns, recordings.end_ns()
    first = datetime.combine(datetime.fromtimestamp(start_ns // NS, UTC), time(0), UTC)
    days = math.ceil((end_ns - start_ns) / (86_400 * NS)) + 2
    moments = [round((first + timedelta(days=d)).timestamp()) * NS + since_ns for d in range(days)]
    # The last message may be up to a second before what somebody writes in whole seconds.
    there = [ns for ns in moments if start_ns - 60 * NS <= ns <= end_ns]
    if not there:
        raise ConfigError(
            f"{where}: not recorded; these recordings are from {dated(start_ns, recordings)} to "
            f"{dated(end_ns, recordings)} UTC"
        )
    if len(there) > 1:
        raise ConfigError(
            f"{where}: on which day? write the date too: {dated(there[0], recordings)} to "
            f"{dated(there[-1], recordings)}"
        )
    return there[0]
