"""Extent of a body segment in one direction; ``zones.toward`` says what it rests on."""

from math import inf, sqrt

from hri_predict.base.machine.compiled import part
from hri_predict.zones.loops.spheres import UNSEEN
from hri_predict.zones.toward import BINS, COSINES, STEEP, Toward


@part
def extent(toward: Toward, body: tuple[int, int, int], n: tuple[float, float, float]) -> float:
    """Extent of a segment along a unit vector, from the room's origin."""
    p, k, s = body
    x, y, z = n
    most = -inf
    for i in range(2):
        j = toward.ends[p, s, i]
        mid, path, way = toward.mid[p, k, j], toward.path[p, k, j], toward.way[p, k, j]
        ball = mid[0] * x + mid[1] * y + mid[2] * z + toward.radius[p, k, j]
        cosine = way[0] * x + way[1] * y + way[2] * z
        if abs(z) > STEEP:
            which = BINS - 1
        elif not way[0] * way[0] + way[1] * way[1] + way[2] * way[2] > 0.25:
            which = 0
        else:
            which = 1
            for edge in COSINES:
                which += cosine >= edge
        claim, within = toward.claim[p, k, j] * toward.shares[p, k, which], toward.within[p, j]
        if within > 0.0:
            claim = UNSEEN * sqrt(claim * claim + within * within)
        ahead = path[0] * x + path[1] * y + path[2] * z + toward.rest[p, k, j] + claim
        most = max(most, min(ball, ahead))
    return most + toward.extra[p, s]
