"""What one camera makes of moving people: noise of the joints, people who cross, a poster, mirrors.

``python -m tests.camera_place.films --model PACKAGE``, from the checkout's root, as the command of
the package; three minutes of one core. Films of recorded bodies go through the whole pipeline of
``hri-predict camera``. Prints the tables of docs/measured/camera-place.md; ``--keep FOLDER`` writes
each film as a video, which ``hri-predict camera`` plays.
"""

import argparse
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from hri_drivers.camera.network import package
from hri_drivers.camera.network.blazepose import BlazePose
from hri_drivers.camera.network.runtime import load_net
from hri_drivers.camera.pipeline import Pipeline
from hri_drivers.camera.place.camera import OPTICAL_FROM_REP103
from hri_drivers.camera.placing import Placer
from hri_drivers.camera.seen import Image, UInt8
from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats
from tests.camera_place.__main__ import CAMERA, DATA, PAIRS
from tests.camera_place.figure import figure, render

HZ = 30
BANDS_HZ = ((0.3, 1.0), (1.0, 3.0), (3.0, 7.0), (7.0, 15.0))
Body = dict[str, Floats]
"""Joints by name, (T, 3) metres, in the camera's axes."""
Scene = tuple[tuple[SentPerson, ...], bool]
"""The people that are sent, and whether the room is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Film:
    """People before the camera.

    Attributes:
        people: real ones.
        images: of people who are not there: mirrored or printed.
        seconds: length.
    """

    people: Sequence[Body]
    images: Sequence[Body] = ()
    seconds: float = 2.4

    def pictures(self, random: np.random.Generator) -> Iterator[UInt8]:
        """Yield the pictures; the background's noise is the same in all of them."""
        seed = int(random.integers(1 << 30))
        for n in range(int(self.seconds * HZ)):
            bodies = [{k: v[n] for k, v in b.items()} for b in (*self.people, *self.images)]
            parts = [part for body in bodies for part in figure(body)]
            picture = render(parts, CAMERA, np.random.default_rng(seed))
            grain = random.normal(0, 2, picture.shape)  # the same picture twice is a frozen camera
            yield np.clip(picture + grain, 0, 255).astype(np.uint8)


class Scenes:
    """Keeps what would be sent to the node, one entry a picture."""

    scenes = unsent = clock_steps = 0

    def __init__(self) -> None:
        self.sent: list[Scene] = []

    def send(self, people: tuple[SentPerson, ...], *, sees_room: bool, **_: Any) -> None:
        """Keep one scene."""
        self.sent.append((people, sees_room))


class Still:
    """An input that has no pictures of its own: ``Pipeline.take`` is given them."""

    dropped = 0


def recorded(name: str, middle: tuple[float, float], turned_deg: float, seconds: float) -> Body:
    """Return a recorded body whose mean place is ``middle``: x and z metres, hips 0.1 m below."""
    data = np.load(DATA / name)
    step = round(float(data["fps"])) // HZ
    frames = data["positions"][::step][: int(seconds * HZ)].astype(np.float64)
    angle = math.radians(turned_deg)
    c, s = math.cos(angle), math.sin(angle)
    turned = (frames - frames.mean(axis=(0, 1))) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    seen = turned @ OPTICAL_FROM_REP103.T + [middle[0], 0.1, middle[1]]
    return {str(n): seen[:, k] for k, n in enumerate(data["joint_names"])}


def mirrored(body: Body, z: float) -> Body:
    """Return the image of a body in a wall of mirrors ``z`` metres before the camera."""
    return {name: places * [1, 1, -1] + [0, 0, 2 * z] for name, places in body.items()}


def frozen(body: Body, length: int) -> Body:
    """Return the first posture of a body, for ``length`` pictures."""
    return {name: np.repeat(places[:1], length, axis=0) for name, places in body.items()}


def play(pictures: Iterable[UInt8], model: Path) -> list[Scene]:
    """Return the people and whether the room is seen, for each picture."""
    detector, landmarks, _ = package.read(model, "full")
    finder = BlazePose(load_net(detector, "detector"), load_net(landmarks, "full"), 4)
    scenes = Scenes()
    pipeline = Pipeline(cast(Any, Still()), finder, Placer(CAMERA), sender=cast(Any, scenes))
    for n, picture in enumerate(pictures):
        before = len(scenes.sent)
        pipeline.take(Image(picture, round((n + 1) * 1e9 / HZ), n))
        assert len(scenes.sent) == before + 1, "one scene for each picture"
    return scenes.sent


def errors(sent: Sequence[Scene], body: Body) -> Floats:
    """Return each joint's error (T, 12, 3) of the only person in a film; NaN where not sent."""
    truth = np.stack([body[name] for name in PAIRS.values()], axis=1)
    found = np.full_like(truth[: len(sent)], np.nan)
    for n, (people, _) in enumerate(sent):
        if people:
            known = people[0].observed[list(PAIRS)]
            found[n, known] = people[0].positions[list(PAIRS)][known]
    return found - truth[: len(sent)]


