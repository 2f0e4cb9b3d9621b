"""Maximum speed of a body that is no longer seen, from its last speed and acceleration."""

import numpy as np

from hri_predict.people.track import Track

APART_S, START_APART_S = 0.1, 0.06
"""Minimum time between two captures for a speed: 2 mm of noise of the joints' mean are 0.03 m/s in
0.1 s. For a body that was at rest, a shorter time is enough."""
WITHIN_S = 0.6
"""Maximum age of captures used for the newest speed. At 5 Hz three captures take 0.4 s."""
SPEEDING_M_S2 = 2.2
"""Usual maximum acceleration of a walker's trunk, within a step or when starting."""
AT_REST_M_S = 0.2
"""Speed below which a person is at rest. If the next speed is higher, motion started at an unknown
time within the newest interval, and the true acceleration may be twice its mean."""
GOES_ON_S = 1.0
"""Time for which a runner may keep the measured acceleration: 6.4 m/s2, the highest measured for
sprinters at the start, lead to 8 m/s in 1.25 s. A zone that grows at the speed reached then stays
ahead of a body that accelerates evenly for twice as long."""


def speeding(track: Track) -> tuple[float, float] | None:
    """Return the newest speed of a body, m/s, and its acceleration, m/s2.

    Both are measured from three captures, with the joints seen in all three. ``None``: no such
    captures.
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
    """Return the newest speed, the previous speed, and the seconds between their midpoints."""
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
