"""Files that determine the results of a simulation: those that its cell names, and recordings."""

from collections.abc import Iterable
from pathlib import Path

from hri_predict.base.work.identity import digests, is_installed
from hri_predict.commissioning.identity import canonical, dependencies, flattened
from hri_predict.run.config import Config
from hri_sim.simulation.motion import PROCEDURAL


def named_files(config: Config) -> dict[str, Path]:
    """Return key of the configuration -> file that the key names or implies; it may be missing.

    Raises:
        ConfigError: a robot or trajectory is neither shipped nor a file.
    """
    return dependencies(config, flattened(canonical(config)))


def named_digests(config: Config) -> dict[str, str]:
    """Return key of the configuration -> SHA-256 of its file, or "missing"."""
    files = named_files(config)
    return dict(zip(files, (digests([path])[str(path)] for path in files.values()), strict=True))


def recorded(motions: Iterable[str]) -> list[Path]:
    """Return the recordings among motions, in their order."""
    return [Path(name) for name in motions if not name.startswith(PROCEDURAL + ":")]


def read_files(configs: Iterable[Config], others: Iterable[Path]) -> list[Path]:
    """Return each file once that another machine must have, except for those of the installation.

    Args:
        configs: the cell with each predictor.
        others: recordings and calibrations.
    """
    found: dict[Path, None] = {}
    for config in configs:
        named = named_files(config).values()
        found[config.path] = None
        found |= dict.fromkeys(path for path in named if not is_installed(path))
    return list(found | dict.fromkeys(others))