def noise(name: str, off: Floats, truth: Floats) -> None:
    """Print the error by frequency: of the body along the ray and across, of single joints."""
    whole = np.nanmedian(off, axis=1)
    ray = np.nanmean(truth, axis=1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = np.sum(whole * ray, axis=-1)
    own = np.sum((off - whole[:, None]) * ray[:, None], axis=-1)
    rest = (off - whole[:, None]) - own[..., None] * ray[:, None]
    rows = {
        "body, along the ray": along[:, None],
        "body, across": whole - along[:, None] * ray,
        "single joint, along the ray": own,
        "single joint, across": rest.reshape(len(rest), -1),
    }
    for what, series in rows.items():
        steady = series[:, np.isfinite(series).mean(axis=0) > 0.9]
        axes = {"single joint, across": 3, "body, across": 3}.get(what, 1)
        cells = " | ".join(f"{100 * part:.1f}" for part in spectrum(steady, axes))
        print(f"| {name}: {what} | {cells} |")


def spectrum(series: Floats, axes: int) -> list[float]:
    """Return the constant part and the RMS of each band, metres, of a vector of ``axes`` numbers.

    ``series`` (T, K) holds K / ``axes`` vectors; gaps are filled in linearly.
    """
    times = np.arange(len(series))
    filled = np.empty_like(series)
    for k, one in enumerate(series.T):
        ok = np.isfinite(one)
        filled[:, k] = np.interp(times, times[ok], one[ok])
    mean = filled.mean(axis=0)
    power = np.abs(np.fft.rfft(filled - mean, axis=0)) ** 2 * 2 / len(series) ** 2
    hz = np.fft.rfftfreq(len(series), 1 / HZ)
    per_vector = axes / series.shape[1] if series.shape[1] else np.nan
    squares = [float((mean**2).sum())]
    squares += [float(power[(low <= hz) & (hz < high)].sum()) for low, high in BANDS_HZ]
    return [math.sqrt(square * per_vector) for square in squares]


def story(name: str, film: Film, sent: Sequence[Scene]) -> None:
    """Print what became of the people of a film."""
    ids: set[str] = set()
    near = [0] * len(film.people)
    elsewhere = hidden = 0
    for n, (people, sees_room) in enumerate(sent):
        ids |= {str(person.id) for person in people}
        middles = [_middle(body, n) for body in film.people]
        places = [
            np.median(p.positions[p.observed], axis=0) if p.observed.any() else None for p in people
        ]
        within = [
            [
                place is not None and np.linalg.norm(place - middle) <= person.error_m + 0.3
                for person, place in zip(people, places, strict=True)
            ]
            for middle in middles
        ]
        near = [count + any(row) for count, row in zip(near, within, strict=True)]
        elsewhere += sum(not any(row[k] for row in within) for k in range(len(people)))
        hidden += sees_room and not all(any(row) for row in within)
    share = ", ".join(f"{100 * count / len(sent):.0f}" for count in near)
    print(
        f"| {name} | {share} | {len(ids)} | {100 * elsewhere / len(sent):.0f} | "
        f"{100 * hidden / len(sent):.0f} |"
    )


def _middle(body: Body, n: int) -> Floats:
    middle: Floats = np.median([body[name][n] for name in PAIRS.values()], axis=0)
    return middle


def films() -> dict[str, Film]:
    """Return the films of the stories."""
    walk, stand = "cmu_subjects/02_02.npz", "cmu_subjects/02_05.npz"
    right, left = recorded(walk, (0, 3.6), 60, 2.4), recorded(walk, (0, 5.0), 300, 2.4)
    faces, turned = recorded(stand, (-1.0, 2.8), 180, 2.4), recorded(stand, (-1.0, 2.8), 0, 2.4)
    printed = frozen(recorded(stand, (1.5, 5.0), 180, 2.4), len(right["Head"]))
    return {
        "two people cross": Film((right, left)),
        "a person walks by, a poster on the wall": Film((right,), (printed,)),
        "nobody, a poster on the wall": Film((), (printed,)),
        "a person faces the camera, a mirror behind": Film((faces,), (mirrored(faces, 4.0),)),
        "a person faces a mirror, the back to the camera": Film(
            (turned,), (mirrored(turned, 4.0),)
        ),
        "a mirror alone shows a person beside the camera": Film(
            (beside := recorded(stand, (1.0, -0.5), 0, 2.4),), (mirrored(beside, 2.5),)
        ),
    }


def measure_noise(random: np.random.Generator, model: Path) -> None:
    """Print the noise of each joint in three films."""
    print("| error, cm | constant |", " | ".join(f"{a:g} to {b:g} Hz" for a, b in BANDS_HZ), "|")
    for name, (file, seconds) in {
        "strikes, on the spot": ("cmu_subjects/02_05.npz", 12.0),
        "dances, on the spot": ("cmu_subjects/05_12.npz", 10.0),
        "walks away": ("cmu_subjects/02_02.npz", 2.4),
    }.items():
        body = recorded(file, (0, 3.5), 180, seconds)
        sent = play(Film((body,), seconds=seconds).pictures(random), model)
        truth = np.stack([body[joint] for joint in PAIRS.values()], axis=1)[: len(sent)]
        noise(name, errors(sent, body), truth)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.camera_place.films")
    parser.add_argument("--model", type=Path, default=package.kept_at())
    parser.add_argument("--stories", action="store_true", help="leave the noise out")
    parser.add_argument("--keep", type=Path, help="folder for the films")
    asked = parser.parse_args()
    random = np.random.default_rng(1)
    shown = films()
    if not asked.stories:
        measure_noise(random, asked.model)
    print("\n| film | each at the right place, % | ids | nobody there, % | missed, % |")
    for name, film in shown.items():
        pictures = list(film.pictures(random))
        if asked.keep:
            asked.keep.mkdir(parents=True, exist_ok=True)
            keep(pictures, asked.keep / f"{name.replace(' ', '-').replace(',', '')}.avi")
        story(name, film, play(pictures, asked.model))


def keep(pictures: Sequence[UInt8], path: Path) -> None:
    """Write a film as a video."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), HZ, CAMERA.size)
    for picture in pictures:
        video.write(picture)
    video.release()


if __name__ == "__main__":
    main()
