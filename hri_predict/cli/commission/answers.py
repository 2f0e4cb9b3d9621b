"""Answers for the steps: from a YAML file, from prompts, or by default."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, field_validator

from hri_predict.base.errors import ConfigError, first_line
from hri_predict.base.files import load_yaml, read_yaml
from hri_predict.base.settings import MIN_SPEED_M_S, Point, Settings, Vector3, validated
from hri_predict.cli.register.points import ask, point_from, say
from hri_predict.commissioning.report import Signature, Text
from hri_predict.commissioning.walk import LEAST_COVERAGE

MAX_TEXT = 2000
"""Longest text of a report; see ``Text``."""
StepName = Literal["registration", "echo", "stopping", "walk"]
Milliseconds = Annotated[float, Field(ge=0.001, le=10_000)]


class RegistrationAnswers(Settings):
    """Points to touch."""

    points: list[Vector3] = Field([], max_length=50, description="metres, room; at least three")
    joint: str | None = Field(None, description="the joint that touches; default: a hand")
    seconds: float = Field(2.0, ge=0.5, le=30, description="seconds to observe each point")
    every_s: float | None = Field(
        None,
        ge=0.1,
        le=600,
        description="do not prompt; move to the next point after this many seconds",
    )
    write: StrictBool = Field(
        False, description="write the best-fitting pose into source.room_from_source"
    )


class RoundTrips(Settings):
    """Round-trip times measured by the controller."""

    p50_ms: Milliseconds
    p99_ms: Milliseconds
    max_ms: Milliseconds

    @field_validator("max_ms")
    @classmethod
    def _in_order(cls, value: float, info: Any) -> float:
        lower = [info.data[key] for key in ("p50_ms", "p99_ms") if key in info.data]
        if any(value < each for each in lower):
            raise ValueError("max_ms is below p50_ms or p99_ms")
        return value


class EchoAnswers(Settings):
    """Duration of the measurement, and values measured at the controllers."""

    seconds: float = Field(30.0, ge=2, le=3600)
    measured: dict[str, RoundTrips] = Field({}, description="link's name -> its round trips")


class StopAnswer(Settings):
    """A stop measured by other means, from the onset of braking to rest."""

    robot: str
    speed_m_s: float = Field(ge=MIN_SPEED_M_S, le=20)
    time_s: float = Field(ge=0.001, le=60)
    distance_m: float = Field(ge=1e-5, le=60)


class StoppingAnswers(Settings):
    """The stopping test, run by the node or measured by the integrator."""

    cell_is_clear: StrictBool = Field(
        False, description="the cell is empty, and a person holds the emergency stop"
    )
    speeds_m_s: list[Annotated[float, Field(ge=MIN_SPEED_M_S, le=20)]] = Field(
        [], max_length=20, description="default: a quarter, half, three quarters and all of "
        "max_speed_m_s"
    )  # fmt: skip
    repeats: int = Field(3, ge=1, le=50, strict=True)
    wait_s: float = Field(
        10.0, ge=0.5, le=600, description="time limit for a robot to reach a speed"
    )
    measured: list[StopAnswer] = Field(
        [], max_length=500, description="replace the node's measurements"
    )


class WalkAnswers(Settings):
    """The walk test."""

    seconds: float = Field(60.0, ge=2, le=3600)
    cell_m: float = Field(0.25, ge=0.05, le=2)
    least_coverage: float = Field(
        LEAST_COVERAGE, ge=0, le=1, description="share of the relevant floor area to cover"
    )
    exclude: list[Annotated[list[Point], Field(min_length=3, max_length=100)]] = Field(
        [], max_length=100, description="polygons where no person can stand: machines, walls"
    )
    shadow: StrictBool = Field(True, description="links send only unknown, so that no robot moves")
    virtual: StrictBool = Field(
        False, description="run as fast as possible; only with simulated people and controllers"
    )


class Answers(Settings):
    """The file of ``--answers``."""

    by: Text = Field("", description="name of the person who did it")
    registration: RegistrationAnswers = RegistrationAnswers()
    echo: EchoAnswers = EchoAnswers()
    stopping: StoppingAnswers = StoppingAnswers()
    walk: WalkAnswers = WalkAnswers()
    notes: list[Text] | None = Field(None, max_length=100, description="open notes")
    signatures: list[Signature] | None = Field(None, max_length=20)
    skip: dict[StepName, Annotated[Text, Field(min_length=1)]] = Field(
        {}, description="step -> reason for skipping it"
    )


def read_answers(path: Path | None) -> Answers:
    """Return the answers of a file, or the defaults without one.

    Raises:
        ConfigError: the file is wrong; one line with the key and the remedy.
    """
    if path is None:
        return Answers()
    return validated(Answers, read_yaml(path, "answers"), f"answers {path}")


def asked(answers: Answers, step: str) -> Answers | None:
    """Prompt for the answers that a step needs; return ``None`` if the user quits.

    Raises:
        ConfigError: the input ended.
    """
    while (line := ask(f"{step}: do it, skip it, or quit? [D/s/q]").lower()) not in _CHOICES:
        say("d, s or q")
    if line == "q":
        return None
    if line == "s":
        while not (note := ask_text("Reason for skipping it?")):
            pass
        return answers.model_copy(update={"skip": {**answers.skip, step: note}})
    return _QUESTIONS[step](answers)


def ask_text(question: str) -> str:
    """Prompt for a text, again if it is too long for the report.

    Raises:
        ConfigError: the input ended.
    """
    while len(line := ask(question)) > MAX_TEXT:
        say(f"{len(line)} characters; at most {MAX_TEXT}")
    return line


_CHOICES = ("", "d", "s", "q")


def _registration(answers: Answers) -> Answers:
    write = ask("Write the best-fitting pose into the configuration? [y/N]").lower() in _YES
    mine = answers.registration.model_copy(update={"write": write})
    return answers.model_copy(update={"registration": mine})


def _echo(answers: Answers) -> Answers:
    seconds = _value("Duration of the measurement, seconds?", answers.echo, "seconds")
    measured = dict(answers.echo.measured)
    say("Round-trip times measured by a real controller (from sending a RobotState to its echo).")
    while line := ask("Link's name, p50, p99 and max in ms, with commas; empty when done:"):
        try:
            name, p50, p99, most = (part.strip() for part in line.split(","))
            row = {"p50_ms": float(p50), "p99_ms": float(p99), "max_ms": float(most)}
            measured[name] = validated(RoundTrips, row, name)
        except (ValueError, ConfigError) as error:
            say(f"like plc, 9, 14, 16: {error}")
    echo = seconds.model_copy(update={"measured": measured})
    return answers.model_copy(update={"echo": echo})


def _stopping(answers: Answers) -> Answers:
    say("Every robot moves now, up to its highest speed, where the node permits it.")
    clear = ask("Is the cell empty, and is someone holding the emergency stop? [y/N]")
    mine = _value("Speeds, m/s, such as [0.25, 0.5] (empty: by default):", answers.stopping,
                  "speeds_m_s")  # fmt: skip
    mine = mine.model_copy(update={"cell_is_clear": clear.lower() in _YES})
    return answers.model_copy(update={"stopping": mine})


def _walk(answers: Answers) -> Answers:
    mine = _value("Duration of the walk, seconds?", answers.walk, "seconds")
    mine = _value(
        "Polygons where no person can stand, [[[x, y], ...]] (empty: none):", mine, "exclude"
    )
    return answers.model_copy(update={"walk": mine})


_YES = ("y", "yes")
_QUESTIONS: dict[str, Callable[[Answers], Answers]] = {
    "registration": _registration,
    "echo": _echo,
    "stopping": _stopping,
    "walk": _walk,
}


def _value(question: str, settings: Any, key: str) -> Any:
    """Return the settings with a prompted value in YAML; an empty answer changes nothing."""
    while line := ask(f"{question} [{getattr(settings, key)}]"):
        try:
            data = settings.model_dump() | {key: load_yaml(line)}
            return validated(type(settings), data, "answer")
        except Exception as error:  # YAML has errors of many kinds; all mean: once more
            say(f"not understood: {first_line(error)}")
    return settings


def ask_points(least: int) -> list[list[float]]:
    """Ask for points until an empty line.

    Raises:
        ConfigError: the input ended.
    """
    points: list[list[float]] = []
    while True:
        end = "; empty when done" if len(points) >= least else ""
        line = ask(f"Point {len(points) + 1}: its x,y,z in the room (m{end}):")
        if not line and len(points) >= least:
            return points
        try:
            points.append([float(v) for v in point_from(line, 3, "point")])
        except ConfigError as error:
            say(str(error))
