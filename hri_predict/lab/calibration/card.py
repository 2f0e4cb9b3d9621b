"""The section about zones on a predictor's card: radii, data, coverage."""

from pathlib import Path

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write
from hri_predict.lab.calibration.judgement import WAYS, ZoneJudgement
from hri_predict.lab.calibration.levels import levels_text
from hri_predict.zones.settings import LEVELS

HEAD = "## Zones"


def write_section(card: Path, judged: ZoneJudgement) -> None:
    """Write the section at the end of a card, replacing an earlier one.

    A missing card is created (the baselines have none).

    Raises:
        ConfigError: the card cannot be read or written.
    """
    text = read_card(card) or f"# {judged.predictor}\n"
    try:
        kept = text.partition(f"\n{HEAD}\n")[0].rstrip()
        atomic_write(card, f"{kept}\n\n{section(judged)}".encode())
    except (OSError, ValueError) as error:
        raise ConfigError(f"--card {card}: cannot be written: {error}; name another") from error


def read_card(card: Path) -> str:
    """A card's text; empty if there is none.

    Raises:
        ConfigError: it cannot be read.
    """
    try:
        return card.read_text(encoding="utf-8") if card.exists() else ""
    except (OSError, ValueError) as error:
        raise ConfigError(f"--card {card}: cannot be read: {error}; name another") from error


def section(judged: ZoneJudgement) -> str:
    """The section as Markdown."""
    used = [recording.name for recording in judged.calibration.recordings]
    ms = judged.horizons()
    lines = [
        HEAD,
        "",
        f"Radii are *estimated* from {len(used)} recordings ({', '.join(used)}); measured on "
        f"{judged.recordings} others.",
        "",
        *(f"- {line}" for line in levels_text(judged.calibration)),
        "",
        "Measured coverage of the whole body, %, pooled, with 95 % intervals by recording if there "
        "are several:",
        "",
        "| stated, way | " + " | ".join(f"{m} ms" for m in ms) + " |",
        "|---|" + "---:|" * len(ms),
        *_coverage(judged, ms),
        "",
    ]
    return "\n".join(lines)


def _coverage(judged: ZoneJudgement, horizons: list[int]) -> list[str]:
    lines = []
    for level in LEVELS:
        for way in (WAYS[0], WAYS[2]):
            found = judged.coverage[level, "body", way]
            share = found.share("body")
            low, high = found.interval("body")
            ends = [f" [{100 * a:.0f}, {100 * b:.0f}]" for a, b in zip(low, high, strict=True)]
            several = judged.recordings > 1
            at = [judged.at(ms) for ms in horizons]
            cells = [f"{100 * share[k]:.1f}{ends[k] if several else ''}" for k in at]
            lines.append(f"| {100 * level:g} %, {way} | " + " | ".join(cells) + " |")
    return lines
