"""The node's YAML configuration, validated before anything starts."""

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from hri_predict.base.errors import ConfigError, HriPredictError, nearest, nearest_file
from hri_predict.base.files import data_path, line_of, load_yaml, read_text, read_yaml
from hri_predict.base.machine.realtime import RealtimeSettings
from hri_predict.base.quantities.whole import whole
from hri_predict.base.settings import Abbreviated, name_problem, validated
from hri_predict.contracts import registry
from hri_predict.contracts.link import ChecksTogether, LinkSettings
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.contracts.source import SourceSettings
from hri_predict.node.memory import StateSettings
from hri_predict.operation.evidence.settings import EvidenceSettings
from hri_predict.operation.foxglove.settings import FoxgloveSettings
from hri_predict.operation.monitoring.alerts import AlertSettings
from hri_predict.operation.service.settings import LogSettings, MetricsSettings
from hri_predict.people.settings import PeopleSettings
from hri_predict.protocol.discovery.services import DiscoverySettings
from hri_predict.recording.folder.settings import RecordSettings
from hri_predict.recording.mcap.schemas import advice_topic
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotSettings
from hri_predict.run.mistakes import Keys, Mistakes, place, scalars
from hri_predict.run.rates import RateSettings

MAX_ROBOTS = 8
MAX_LINKS = 32  # each link has its own thread
MAX_ZONES = 32
"""Maximum number of named zones. Each zone near people takes 0.5 ms of a tick with one or two
people, and 2 ms with eight (measured: 200 zones of 4 to 12 corners in a room of 10 m).
"""


_KEYS = re.compile(r"[a-z_]+(\.\w+)*")
_FILES = ("path", "joint_map", "weights", "calibration", "table", "file", "folder", "report")
"""Keys whose values are files or shipped names. Robots name their own (``each_robot``)."""


class CommissioningSettings(Abbreviated):
    """Location of the commissioning report; a plain text is its path."""

    report: str = Field(
        min_length=1, description="report.json of hri-predict commission, or a folder of reports"
    )


class NodeSettings(RateSettings):
    """The top level of a configuration; ``source``, ``predictor`` and links are checked by kind."""

    source: dict[str, Any] = Field(
        description="source of scenes: a tracker, a recording or simulated people"
    )
    predictor: dict[str, Any] = Field(
        {"name": "constant_velocity"}, description="prediction of people's motion"
    )
    people: PeopleSettings = Field(
        PeopleSettings(), description="rules for tracking, losing and finding people"
    )
    robots: list[RobotSettings] = Field(
        min_length=1, max_length=MAX_ROBOTS, description="the robots to advise"
    )
    risk: RiskSettings = Field(
        RiskSettings(), description="rules that judge separation and change levels"
    )
    zones: list[NamedZoneSettings] = Field(
        [],
        max_length=MAX_ZONES,
        description="named zones and what they request while a person is inside",
    )
    links: list[dict[str, Any]] = Field(
        [], max_length=MAX_LINKS, description="links to the robots' controllers"
    )
    realtime: RealtimeSettings = Field(
        RealtimeSettings(), description="real-time options of the loop"
    )
    alerts: AlertSettings = Field(AlertSettings(), description="actions on a change of level")
    record: RecordSettings | None = Field(
        None, description="file to record into (MCAP), or a folder for continuous recording"
    )
    state: StateSettings | None = Field(
        None, description="file that preserves latches and lost people across restarts"
    )
    evidence: EvidenceSettings | None = Field(
        None, description="keep the seconds around each stop, near miss and fault in this folder"
    )
    commissioning: CommissioningSettings | None = Field(
        None, description="commissioning report with which hri-predict check compares"
    )
    log: LogSettings = Field(
        LogSettings(), description="format, minimum severity and rate of the log's lines"
    )
    metrics: MetricsSettings | None = Field(
        None, description="serve /metrics and /healthz over HTTP; off without this block"
    )
    foxglove: FoxgloveSettings | None = Field(
        None, description="show the node live in Foxglove; off without this block"
    )
    discovery: DiscoverySettings | None = Field(
        None, description="announce the node by DNS-SD; off without this block"
    )


