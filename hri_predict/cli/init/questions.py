"""The prompts of ``init``; each answer is checked immediately."""

import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import typer
import yaml
from pydantic import ValidationError

from hri_predict.base.errors import ConfigError, HriPredictError, nearest
from hri_predict.base.files import YAML_ENDINGS, data_path, load_yaml, yaml_problem
from hri_predict.base.set_key import set_key
from hri_predict.base.settings import Mistake, Settings, mistakes
from hri_predict.cli.init.cell import PREDICTOR, Answers, link_block, robot_block, source_block
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.risk.settings import RISK_MODES

T = TypeVar("T")

NOT_IN_A_CELL = ("approach",)
"""Sources that only simulation supports."""
NONE = "none"
CONTROLLER_TIMES = {
    "silence_timeout_s": "Silence after which its controller stops by itself, s",
    "reaction_s": "Time from the receipt of an Advice until its controller starts to brake, s",
}
"""Keys of a link that only the user knows, with their prompts: distances depend on them."""


def say(text: str) -> None:
    """Print a line, wrapped between words to the terminal's width."""
    typer.echo(_wrapped(text))


def _wrapped(text: str) -> str:
    width = shutil.get_terminal_size().columns
    return textwrap.fill(text, width - 1, break_long_words=False, break_on_hyphens=False)


class Asker:
    """Gets an answer from its flag, the user or the default, in this order.

    Args:
        yes: use defaults without prompting.
    """

    def __init__(self, yes: bool) -> None:
        self._asks = not yes and sys.stdin.isatty()
        self._needs_flags = not yes and not self._asks

    @property
    def asks(self) -> bool:
        """Whether there is a user to ask."""
        return self._asks

    def take(
        self, flag: str, given: Any, *, question: str, default: Any, check: Callable[[str], T]
    ) -> T:
        """Return the checked answer.

        Raises:
            ConfigError: the flag's value is wrong.
        """
        if given is not None:
            try:
                return check(str(given))
            except HriPredictError as error:
                raise ConfigError(f"{flag} {given}: {error}") from error
        if not self._asks:
            return check(str(default))
        return self.ask(question, default, check)

    def need(self, flags: Mapping[str, Any]) -> None:
        """Check that there is a user to ask for the missing flags.

        Raises:
            ConfigError: there is none; names the flags.
        """
        missing = [flag for flag, value in flags.items() if not value]
        if self._needs_flags and missing:
            raise ConfigError(
                f"no terminal for prompts, and not given: {', '.join(missing)}; give them, or --yes"
                " for the defaults"
            )

    def ask(self, question: str, default: Any, check: Callable[[str], T]) -> T:
        """Ask until the answer is valid."""

        def checked(text: str) -> T:
            try:
                return check(str(text).strip())
            except HriPredictError as error:
                line = _wrapped(f"Error: {error}").removeprefix("Error: ")
                raise typer.BadParameter(line) from error

        answer: T = typer.prompt(question, default=default, value_proc=checked)
        return answer


def ask_robot(asker: Asker, robot: str | None, base_dir: Path) -> str:
    """Return the robot's model."""
    shipped = sorted(path.stem for path in data_path("robots").glob("*.yaml"))

    def check(text: str) -> str:
        robot_block(text, 1.0, base_dir)
        return text

    if asker.asks and robot is None:
        say(f"Robots: {', '.join(shipped)}; or the path of your own robot file.")
    return asker.take("--robot", robot, question="Robot", default="ur5e", check=check)


