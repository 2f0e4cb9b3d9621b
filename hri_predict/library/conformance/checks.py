"""Runs checks: functions that return a one-line finding, or raise a violation of the contract."""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from hri_predict.base.errors import ConfigError, failure
from hri_predict.base.settings import Settings, validated

Verdict = Literal["pass", "fail", "skipped"]
T = TypeVar("T")

SOON_S = 0.05
"""Maximum time of a non-blocking call, except for one call in a hundred: machines pause."""


NOTHING_CAME = "no scene arrived"
"""Prefix of a check's reason if a source delivered no scene."""


class Broken(Exception):
    """The part violates its contract; the text has the details."""


class Skipped(Exception):
    """The check is not possible here, or not on this part; the text has the reason."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check.

    Attributes:
        check: requirement of the contract, in a few words.
        verdict: result of the check.
        detail: the findings, the violation of the contract, or why it was not checked.
    """

    check: str
    verdict: Verdict
    detail: str


Check = Callable[[T], str]


def run_checks(checks: Sequence[Check[T]], part: T) -> list[CheckResult]:
    """Run all checks on one part; a check that raises has failed, and the next one runs.

    Logging is suppressed, because the checks provoke errors that parts would log.
    """
    logging.disable(logging.WARNING)
    try:
        return [_judged(check, part) for check in checks]
    finally:
        logging.disable(logging.NOTSET)


def _judged(check: Check[T], part: T) -> CheckResult:
    name = check.__name__.replace("_", " ")
    try:
        return CheckResult(name, "pass", check(part))
    except Broken as error:
        return CheckResult(name, "fail", str(error))
    except Skipped as error:
        return CheckResult(name, "skipped", str(error))
    except BaseException as error:  # a third party's code may fail in any way
        failure(error)
        lines = str(error).splitlines() or [""]
        return CheckResult(name, "fail", f"raised {type(error).__name__}: {lines[0]}")


def demand(holds: bool, otherwise: str) -> None:
    """Continue only if the condition is true.

    Raises:
        Broken: it is false.
    """
    if not holds:
        raise Broken(otherwise)


def demand_soon(seconds: Sequence[float], what: str) -> str:
    """Continue only if none of these calls blocked; return the maximum duration.

    Raises:
        Broken: more than one in a hundred, and more than one call, took longer than ``SOON_S``.
    """
    slow = sum(s > SOON_S for s in seconds)
    longest_ms = 1e3 * max(seconds, default=0.0)
    demand(
        slow <= max(1, len(seconds) // 100),
        f"{what} blocks: {slow} of {len(seconds)} calls took more than {1e3 * SOON_S:.0f} ms, "
        f"the longest {longest_ms:.0f} ms",
    )
    return f"longest {what} {longest_ms:.1f} ms"


def refuses_nonsense(
    model: type[Settings], data: dict[str, Any], wrong: Iterable[dict[str, Any]]
) -> str:
    """Check that invalid settings are refused, each with one line.

    Args:
        model: the part's settings model.
        data: valid settings.
        wrong: changes that each make them invalid, for any part.

    Raises:
        Broken: some are accepted, or refused with an error other than ``ConfigError``.
    """
    required = [name for name, field in model.model_fields.items() if field.is_required()]
    tried = [data | change for change in ({"no_such_key_anywhere": 1}, *wrong)]
    tried += [{k: v for k, v in data.items() if k != name} for name in required]
    for settings in tried:
        changed = [k for k in settings if k not in data or settings[k] is not data[k]]
        where = ", ".join(f"{k}: {settings[k]!r}" for k in changed) or "a required key is missing"
        try:
            validated(model, settings, "settings")
        except ConfigError as error:
            demand("\n" not in str(error), f"{where}: the message has more than one line")
            continue
        except BaseException as error:
            failure(error)
            raise Broken(
                f"{where}: raises {type(error).__name__}, not a ConfigError: let a validator "
                f"raise ValueError"
            ) from error
        raise Broken(f"{where}: is accepted; derive the settings from hri_predict's")
    return f"{len(tried)} kinds of invalid settings refused"