@dataclass(frozen=True, kw_only=True)
class Config:
    """A validated configuration: each part was checked by its own model.

    Attributes:
        path: the file that was read.
        text: the file's text (recordings contain it).
        node: the parts common to all configurations.
        source, predictor, links: settings, validated by each kind's own model.
        mute: do not open any of ``links``.
    """

    path: Path
    text: str
    node: NodeSettings
    source: SourceSettings
    predictor: PredictorSettings
    links: tuple[LinkSettings, ...]
    mute: bool = False

    @property
    def base_dir(self) -> Path:
        """Base folder of relative paths in the configuration."""
        return self.path.parent

    def place(self, *keys: str | int) -> str:
        """Return a key's location to start an error line: ``cell.yaml:17: robots.0.name``."""
        return place(self.path, self.text, keys)

    @contextlib.contextmanager
    def naming_lines(self) -> Iterator[None]:
        """Prefix file and line to an error that starts with a key of this configuration.

        Errors found after validation (a forecast too short, an exit too near) contain only the key.
        An error about a file that this configuration names gets the key, too.
        """
        try:
            yield
        except HriPredictError as error:
            said = str(error)
            keys = _KEYS.match(said)
            named = keys[0].split(".") if keys and not said.startswith(str(self.path)) else [""]
            if named[0] in NodeSettings.model_fields:
                links = [link.name for link in self.links]
                if named[0] == "links" and named[1:2] and named[1] in links:
                    named[1] = str(links.index(named[1]))
                way = [key if (number := whole(key)) is None else number for key in named]
                error.args = (f"{self.path}:{line_of(self.text, way)}: {said}",)
            elif not said.startswith(str(self.path)) and (file := self._key_of_file(said)):
                error.args = (f"{self.place(*file)}: {said}",)
            raise

    def _key_of_file(self, said: str) -> Keys | None:
        """Return the key of the file, or of the shipped name, that an error is about."""
        for keys, value in scalars(load_yaml(self.text)):
            names_file = next((k for k in reversed(keys) if isinstance(k, str)), "") in _FILES
            if names_file and re.search(rf"(?<![\w.-]){re.escape(value)}(?![\w.-])", said):
                return keys
        return None

    def with_node(self, **changes: Any) -> "Config":
        """Return this configuration with some blocks changed; they are not validated."""
        return replace(self, node=self.node.model_copy(update=changes))

    def with_source(self, source: dict[str, Any]) -> "Config":
        """Return this configuration with another source (``replay`` sets a recording)."""
        return replace(self, source=_source(source, f"{self.path}: source"))

    def with_predictor(self, name: str, **settings: Any) -> "Config":
        """Return this configuration with another predictor: its defaults, plus ``settings``."""
        return replace(self, predictor=predictor_settings({"name": name} | settings, "--predictor"))

    def with_faults(self, faults: list[str]) -> "Config":
        """Return this configuration with more faults, given as ``[LINK:]kind@start+duration``.

        Raises:
            ConfigError: a fault's text, kind, time or link is wrong.
        """
        parse = registry.load("faults", "parse")
        at_source = list(self.source.faults)
        at_links = {link.name: list(link.faults) for link in self.links}
        for text in faults:
            name, _, rest = text.partition(":")
            if name in at_links:
                at_links[name].append(parse(rest))
            elif rest and "=" not in re.split("[@:]", rest)[0]:  # no parameter, so a fault
                raise ConfigError(
                    f"fault '{text}': no link '{name}'{nearest(name, at_links)}; "
                    f"available: {', '.join(at_links) or 'none'}"
                )
            else:
                at_source.append(parse(text))
        return replace(
            self,
            source=self.source.model_copy(update={"faults": at_source}),
            links=tuple(
                link.model_copy(update={"faults": at_links[link.name]}) for link in self.links
            ),
        )

    def without_links(self) -> "Config":
        """Return this configuration with all links closed; the delay budget still includes them."""
        return replace(self, mute=True)

    @property
    def opened_links(self) -> tuple[LinkSettings, ...]:
        """The links to open; the delay budget also includes the closed ones."""
        return () if self.mute else self.links

    def aside(self) -> "Config":
        """Return this configuration without the outputs of the live cell.

        These are its alert log and commands, recordings, state, evidence, metrics, Foxglove server
        and announcement, which a replay with the cell's configuration must not touch. Alert lines
        on the terminal remain.
        """
        gone = dict.fromkeys(("record", "state", "evidence", "discovery", "metrics", "foxglove"))
        return self.with_node(alerts=AlertSettings(terminal=self.node.alerts.terminal), **gone)

    def with_alerts_of(self, live: "Config") -> "Config":
        """Return this configuration with the alerts of another one."""
        return self.with_node(alerts=live.node.alerts)

    def with_log_format(self, form: str) -> "Config":
        """Return this configuration with the log's lines as ``text`` or ``json``."""
        return self.with_node(log=self.node.log.model_copy(update={"format": form}))

    def quiet(self) -> "Config":
        """Return this configuration without alert lines on the terminal, for use with a view."""
        return self.with_node(alerts=self.node.alerts.model_copy(update={"terminal": False}))


def find(path: Path) -> Path:
    """Return ``path``, or the shipped configuration of that name (``configs/demo.yaml``).

    Raises:
        ConfigError: neither exists.
    """
    if os.path.isdir(path):  # os.path accepts names that are too long; Path raises
        raise ConfigError(f"configuration {path}: this is a folder; name a YAML file in it")
    if os.path.exists(path):
        return path
    shipped = data_path(path.name)
    if os.path.isfile(shipped) and path.parent in (Path("."), Path("configs")):
        return shipped
    there = [p.name for p in data_path().glob("*.yaml")]
    raise ConfigError(
        f"configuration {path}: no such file{nearest_file(path, there)}; check the path, or name "
        f"one of the {len(there)} in {data_path()}, such as demo.yaml"
    )


