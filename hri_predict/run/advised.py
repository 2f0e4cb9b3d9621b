"""The robots that a link advises, and the link settings that depend on them and on their delays."""

import math
from collections.abc import Callable

from hri_predict.contracts import registry
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.link_abilities import OfRobots, RefusesOld
from hri_predict.risk.delay_budget import DelayBudget
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


def age_limits_s(config: Config, budget: DelayBudget) -> dict[str, float]:
    """Return the maximum ``max_age_s``, in whole ms, by link, of links that refuse old advice."""
    oldest_s = budget.oldest_sent_s([robot.name for robot in config.node.robots])
    return {
        link.name: math.floor(oldest_s[link.name] * 1e3 + 1e-6) / 1e3
        for link in config.links
        if isinstance(link, RefusesOld)
    }


def with_age_limit(
    config: Config, settings: LinkSettings, budget: Callable[[], DelayBudget]
) -> LinkSettings:
    """Return a link's settings; if it refuses old advice at no configured age, with the maximum.

    ``budget`` returns the delay budget, whose source need not be built for other links.
    """
    if not isinstance(settings, RefusesOld) or settings.max_age_s is not None:
        return settings
    limit_s = age_limits_s(config, budget())[settings.name]
    return settings.model_copy(update={"max_age_s": limit_s})