def ask_speed(asker: Asker, speed: float | None, robot: str, base_dir: Path) -> float:
    """Return the maximum speed of the robot's fastest point, m/s."""

    def check(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise ConfigError(f"'{text}' is not a number; give m/s, such as 1.0") from None
        robot_block(robot, value, base_dir)
        return value

    return asker.take(
        "--max-speed",
        speed,
        question="Its maximum speed in production, m/s",
        default=1.0,
        check=check,
    )


def ask_mode(asker: Asker, mode: str | None, changes: list[str]) -> str:
    """Ask for the mode of separation; no default allows robots to touch people."""

    def check(text: str) -> str:
        known = text
        if known not in RISK_MODES:
            raise ConfigError(f"unknown{nearest(known, RISK_MODES)} ({', '.join(RISK_MODES)})")
        if known == "hybrid" and not any(c.startswith("robots.0.contact=") for c in changes):
            raise ConfigError(
                "hybrid lets the robot touch people: start with predictive and see the guide on "
                "contact, or give --set robots.0.contact=allowed"
            )
        return known

    question = f"Mode ({', '.join(RISK_MODES)})"
    return asker.take("--mode", mode, question=question, default="predictive", check=check)


def ask_source(
    asker: Asker, *, kind: str | None, joint_map: str | None, changes: list[str], base_dir: Path
) -> dict[str, Any]:
    """Return the source's block with its joint map and its required keys."""
    kinds = [name for name in registry.names("sources") if name not in NOT_IN_A_CELL]

    def check(text: str) -> dict[str, Any]:
        if text not in kinds:
            close = nearest(text, kinds)
            raise ConfigError(f"unknown source '{text}'{close}; available: {', '.join(kinds)}")
        return source_block(text)

    if asker.asks and kind is None:
        say(f"Sources of people: {', '.join(kinds)}.")
    block = asker.take("--source", kind, question="Source", default="udp", check=check)
    model = registry.load("sources", block["kind"]).settings_model
    if "joint_map" in block and not any(c.startswith("source.joint_map=") for c in changes):
        block["joint_map"] = ask_joint_map(asker, joint_map, block["joint_map"], base_dir)
    elif joint_map is not None:
        raise ConfigError(
            f"--joint-map: has no effect with source {block['kind']}, or if --set names one; leave "
            "it out"
        )
    return completed(asker, model, block, where="source", changes=changes)


def ask_joint_map(asker: Asker, joint_map: str | None, default: str, base_dir: Path) -> str:
    """Return the map of the joints that the sender names."""

    def check(text: str) -> str:
        load_joint_map(str(base_dir / text) if text.endswith(YAML_ENDINGS) else text)
        return text

    if asker.asks and joint_map is None:
        named = [name for name in map_names() if name != "bvh"]
        say(
            f"Joint maps, after the sender's joints: {', '.join(named)}; or the path of your own "
            "file (docs/guides/live-sources.md)."
        )
    return asker.take("--joint-map", joint_map, question="Joint map", default=default, check=check)


def ask_predictor(asker: Asker, predictor: str | None, changes: list[str]) -> str:
    """Return the name of the predictor of people's motion."""

    def check(text: str) -> str:
        registry.load("predictors", text)
        return text

    if predictor is None and any(c.startswith("predictor.name=") for c in changes):
        return PREDICTOR  # replaced later
    if asker.asks and predictor is None:
        say(
            f"Predictors: {', '.join(registry.names('predictors'))}. average had the smallest "
            "error on validation recordings; constant_velocity needs no network "
            "(docs/guides/choose-a-predictor.md)."
        )
    return asker.take(
        "--predictor", predictor, question="Predictor", default=PREDICTOR, check=check
    )


def ask_links(asker: Asker, links: list[str], changes: list[str]) -> list[dict[str, Any]]:
    """Return the links' blocks, from the flags or from prompts."""
    found: list[dict[str, Any]] = []

    def check(text: str) -> dict[str, Any] | None:
        if text == NONE:
            return None
        return link_block(text, [link["name"] for link in found])

    if NONE in links and len(links) > 1:
        raise ConfigError(f"--link {NONE}: has no effect with other links; leave it out")
    if asker.asks and not links:
        kinds = [kind for kind in registry.names("links") if kind not in ("can", "serial")]
        say(
            "Links: can:INTERFACE:CHANNEL (can:socketcan:can0), serial:PORT, or a kind: "
            f"{', '.join(kinds)}."
        )
    flags = iter(links)
    while True:
        given = next(flags, NONE if links else None)
        question = f"Link {len(found) + 1} ('{NONE}' ends)"
        block = asker.take("--link", given, question=question, default=NONE, check=check)
        if block is None:
            return found
        where = f"links.{len(found)}"
        model = registry.load("links", block["kind"]).settings_model
        block = completed(asker, model, block, where=where, changes=changes)
        found.append(with_controller_times(asker, model, block))


def with_controller_times(
    asker: Asker, model: type[Settings], block: dict[str, Any]
) -> dict[str, Any]:
    """Return ``block`` with its controller's times, if a user can state them.

    A time not stated is left out, so ``check`` reports it.
    """
    missing = {key: text for key, text in CONTROLLER_TIMES.items() if key not in block}
    if not asker.asks or not missing:
        return block
    say(
        "Measure the controller's times (docs/guides/plc.md): they determine how near people may "
        "be."
    )
    for key, question in missing.items():

        def check(text: str, key: str = key) -> Any:
            value = _value(text)
            try:
                model.model_validate(block | {key: value})
            except ValidationError as error:
                raise ConfigError(mistakes(error, model, block)[0].text) from error
            return value

        block[key] = asker.ask(question, model.model_fields[key].get_default(), check)
    return block


def completed(
    asker: Asker, model: type[Settings], block: dict[str, Any], *, where: str, changes: list[str]
) -> dict[str, Any]:
    """Return ``block`` with the changes from ``--set`` and the keys still required.

    Raises:
        ConfigError: a key is missing or wrong, and there is no user to ask.
    """
    for change in [c for c in changes if c.startswith(f"{where}.")]:
        set_key(block, change.removeprefix(f"{where}."))
    while (wrong := _first_mistake(model, block)) is not None:
        if not asker.asks:
            at = f"{where}.{wrong.path}" if wrong.path else where
            key = wrong.path if wrong.path else "KEY"
            raise ConfigError(f"{at}: {wrong.text}; give --set {where}.{key}=VALUE")
        known = len(wrong.keys) == 1 and str(wrong.keys[0]) in model.model_fields
        say(f"{where}.{wrong.path}: {wrong.text}" if wrong.path else f"{where}: {wrong.text}")
        if known:
            key = str(wrong.keys[0])
            block[key] = asker.ask(f"{where}.{key}", None, _value)
        else:
            set_key(block, asker.ask(f"{where}: key=value", None, str))
    return block


def _first_mistake(model: type[Settings], block: dict[str, Any]) -> Mistake | None:
    try:
        model.model_validate(block)
    except ValidationError as error:
        return mistakes(error, model, block)[0]
    return None


def _value(text: str) -> Any:
    try:
        return load_yaml(text)
    except (yaml.YAMLError, RecursionError) as error:
        why = yaml_problem(error)
        raise ConfigError(f"'{text}' is not valid YAML{why}; quote it") from error


def ask_all(
    asker: Asker,
    *,
    base_dir: Path,
    simulated: bool | None,
    robot: str | None,
    max_speed: float | None,
    source: str | None,
    joint_map: str | None,
    links: list[str],
    mode: str | None,
    predictor: str | None,
    changes: list[str],
) -> Answers:
    """Ask all questions in order, except those answered by a flag.

    Raises:
        ConfigError: a flag is wrong, or there is no user to ask.
    """
    if simulated is None:
        simulated = asker.asks and typer.confirm(
            "Simulate the robot and a person, without hardware?", default=False
        )
    needed = {"--robot": robot, "--max-speed": max_speed, "--mode": mode}
    asker.need(needed if simulated else needed | {"--source": source, "--link": links})
    model = ask_robot(asker, robot, base_dir)
    return Answers(
        robot=model,
        max_speed_m_s=ask_speed(asker, max_speed, model, base_dir),
        source={}
        if simulated
        else ask_source(
            asker, kind=source, joint_map=joint_map, changes=changes, base_dir=base_dir
        ),
        links=[] if simulated else ask_links(asker, links, changes),
        mode=ask_mode(asker, mode, changes),
        predictor=ask_predictor(asker, predictor, changes),
        simulated=simulated,
    )
