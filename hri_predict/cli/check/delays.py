"""Notes on the delays that the configuration assumes of links and controllers."""

from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.repetition import HEARD_LATE_S, LOST_MESSAGES, lost_without_silence
from hri_predict.run.config import Config

PLC_CYCLE_S = 0.01
_OF_CONTROLLER = ("silence_timeout_s", "reaction_s")


def delay_notes(config: Config) -> list[str]:
    """Return a note for each link whose delays are not stated, or cannot be kept."""
    notes = []
    for link in config.links:
        notes += _assumed(link)
        notes += _too_short(link, 1.0 / config.node.rate_hz)
    return notes


def _assumed(link: LinkSettings) -> list[str]:
    """Return a note if the controller's times are the defaults: it may be slower."""
    unset = [key for key in _OF_CONTROLLER if key not in link.model_fields_set]
    if not unset or link.simulate is not None:
        return []
    times = " and ".join(f"{key} {getattr(link, key) * 1e3:g} ms" for key in unset)
    return [
        f"link {link.name}: {times} not set: T_r assumes a controller that is as fast as a PLC "
        f"with a cycle of {PLC_CYCLE_S * 1e3:g} ms. Measure it (docs/guides/plc.md), set them, and "
        "program the same time-out there; version 0.2 assumed 150 and 50 ms"
    ]


def _too_short(link: LinkSettings, cycle_s: float) -> list[str]:
    """Return a note if the controller hears too seldom for its time-out."""
    interval_s = min(link.repeat_s, cycle_s)
    lost = lost_without_silence(link.silence_timeout_s, interval_s)
    if lost >= LOST_MESSAGES:
        return []
    heard = f"Status and Advice every {interval_s * 1e3:.3g} ms"
    needed_s = HEARD_LATE_S + (LOST_MESSAGES + 1) * interval_s
    effect = (
        "the controller may stop between two of them"
        if lost < 0
        else "each that is lost or late stops the robot"
        if lost == 0
        else "two lost in a row stop the robot"
    )
    return [
        f"link {link.name}: silence_timeout_s {link.silence_timeout_s * 1e3:g} ms is short for "
        f"{heard}: {effect}; raise it to {needed_s:.2g} s (in the controller, too), or repeat_hz"
    ]