def shipped(name: str) -> Path:
    """Return the path of a configuration that the package contains."""
    return data_path(name)


def load(path: Path) -> Config:
    """Read and validate a configuration.

    Raises:
        ConfigError: the file cannot be read, or is not YAML.
        ConfigMistakes: one line for each mistake, with its line in the file, key and remedy.
    """
    path = find(path)
    text = read_text(path, "configuration")
    return checked(path, text, read_yaml(path, "configuration"))


def checked(path: Path, text: str, data: dict[str, Any]) -> Config:
    """Validate ``data``, which was parsed from ``text`` of the file ``path``.

    Raises:
        ConfigMistakes: one line for each mistake, with its line in the file, key and remedy.
    """
    wrong = Mistakes(path, text)
    node = wrong.settings(NodeSettings, data)
    given = data.get("predictor", NodeSettings.model_fields["predictor"].default)
    source = wrong.part("sources", "kind", data.get("source"), ("source",))
    predictor = wrong.part("predictors", "name", given, ("predictor",))
    entries = data.get("links")
    entries = entries[:MAX_LINKS] if isinstance(entries, list) else []
    links = [wrong.part("links", "kind", link, ("links", i)) for i, link in enumerate(entries)]
    wrong.tell()
    assert node is not None  # otherwise its mistakes were told
    config = Config(
        path=path, text=text, node=node, source=source, predictor=predictor, links=tuple(links)
    )
    if problem := name_problem(path.stem):
        wrong.add((), f"the cell is named after its file, '{path.stem}', and {problem}")
    _check_names(config, wrong)
    _check_links(config, wrong)
    _check_alerts(config, wrong)
    wrong.tell()
    return config


def _source(data: dict[str, Any], where: str) -> SourceSettings:
    with _named(data, "kind", "sources", where) as name:
        cls = registry.load("sources", name)
    return validated(cls.settings_model, data, where)


def predictor_settings(data: dict[str, Any], where: str) -> PredictorSettings:
    """Validate a ``predictor:`` block with the settings model of the named predictor.

    Raises:
        ConfigError: one line that starts with ``where`` and names the key and the remedy.
    """
    with _named(data, "name", "predictors", where) as name:
        model = registry.predictor_settings(name)
    return validated(model, data, where)


@contextlib.contextmanager
def _named(data: dict[str, Any], key: str, kind: registry.PartKind, where: str) -> Iterator[str]:
    """Return the name under ``key``; errors contain its location."""
    name = data.get(key)
    if not isinstance(name, str):
        there = ", ".join(registry.names(kind))
        raise ConfigError(f"{where}.{key}: missing; use one of: {there}")
    try:
        yield name
    except ConfigError as error:
        raise ConfigError(f"{where}.{key}: {error}") from error


def _check_names(config: Config, wrong: Mistakes) -> None:
    """Check that names are unique and that all robots named by links exist."""
    robots = [r.name for r in config.node.robots]
    for key, names in (("robots", robots), ("links", [link.name for link in config.links])):
        for i, name in enumerate(names):
            if name in names[:i]:
                wrong.add((key, i, "name"), f"name '{name}' is used twice; rename one")
    topics = [advice_topic(name) for name in robots]
    for i, (name, topic) in enumerate(zip(robots, topics, strict=True)):
        other = robots[topics.index(topic)]
        if name != other and name not in robots[:i]:
            wrong.add(
                ("robots", i, "name"),
                f"'{other}' and '{name}' have the same topic {topic} in recordings, in which one "
                f"robot's advice would be missing; rename one",
            )
    for i, link in enumerate(config.links):
        for k, name in enumerate(link.robots or []):
            if name not in robots:
                wrong.add(
                    ("links", i, "robots", k),
                    f"no robot '{name}'{nearest(name, robots)}; available: {', '.join(robots)}",
                )


def _check_links(config: Config, wrong: Mistakes) -> None:
    """Check that links of one kind do not disturb each other, using the link class's own check."""
    for kind in dict.fromkeys(link.kind for link in config.links):
        cls = registry.load("links", kind)
        if not isinstance(cls, ChecksTogether):
            continue
        try:
            cls.check_together([link for link in config.links if link.kind == kind])
        except ConfigError as error:
            wrong.add(("links",), str(error))


def _check_alerts(config: Config, wrong: Mistakes) -> None:
    """Check that all robots and zones named by alert hooks exist."""
    robots = [robot.name for robot in config.node.robots]
    zones = [zone.name for zone in config.node.zones]
    for i, hook in enumerate(config.node.alerts.to):
        for key, known, named in (("robot", robots, hook.robots), ("zone", zones, hook.zones)):
            for name in named or []:
                if name not in known:
                    wrong.add(
                        ("alerts", "to", i, f"{key}s"),
                        f"no {key} '{name}'{nearest(name, known)}; "
                        f"available: {', '.join(known) or 'none'}",
                    )
