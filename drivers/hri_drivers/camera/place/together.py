"""Locates a person with two or more cameras at known poses in the room, by triangulation.

Each joint is the point nearest to its rays, found by linear least squares. A second pass weights
each ray by the inverse square of its distance, which minimizes angular errors (the midpoint method
and its correction: R. Hartley and P. Sturm, "Triangulation", Computer Vision and Image
Understanding 68(2), 1997). A joint whose rays miss each other is not observed.

People are matched between cameras by how well their rays meet. The rays of two different people
often meet as well, at a body that is too near and too small, or too far and too large. A match
therefore also needs most of the joints that both cameras see, and the distance from each camera
that its image shows by itself.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hri_drivers.camera.place.alone import place_alone
from hri_drivers.camera.place.bones import bones_of
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.place.placed import (
    FARTHEST_M,
    MIN_VISIBILITY,
    NEAREST_M,
    SIGMAS_99,
    Placed,
    Unplaced,
)
from hri_drivers.camera.seen import Seen
from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import norm, transform

APART_NS = 20_000_000
"""Maximum time between simultaneous exposures: a person walks 3 cm in it."""
WALK_M_S = 1.6
DISAGREE_M = 0.1
"""Maximum distance of a joint from each of its rays. Networks differ by up to some centimetres."""
MIN_PARALLAX_DEG = 5.0
"""Minimum angle between rays; more parallel rays do not determine the distance of their point."""
MIN_JOINTS = 6
MIN_AGREE = 0.7
"""Minimum share of the commonly seen joints on which the cameras agree. The bodies of people found
by BlazePose have 0.72 or more, every fifth false body less (docs/measured/camera-place.md)."""
STATURE_M = 1.1, 2.3
"""Minimum and maximum stature by the bones, which are noisy."""
FLAT_STATURE_M = 1.3, 2.1
"""The same for a network without metres, with which nothing else shows a false body's size."""
RIVAL, RIVAL_M = 2.0, 0.01
"""A match is ambiguous if a rival match's miss is less than this factor times the match's own miss
plus this distance."""
LANDMARK_ERROR_M = 0.25
"""99 % bound of the error that all cameras share: the network's joints differ from those of the
body."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One camera's image.

    Attributes:
        camera: the camera for images of this size, with its pose in the room.
        exposed_ns: time of the exposure, by one clock for all cameras.
        seen: the people in it.
    """

    camera: Camera
    exposed_ns: int
    seen: tuple[Seen, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """One person in the images of several cameras.

    Attributes:
        seen: by view, None where this person was not found.
        placed: the place, in the axes of the first view's camera.
    """

    seen: tuple[Seen | None, ...]
    placed: Placed | Unplaced


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """Points of a body by its rays.

    Attributes:
        points: (J, 3) metres, room; NaN where not observed.
        misses: (J,) root mean square of the distance to the rays, metres.
        sines: (J,) sine of the angle between the rays.
    """

    points: Floats
    misses: Floats
    sines: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """One person in the view of one camera.

    Attributes:
        origin: (3,) the camera, room.
        ways: (J, 3) unit vectors, room.
        known: (J,) which joints the camera saw.
        alone: the place by this image alone, in the axes of the room; None if the network gives no
            landmarks in metres.
    """

    origin: Floats
    ways: Floats
    known: Bools
    layout: str
    alone: Placed | Unplaced | None


_Pair = tuple[tuple[int, int], tuple[int, int]]
"""Two people, each as a view and an index in that view."""


def place_together(views: Sequence[View]) -> tuple[Together, ...]:
    """Place all people of simultaneous images; each appears exactly once.

    Raises:
        ConfigError: fewer than two cameras, one without a pose, or networks with different layouts.
    """
    if len(views) < 2:
        raise ConfigError("two or more cameras are needed to triangulate; one is given")
    to_room = [view.camera.room_from_optical() for view in views]
    if len({seen.layout for view in views for seen in view.seen}) > 1:
        raise ConfigError("all cameras must use networks of the same joints")
    stamps = [view.exposed_ns for view in views]
    apart_ns = max(stamps) - min(stamps)
    rays = [[_rays(seen, view.camera, m) for seen in view.seen]
            for view, m in zip(views, to_room, strict=True)]  # fmt: skip
    if apart_ns > APART_NS:
        return tuple(
            Together(_members(views, {v: i}), Unplaced("images are not of one moment"))
            for v, view in enumerate(views)
            for i in range(len(view.seen))
        )
    found = []
    for group, why in _groups(views, rays):
        placed: Placed | Unplaced = Unplaced(why)
        if not why:
            body = _triangulate([rays[v][i] for v, i in group.items()])
            placed = _placed(body, views, to_room, apart_ns)
        found.append(Together(_members(views, group), placed))
    return tuple(found)


def _members(views: Sequence[View], group: dict[int, int]) -> tuple[Seen | None, ...]:
    return tuple(view.seen[group[v]] if v in group else None for v, view in enumerate(views))


def _rays(seen: Seen, camera: Camera, to_room: Floats) -> _Rays:
    flat = camera.rays(seen.pixels)
    known = (
        (seen.visibility >= MIN_VISIBILITY)
        & camera.inside(seen.pixels)
        & np.isfinite(flat).all(axis=1)
    )
    ways = np.column_stack([flat, np.ones(len(flat))]) @ to_room[:3, :3].T
    alone = None if seen.world is None else place_alone(seen, camera)
    if isinstance(alone, Placed):
        alone = replace(alone, positions=transform(to_room, alone.positions))
    return _Rays(to_room[:3, 3], ways / norm(ways)[:, None], known, seen.layout, alone)


def _groups(
    views: Sequence[View], rays: Sequence[Sequence[_Rays]]
) -> list[tuple[dict[int, int], str]]:
    """Return each person as view -> index in that view, and why the person cannot be placed, or
    ``""``.
    """
    costs = {
        ((v, i), (w, j)): cost
        for v, w in itertools.combinations(range(len(views)), 2)
        for i, j in itertools.product(range(len(rays[v])), range(len(rays[w])))
        if (cost := _cost([rays[v][i], rays[w][j]])) < math.inf
    }
    groups = {(v, i): {v: i} for v, view in enumerate(views) for i in range(len(view.seen))}
    doubtful = set()
    for (a, b), cost in sorted(costs.items(), key=lambda item: item[1]):
        if not groups[a].keys() & groups[b].keys():
            both = groups[a] | groups[b]
            if _cost([rays[v][i] for v, i in both.items()]) == math.inf:
                continue
            groups |= dict.fromkeys(both.items(), both)
            rivals = [
                other for pair, other in costs.items() if pair != (a, b) and _rival(pair, (a, b))
            ]
            if min(rivals, default=math.inf) < RIVAL * cost + RIVAL_M:
                doubtful |= {a, b}
    found = []
    for member, group in groups.items():
        if member == min(group.items()):
            why = "no second camera shows the same person" if len(group) == 1 else ""
            if doubtful & set(group.items()):
                why = "rays of several people meet"
            found.append((group, why))
    return found


def _rival(pair: _Pair, accepted: _Pair) -> bool:
    """Whether a pair shares a person with the accepted pair and connects the same views."""
    (a, b), (c, d) = pair, accepted
    return (a == c and b[0] == d[0]) or (b == d and a[0] == c[0])


def _cost(rays: Sequence[_Rays]) -> float:
    """Return the miss distance of a body's rays, in metres; infinite if they do not form a body."""
    body = _triangulate(rays)
    met = np.isfinite(body.misses)
    common = np.sum([each.known for each in rays], axis=0) >= 2
    if np.count_nonzero(met) < max(MIN_JOINTS, MIN_AGREE * np.count_nonzero(common)):
        return math.inf
    stature = bones_of(rays[0].layout).stature(body.points, met)
    low, high = FLAT_STATURE_M if any(each.alone is None for each in rays) else STATURE_M
    if not low <= stature <= high:  # NaN: too few bones to be sure
        return math.inf
    off = np.array([_off_alone(each, body.points) for each in rays if each.alone is not None])
    # the images of one person err independently; a false body is too near for all, or too far
    if not (np.abs(off) <= 1).all() or abs(off.sum()) > math.sqrt(len(off)):
        return math.inf
    return float(np.median(body.misses[met]))


def _off_alone(rays: _Rays, points: Floats) -> float:
    """Return how much farther away a person is by this camera's image alone than by triangulation.

    As a share of the 99 % bound that the image alone states; infinite if it gives no place.

    Args:
        rays: the person in one view, whose network gives landmarks in metres.
        points: (J, 3) the triangulated body, metres, room.
    """
    if not isinstance(rays.alone, Placed):
        return math.inf
    both = np.isfinite(points).all(axis=1) & rays.alone.observed
    if not both.any():
        return math.inf
    places = rays.alone.positions, points
    alone_m, together_m = (norm(np.median(each[both], axis=0) - rays.origin) for each in places)
    return float((alone_m - together_m) / rays.alone.error_m)


def _triangulate(rays: Sequence[_Rays]) -> _Body:
    """Return the body at which the rays of several cameras meet."""
    origins = np.array([each.origin for each in rays])[:, None]  # (V, 1, 3)
    ways = np.array([each.ways for each in rays])  # (V, J, 3)
    known = np.array([each.known for each in rays])
    points, misses, sines = _meeting(origins, ways, known)
    for _ in range(len(rays) - 2):  # one camera after the other may be wrong about a joint
        worst = misses.argmax(axis=0)
        wrong = misses.max(axis=0) > DISAGREE_M
        known = known.copy()
        known[worst[wrong], np.flatnonzero(wrong)] = False
        points, misses, sines = _meeting(origins, ways, known)
    with np.errstate(invalid="ignore"):
        good = (
            (known.sum(axis=0) >= 2)
            & (misses.max(axis=0) <= DISAGREE_M)
            & (sines >= math.sin(math.radians(MIN_PARALLAX_DEG)))
        )
    rms = np.sqrt((misses**2).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    return _Body(np.where(good[:, None], points, np.nan), np.where(good, rms, np.nan), sines)


def _meeting(origins: Floats, ways: Floats, known: Bools) -> tuple[Floats, Floats, Floats]:
    """Return the points (J, 3) nearest to rays, how far they miss each (V, J), and the sines.

    A point behind a camera misses its ray by an infinite distance.
    """
    ways = np.where(known[..., None], ways, 0.0)
    across = np.eye(3) - ways[..., :, None] * ways[..., None, :]  # (V, J, 3, 3)
    weights = known.astype(np.float64)
    lowest = np.linalg.eigvalsh((across * weights[..., None, None]).sum(axis=0))[:, 0]
    sines = np.sqrt(np.clip(1 - (1 - np.minimum(lowest, 1.0)) ** 2, 0, 1))
    for _ in range(2):
        a = across * weights[..., None, None]
        left = a.sum(axis=0) + 1e-12 * np.eye(3)
        right = np.einsum("vjab,vjb->ja", a, np.broadcast_to(origins, ways.shape))
        points = np.linalg.solve(left, right[..., None])[..., 0]
        distance = np.linalg.norm(points - origins, axis=-1)
        weights = known / np.maximum(distance, NEAREST_M) ** 2
    off = points - origins
    along = (off * ways).sum(axis=-1)
    misses = np.linalg.norm(off - along[..., None] * ways, axis=-1)
    misses = np.where(along > 0, misses, np.inf)
    return points, np.where(known, misses, 0.0), sines


def _placed(
    body: _Body, views: Sequence[View], to_room: Sequence[Floats], apart_ns: int
) -> Placed | Unplaced:
    observed = np.isfinite(body.misses)
    if np.count_nonzero(observed) < MIN_JOINTS:
        return Unplaced("too few joints on which the cameras agree")
    middle = np.median(body.points[observed], axis=0)
    distances = [float(np.linalg.norm(middle - m[:3, 3])) for m in to_room]
    if not (min(distances) >= NEAREST_M and max(distances) <= FARTHEST_M):
        return Unplaced(f"not between {NEAREST_M:g} and {FARTHEST_M:g} m away")
    # what moves a ray aside moves the place where it meets another one by more, along that one
    stretch = 1.0 / float(np.median(body.sines[observed]))
    miss = float(np.median(body.misses[observed]))
    focal = max(v.camera.focal_error * d for v, d in zip(views, distances, strict=True))
    walked = WALK_M_S * apart_ns * 1e-9
    error_m = (
        math.hypot(LANDMARK_ERROR_M, SIGMAS_99 * miss * stretch, focal * stretch) + walked * stretch
    )
    points = transform(np.asarray(np.linalg.inv(to_room[0]), np.float64), body.points)
    return Placed(points, observed, error_m)
