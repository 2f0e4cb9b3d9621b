"""The robots that a link advises, and the link settings that depend on them."""

from hri_predict.contracts import registry
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.link_abilities import OfRobots
from hri_predict.run.config import Config


def advised(config: Config, link: LinkSettings) -> list[int]:
    """Return the indices of the robots whose advice a link carries."""
    return [
        i
        for i, robot in enumerate(config.node.robots)
        if not link.robots or robot.name in link.robots
    ]


def of_robots(config: Config, settings: LinkSettings) -> LinkSettings:
    """Return a link's settings, completed with the values that depend on its robots.

    Raises:
        LinkError: they do not fit these robots.
    """
    cls = registry.load("links", settings.kind)
    if not isinstance(cls, OfRobots):
        return settings
    robots = [config.node.robots[i] for i in advised(config, settings)]
    completed: LinkSettings = cls.of_robots(settings, robots)
    return completed
