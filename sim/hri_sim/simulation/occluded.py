"""People lost by cameras: episodes behind boxes and behind each other, through the whole node.

Each episode draws from its seed: a camera (or two), one to three people who walk to a place near
the robot, stay there, reach into its path and leave; boxes that hide the places from the camera;
the camera's rate; and whether people get other ids when found again. No earlier results are reused:
people, zones, links, controllers, arm and referee run as with ``--speed max``.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, HriPredictError
from hri_predict.base.geometry import side
from hri_predict.base.settings import validated
from hri_predict.base.work.workers_for import workers_for
from hri_predict.contracts.source import Source
from hri_predict.node.listeners import Tick
from hri_predict.people.settings import PeopleSettings
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import with_predictor
from hri_predict.run.config import Config
from hri_predict.run.session import Options, View, run
from hri_sim.simulation.cell import manned
from hri_sim.simulation.inputs import read_files
from hri_sim.simulation.request import OcclusionRequest, OcclusionRow

# -- space that boxes hide from cameras, as polygons on the floor: ``source.shadows`` --------------

_FAR_M = 100.0


def shadows_of(
    boxes: Sequence[Sequence[float]], cameras: Sequence[Sequence[float]], room_m: float
) -> list[dict[str, Any]]:
    """Return prisms in which something is hidden from every camera.

    Args:
        boxes: x and y of two opposite corners, and the height.
        cameras: positions.
        room_m: distance from the origin to each wall.
    """
    room = [[-room_m, -room_m], [room_m, -room_m], [room_m, room_m], [-room_m, room_m]]
    hidden: list[Floats] = [np.array(room)]
    for camera in cameras:
        shadows = [_shadow(np.asarray(box), np.asarray(camera)) for box in boxes]
        hidden = [part for h in hidden for s in shadows if len(part := _clipped(h, s)) >= 3]
    return [{"polygon": part.tolist(), "z_max": 2.0} for part in hidden if _area(part) > 1e-4]


def _shadow(box: Floats, camera: Floats) -> Floats:
    """Return the convex polygon (N, 2) of a box and the floor that it hides from a camera."""
    corners = box[[[0, 1], [2, 1], [2, 3], [0, 3]]]
    way = corners - camera[:2]
    # a ray over the box's edge meets the floor so much farther away; never, if the box is higher
    over = camera[2] - box[4]
    stretch = camera[2] / over if over > 0.05 else _FAR_M
    return _hull(np.concatenate([corners, camera[:2] + way * min(stretch, _FAR_M)]))


def _hull(points: Floats) -> Floats:
    """Return the convex hull, counterclockwise (Andrew's monotone chain)."""
    order = sorted(map(tuple, points.tolist()))
    chains = []
    for chosen in (order, order[::-1]):
        chain: list[tuple[float, ...]] = []
        for point in chosen:
            while len(chain) >= 2 and side(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _clipped(subject: Floats, convex: Floats) -> Floats:
    """Clip a polygon to a convex, counterclockwise one (Sutherland, Hodgman 1974)."""
    points = [tuple(p) for p in subject.tolist()]
    for a, b in zip(convex.tolist(), np.roll(convex, -1, axis=0).tolist(), strict=True):
        inside = [side(a, b, p) >= 0 for p in points]
        kept = []
        for i, point in enumerate(points):
            before, was_inside = points[i - 1], inside[i - 1]
            if inside[i] != was_inside:
                kept.append(_crossing(a, b, before, point))
            if inside[i]:
                kept.append(point)
        points = kept
    return np.array(points).reshape(-1, 2)


def _crossing(
    a: Sequence[float], b: Sequence[float], p: Sequence[float], q: Sequence[float]
) -> tuple[float, float]:
    """Return the point where the line a b crosses the segment p q."""
    from_p, from_q = side(a, b, p), side(a, b, q)
    part = from_p / (from_p - from_q)
    return p[0] + part * (q[0] - p[0]), p[1] + part * (q[1] - p[1])


def _area(polygon: Floats) -> float:
    x, y = polygon.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


# --------------------------------------------------------------------------------------------------

DURATION_S = 18.0
ROOM_M = 6.0  # from the robot's base to each wall
CAMERA_Z_M = 2.8
REACH_Z_M = (0.85, 1.15)
_TRIES = 30


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One episode; places in metres, room frame."""

    cameras: list[list[float]]
    boxes: list[list[float]]
    people: list[dict[str, Any]]
    rate_hz: float
    rename: float


def draw(seed: int, index: int, rates_hz: Sequence[float], cameras: int) -> Episode:
    """Draw episode number ``index`` of ``seed``."""
    rng = np.random.default_rng([seed, index])
    corners = [[x, y, CAMERA_Z_M] for x in (-ROOM_M, ROOM_M) for y in (-ROOM_M, ROOM_M)]
    seen_from = [corners[i] for i in rng.choice(4, cameras, replace=False)]
    people, boxes = [], []
    for number in range(1, int(rng.integers(1, 4)) + 1):
        bearing = float(rng.uniform(-math.pi, math.pi))
        stay_m = float(rng.uniform(1.5, 3.0))
        people.append(_person(rng, number, bearing, stay_m))
        if rng.random() < 0.8:
            boxes.append(_box(rng, _at(bearing, stay_m), seen_from[0]))
    return Episode(
        cameras=seen_from,
        boxes=boxes,
        people=people,
        rate_hz=float(rng.choice(np.asarray(rates_hz))),
        rename=float(rng.choice([0.0, 0.5, 1.0])),
    )


def _at(bearing: float, away_m: float) -> list[float]:
    return [away_m * math.cos(bearing), away_m * math.sin(bearing)]


def _person(rng: np.random.Generator, number: int, bearing: float, stay_m: float) -> dict[str, Any]:
    """Return a person who comes from afar, stays, reaches into the robot's path, and leaves."""
    speed = float(rng.uniform(0.6, 1.8))
    near_m = float(rng.uniform(0.95, 1.25))
    reach = {
        "do": "reach", "hand": str(rng.choice(["left", "right"])),
        "to": [*_at(bearing, near_m - 0.45), float(rng.uniform(*REACH_Z_M))],
        "hold_s": float(rng.uniform(0.5, 3.0)),
    }  # fmt: skip
    return {
        "id": number,
        "start": _at(bearing + float(rng.uniform(-0.5, 0.5)), 5.0),
        "height_m": float(rng.uniform(1.6, 1.9)),
        "enter_s": float(rng.uniform(0.0, 3.0)),
        "repeat": False,
        "script": [
            {"do": "walk", "to": _at(bearing, stay_m), "speed_m_s": speed},
            {"do": "wait", "seconds": float(rng.uniform(0.2, 6.0))},
            {"do": "walk", "to": _at(bearing, near_m), "speed_m_s": speed},
            reach,
            {"do": "walk", "to": _at(bearing + 0.3, 4.5), "speed_m_s": speed},
            {"do": "wait", "seconds": 3600.0},
        ],
    }


def _box(rng: np.random.Generator, place: Sequence[float], camera: Sequence[float]) -> list[float]:
    """Return a box between a place and the camera that hides it wholly or partly."""
    way = np.array(camera[:2]) - place
    middle = np.array(place) + way / np.hypot(*way) * rng.uniform(0.5, 0.9)
    half = rng.uniform(0.2, 0.7, 2)
    low, high = middle - half, middle + half
    return [*low.tolist(), *high.tolist(), float(rng.uniform(0.9, 2.2))]


def configured(base: Config, episode: Episode, mode: str, *, free_space: bool) -> Config:
    """Return the configuration of one episode in one mode.

    Raises:
        ConfigError: the base configuration does not fit.
    """
    floor = {
        "polygon": [[-ROOM_M, -ROOM_M], [ROOM_M, -ROOM_M], [ROOM_M, ROOM_M], [-ROOM_M, ROOM_M]]
    }
    occlude = {
        "kind": "occlude",
        "cameras": episode.cameras,
        "boxes": episode.boxes,
        "rename": episode.rename,
    }
    source: dict[str, Any] = {
        "kind": "procedural",
        "people": episode.people,
        "rate_hz": episode.rate_hz,
        "noise_m": 0.005,
        "keeps_ids": episode.rename == 0.0,
        "faults": [occlude],
    }
    people: dict[str, Any] = {}
    if free_space:
        source |= {
            "field_of_view": floor,
            "sees_free_space": True,
            "viewpoints": episode.cameras,
            "shadows": shadows_of(episode.boxes, episode.cameras, ROOM_M),
        }
        people["room"] = floor
    node = base.node.model_copy(
        update={
            "risk": base.node.risk.model_copy(update={"mode": mode}),
            "people": validated(PeopleSettings, people, "people"),
        }
    )
    # zones and poses are for those who watch; without them an episode takes a third less time
    links = tuple(link.model_copy(update={"zones": False}) for link in base.links)
    return replace(base, node=node, links=links).with_source(source)


class _Watch(View):
    """Sums the permitted speeds."""

    def __init__(self) -> None:
        self.ticks = 0
        self.permitted = 0.0
        self.lost = 0

    def on_tick(self, tick: Tick) -> None:
        """Record the first robot's advice."""
        if tick.snapshot is None:
            return
        advice = tick.advices[0]
        self.ticks += 1
        self.permitted += advice.speed_limit_m_s or 0.0
        self.lost += bool(tick.snapshot.lost)


def play(request: OcclusionRequest, index: int) -> list[OcclusionRow]:
    """Play one episode in each mode.

    Raises:
        HriPredictError: it cannot run.
    """
    base = _base(request)
    episode = _possible(base, request, index)
    rows = []
    for mode in request.modes:
        watch = _Watch()
        config = configured(base, episode, mode, free_space=request.free_space)
        summary = run(config, Options(factor=None, duration_s=DURATION_S, view=watch))
        assert summary.contacts is not None  # a referee saw it, as every robot has a drive
        assert summary.contacts_standing is not None
        fastest = base.node.robots[0].max_speed_m_s
        rows.append(
            OcclusionRow(
                index=index,
                mode=mode,
                contacts=summary.contacts,
                contacts_standing=summary.contacts_standing,
                permitted=watch.permitted / max(watch.ticks, 1) / fastest,
                lost=watch.lost / max(watch.ticks, 1),
            )
        )
    return rows


def _base(request: OcclusionRequest) -> Config:
    config = configuration.load(request.config).quiet()
    return config if request.predictor is None else with_predictor(config, request.predictor)


def _possible(base: Config, request: OcclusionRequest, index: int) -> Episode:
    """Return the first draw whose people can perform their scripts; arms have limited reach.

    If the source does not see free space, the tracker must show each person once: a node cannot
    know of a person who walks in a box's shadow from the door to the robot.
    """
    for attempt in range(_TRIES):
        seed = request.seed * _TRIES + attempt
        episode = draw(seed, index, request.rates_hz, request.cameras)
        if not request.occlude:
            episode = replace(episode, boxes=[], cameras=[[0.0, 0.0, 50.0]], rename=0.0)
        try:
            named = replace(episode, rename=0.0)  # so that ids are people
            source = assemble.build_source(configured(base, named, "iso", free_space=False))
        except HriPredictError:
            continue
        if request.free_space or _shows(source) == len(episode.people):
            return episode
    raise ConfigError(f"--seed {request.seed}: episode {index} cannot be drawn; take another seed")


def _shows(source: Source) -> int:
    """Return how many people a source shows during an episode."""
    source.open(0)
    shown: set[int] = set()
    while (due_ns := source.next_ns()) is not None and due_ns < DURATION_S * 1e9:
        if (scene := source.poll(due_ns)) is not None:
            shown.update(person.id for person in scene.people)
    return len(shown)


def simulate(
    request: OcclusionRequest, progress: Callable[[int, int], None]
) -> Iterator[OcclusionRow]:
    """Play all episodes; yield the rows of each, in their order.

    Raises:
        HriPredictError: the configuration cannot be simulated.
    """
    base = _base(request)
    manned(base)
    indices = range(request.first, request.first + request.episodes)
    progress(0, request.episodes)
    tasks = [(request, index) for index in indices]
    found: dict[int, list[OcclusionRow]] = {}
    with workers_for(request.jobs, request.cluster, read_files([base], [])) as workers:
        for done, (place, rows) in enumerate(workers.each(play, tasks), 1):
            found[place] = rows
            progress(done, request.episodes)
    for place in range(len(tasks)):
        yield from found[place]
