"""The node's YAML configuration, validated before anything starts."""

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from hri_predict import registry
from hri_predict.alerts import AlertSettings
from hri_predict.discovery.services import DiscoverySettings
from hri_predict.errors import ConfigError, nearest
from hri_predict.link import LinkSettings
from hri_predict.people import PeopleSettings
from hri_predict.predictors.base import PredictorSettings
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.engine import RiskSettings
from hri_predict.risk.robot import RobotSettings
from hri_predict.settings import Settings, data_path, read_text, read_yaml, validated
from hri_predict.source import SourceSettings

MAX_ROBOTS = 8
MAX_LINKS = 32  # each has a thread of its own


class NodeSettings(Settings):
    """The top level of a configuration; ``source``, ``predictor`` and links are checked by kind."""

    rate_hz: float = Field(
        25.0, ge=10, le=100, description="cycles per second; controllers expect at least 10"
    )
    source: dict[str, Any]
    predictor: dict[str, Any] = {"name": "constant_velocity"}
    people: PeopleSettings = PeopleSettings()
    robots: list[RobotSettings] = Field(min_length=1, max_length=MAX_ROBOTS)
    risk: RiskSettings = RiskSettings()
    zones: list[NamedZoneSettings] = []
    links: list[dict[str, Any]] = Field([], max_length=MAX_LINKS)
    alerts: AlertSettings = AlertSettings()
    record: str | None = Field(None, min_length=1, description="file to record into (MCAP)")
    discovery: DiscoverySettings | None = Field(
        None, description="announce the node by DNS-SD; absent: nothing is announced"
    )


@dataclass(frozen=True)
class Config:
    """A configuration whose every part was validated by its own model.

    Attributes:
        path: the file it came from.
        text: that file, as read (goes into recordings).
        node: the parts that every configuration has.
        source, predictor, links: each validated by the model beside its code.
        mute: no link is opened, whatever ``links`` says.
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
        """Where relative paths in the configuration start."""
        return self.path.parent

    def with_source(self, source: dict[str, Any]) -> "Config":
        """The same configuration with another source (``replay`` puts a recording there)."""
        return replace(self, source=_by_kind("sources", source, f"{self.path}: source"))

    def with_predictor(self, name: str, **settings: Any) -> "Config":
        """The same configuration with another predictor, at its defaults but for ``settings``."""
        return replace(self, predictor=_predictor({"name": name} | settings, "--predictor"))

    def with_faults(self, faults: list[str]) -> "Config":
        """The same configuration with faults given as text: ``[LINK:]kind@start+duration``.

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
                    f"fault '{text}': there is no link '{name}'{nearest(name, at_links)}; "
                    f"there are: {', '.join(at_links) or 'none'}"
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
        """The same configuration, and delays, with its links left closed."""
        return replace(self, mute=True)

    @property
    def opened_links(self) -> tuple[LinkSettings, ...]:
        """The links to open; all count in the delay budget."""
        return () if self.mute else self.links

    def quiet(self) -> "Config":
        """The same configuration with no alert lines on the terminal (a view is there)."""
        alerts = self.node.alerts.model_copy(update={"terminal": False})
        return replace(self, node=self.node.model_copy(update={"alerts": alerts}))


def find(path: Path) -> Path:
    """Return ``path``, or the shipped configuration of that name (``configs/demo.yaml``).

    Raises:
        ConfigError: neither exists.
    """
    if os.path.isdir(path):  # these of os.path bear names that are too long
        raise ConfigError(f"configuration {path}: is a folder; name a YAML file in it")
    if os.path.exists(path):
        return path
    shipped = data_path(path.name)
    if os.path.isfile(shipped) and path.parent in (Path("."), Path("configs")):
        return shipped
    there = [p.name for p in data_path().glob("*.yaml")]
    raise ConfigError(
        f"configuration {path}: no such file{nearest(path.name, there)}; "
        f"shipped ones: {', '.join(sorted(there))}"
    )


def shipped(name: str) -> Path:
    """Path of a configuration that is part of the project."""
    return data_path(name)


def load(path: Path) -> Config:
    """Read and validate a configuration.

    Raises:
        ConfigError: one line naming the file, the key and the remedy.
    """
    path = find(path)
    data = read_yaml(path, "configuration")
    node = validated(NodeSettings, data, str(path))
    config = Config(
        path=path,
        text=read_text(path, "configuration"),
        node=node,
        source=_by_kind("sources", node.source, f"{path}: source"),
        predictor=_predictor(node.predictor, f"{path}: predictor"),
        links=tuple(
            _by_kind("links", link, f"{path}: links.{i}") for i, link in enumerate(node.links)
        ),
    )
    _check_names(config)
    _check_links(config)
    return config


def _by_kind(kind: registry.Kind, data: dict[str, Any], where: str) -> Any:
    name = data.get("kind")
    if not isinstance(name, str):
        raise ConfigError(f"{where}.kind: say which; there are: {', '.join(registry.names(kind))}")
    try:
        cls = registry.load(kind, name)
    except ConfigError as error:
        raise ConfigError(f"{where}.kind: {error}") from error
    return validated(cls.settings_model, data, where)


def _predictor(data: dict[str, Any], where: str) -> PredictorSettings:
    name = data.get("name")
    if not isinstance(name, str):
        there = ", ".join(registry.names("predictors"))
        raise ConfigError(f"{where}.name: say which; there are: {there}")
    try:
        cls = registry.load("predictors", name)
    except ConfigError as error:
        raise ConfigError(f"{where}.name: {error}") from error
    settings: PredictorSettings = validated(cls.settings_model, data, where)
    return settings


def _check_names(config: Config) -> None:
    """Names are unique, and every reference to a robot exists."""
    robots = [r.name for r in config.node.robots]
    for key, names in (("robots", robots), ("links", [link.name for link in config.links])):
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"{config.path}: {key}: name '{name}' is used twice; rename one")
    for i, link in enumerate(config.links):
        for name in link.robots or []:
            if name not in robots:
                raise ConfigError(
                    f"{config.path}: links.{i}.robots: no robot '{name}'{nearest(name, robots)}; "
                    f"there are: {', '.join(robots)}"
                )


def _check_links(config: Config) -> None:
    """Links of one kind that would disturb each other; the kind itself knows."""
    for kind in dict.fromkeys(link.kind for link in config.links):
        check = getattr(registry.load("links", kind), "check_together", None)
        if check is None:
            continue
        try:
            check([link for link in config.links if link.kind == kind])
        except ConfigError as error:
            raise ConfigError(f"{config.path}: {error}") from error
