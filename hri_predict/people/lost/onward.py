"""How fast a body may go on that is no longer seen: as it was seen last, and as it sped up then."""

import numpy as np

from hri_predict.people.track import Track

APART_S = 0.1
"""Least time between two captures whose difference is a speed: 5 mm of noise are 0.07 m/s then."""
WITHIN_S = 0.6
"""Captures before this say nothing about the newest speed. At 5 Hz three captures take 0.4 s."""
SPEEDING_M_S2 = 2.0
"""A walker's trunk hardly speeds up by more, within a step or when starting."""
GOES_ON_S = 1.0
"""For this long a runner may speed up as measured: 6.4 m/s2, the most that was measured of
sprinters at the start, lead to 8 m/s in 1.25 s. A zone that grows at the speed reached then is
ahead of a body that speeds up evenly for twice as long."""


def speeding(track: Track) -> tuple[float, float] | None:
    """The newest speed of a body, m/s, and how quickly it speeds up, m/s2.

    Both come from three captures, ``APART_S`` or more apart, and from the joints seen in all three.
    ``None``: there are no such captures.
    """
    stamps, positions, observed = track.history.samples()
    apart_ns, anchors = round(APART_S * 1e9), [len(stamps) - 1]
    recent = track.capture_ns - round(WITHIN_S * 1e9)
    for index in range(len(stamps) - 2, -1, -1):
        if stamps[index] < recent or len(anchors) == 3:
            break
        if stamps[anchors[-1]] - stamps[index] >= apart_ns:
            anchors.append(index)
    if len(anchors) < 3:
        return None
    common = observed[anchors].all(0)
    if not common.any():
        return None
    places = positions[anchors][:, common].mean(1)
    seconds = -np.diff(stamps[anchors]) * 1e-9
    newer, older = np.linalg.norm(np.diff(places, axis=0), axis=1) / seconds
    gain_m_s2 = float(newer - older) / float(seconds.mean())
    return float(newer) + max(gain_m_s2, 0.0) * float(seconds[0]) / 2, gain_m_s2


def speed_reached(track: Track) -> float:
    """Which speed (m/s) a body may reach that speeds up as it was seen to; 0: it did not."""
    found = speeding(track)
    if found is None or found[1] < SPEEDING_M_S2:
        return 0.0
    speed, gain_m_s2 = found
    return speed + gain_m_s2 * GOES_ON_S
