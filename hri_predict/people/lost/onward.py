"""Maximum speed of a body that is no longer seen: as it was seen last, and as it sped up then."""

import numpy as np

from hri_predict.people.track import Track

APART_S, START_APART_S = 0.1, 0.06
"""Minimum time between two captures whose difference is a speed: 2 mm of noise of the joints' mean
are 0.03 m/s in 0.1 s. Of a body that was at rest a shorter time is enough."""
WITHIN_S = 0.6
"""Captures before this say nothing about the newest speed. At 5 Hz three captures take 0.4 s."""
SPEEDING_M_S2 = 2.2
"""A walker's trunk hardly speeds up by more, within a step or when starting."""
AT_REST_M_S = 0.2
"""Speed below which a person has just begun to move, at some time within the newest interval: then
the body may speed up twice as quickly as the mean over this interval says."""
GOES_ON_S = 1.0
"""For this long a runner may speed up as measured: 6.4 m/s2, the most that was measured of
sprinters at the start, lead to 8 m/s in 1.25 s. A zone that grows at the speed reached then is
ahead of a body that speeds up evenly for twice as long."""


def speeding(track: Track) -> tuple[float, float] | None:
    """The newest speed of a body, m/s, and how quickly it speeds up, m/s2.

    Both come from three captures, and from the joints seen in all three. ``None``: there are no
    such captures.
    """
    starting = _measured(track, START_APART_S)
    if starting is not None and starting[1] < AT_REST_M_S:
        newer, older, seconds = starting
        return newer, 2.0 * (newer - older) / seconds
    going = _measured(track, APART_S)
    if going is None:
        return None
    newer, older, seconds = going
    gain_m_s2 = (newer - older) / seconds
    return newer + max(gain_m_s2, 0.0) * seconds / 2, gain_m_s2


def _measured(track: Track, apart_s: float) -> tuple[float, float, float] | None:
    """The newest speed, the one before, and the seconds between their middles."""
    stamps, positions, observed = track.history.samples()
    apart_ns, anchors = round(apart_s * 1e9), [len(stamps) - 1]
    recent = track.capture_ns - round(WITHIN_S * 1e9)
    for index in range(len(stamps) - 2, -1, -1):
        if stamps[index] < recent or len(anchors) == 3:
            break
        if stamps[anchors[-1]] - stamps[index] >= apart_ns:
            anchors.append(index)
    common = observed[anchors].all(0)
    if len(anchors) < 3 or not common.any():
        return None
    places = positions[anchors][:, common].mean(1)
    seconds = -np.diff(stamps[anchors]) * 1e-9
    newer, older = np.linalg.norm(np.diff(places, axis=0), axis=1) / seconds
    return float(newer), float(older), float(seconds.mean())


def speed_reached(track: Track) -> float:
    """Return the speed (m/s) that an accelerating body may reach; 0 for any other body."""
    found = speeding(track)
    if found is None or found[1] < SPEEDING_M_S2:
        return 0.0
    speed, gain_m_s2 = found
    return speed + gain_m_s2 * GOES_ON_S
