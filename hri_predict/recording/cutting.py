"""Parts of recordings: by time, rate or person. Frames are dropped, never invented."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.scene import Scene
from hri_predict.recording.recording import Recording

_LEAST_SHARE = 0.5
"""Share of scenes with people to keep when scenes are dropped, of their share in the recording."""


def between(recording: Recording, start_s: float, end_s: float | None) -> Recording:
    """Return the part from ``start_s`` to ``end_s`` after the first arrival, with its messages.

    Raises:
        RecordingError: the part is empty.
    """
    if start_s == 0 and end_s is None:
        return recording
    begin_ns = recording.arrival_ns[0] + round(start_s * 1e9)
    until_s = math.inf if end_s is None else end_s
    end_ns = recording.arrival_ns[0] + until_s * 1e9
    outputs_ns = recording.outputs_ns
    if outputs_ns is not None:
        outputs_ns = max(begin_ns, outputs_ns[0]), int(min(end_ns, outputs_ns[1]))
    kept = [k for k, ns in enumerate(recording.arrival_ns) if begin_ns <= ns <= end_ns]
    if not kept:
        raise RecordingError(
            f"recording {recording.path}: has nothing from {start_s:g} s to {until_s:g} s; "
            f"it lasts {recording.duration_s:.1f} s"
        )
    told = [(link, r) for link, r in recording.received if begin_ns <= r.received_ns <= end_ns]
    return replace(_chosen(recording, kept), received=told, outputs_ns=outputs_ns)


def decimated(recording: Recording, rate_hz: float) -> Recording:
    """Drop scenes to reduce the rate to ``rate_hz`` as closely as possible.

    A kept scene has the doubts and corrected ids of its whole span, and counts as not seen if any
    scene of the span does.

    In each span of 1 / ``rate_hz``, the scene nearest to the middle is kept; sequences count spans.
    Spans begin at the first scene, or at a later one if otherwise most scenes with people would be
    dropped, as in a recording with people in every second scene only.

    Raises:
        RecordingError: the recording's own rate is lower.
    """
    if math.isclose(rate_hz, recording.rate_hz, rel_tol=1e-6):
        return recording
    if rate_hz > recording.rate_hz:
        raise RecordingError(
            f"recording {recording.path}: {rate_hz:g} per second is above its own "
            f"{recording.rate_hz:g}; frames are dropped, never invented"
        )
    times_ns = true_times(recording)
    kept = _nearest(times_ns, rate_hz, times_ns[0])
    with_people = [any(p.observed.any() for p in scene.people) for scene in recording.scenes]

    def share(kept: Sequence[tuple[int, int]]) -> float:
        return sum(with_people[k] for k, _ in kept) / len(kept)

    if share(kept) < _LEAST_SHARE * sum(with_people) / len(with_people):
        first = [ns for ns in times_ns if (ns - times_ns[0]) * 1e-9 * rate_hz < 1]
        kept = max((_nearest(times_ns, rate_hz, ns) for ns in first), key=share)
    chosen = _chosen(recording, [k for k, _ in kept])
    spans = _spans(recording.scenes, [k for k, _ in kept], times_ns)
    numbered = [
        replace(_of_span(scene, span), sequence=slot)
        for scene, span, (_, slot) in zip(chosen.scenes, spans, kept, strict=True)
    ]
    return replace(chosen, scenes=numbered, rate_hz=rate_hz)


def _spans(
    scenes: Sequence[Scene], kept: Sequence[int], times_ns: Sequence[int]
) -> list[list[Scene]]:
    """Return for each kept scene all scenes to which it is the nearest."""
    spans: list[list[Scene]] = [[] for _ in kept]
    at = 0
    for scene, ns in zip(scenes, times_ns, strict=True):
        while at + 1 < len(kept) and abs(times_ns[kept[at + 1]] - ns) < abs(
            times_ns[kept[at]] - ns
        ):
            at += 1
        spans[at].append(scene)
    return spans


def _of_span(scene: Scene, span: Sequence[Scene]) -> Scene:
    """Return a scene with what the dropped ones beside it say against it."""
    return replace(
        scene,
        sees_room=all(each.sees_room for each in span),
        doubts=tuple(dict.fromkeys(doubt for each in span for doubt in each.doubts)),
        joined=tuple(dict.fromkeys(pair for each in span for pair in each.joined)),
    )


def _nearest(times_ns: Sequence[int], rate_hz: float, start_ns: int) -> list[tuple[int, int]]:
    """Return the scene nearest to the middle of each span from ``start_ns``, and its number."""
    nearest: dict[int, tuple[float, int]] = {}
    for k, ns in enumerate(times_ns):
        place = (ns - start_ns) * 1e-9 * rate_hz
        away = abs(place - round(place))
        if ns >= start_ns and away < nearest.get(round(place), (math.inf, 0))[0]:
            nearest[round(place)] = away, k
    return sorted((k, slot) for slot, (_, k) in nearest.items())


def of_person(recording: Recording, person: int) -> tuple[Recording, int]:
    """Return only this person, without the node's output, and the number of others left out.

    Raises:
        RecordingError: the person is in no scene.
    """
    ids = people_of(recording)
    if person not in ids:
        there = ", ".join(map(str, ids)) or "none"
        raise RecordingError(f"recording {recording.path}: no person {person}; it has {there}")
    scenes = [_only(scene, person) for scene in recording.scenes]
    return replace(recording, scenes=scenes, outputs_ns=None), len(ids) - 1


def people_of(recording: Recording) -> list[int]:
    """Return the ids of all people in any scene, in order of their numbers."""
    return sorted({person.id for scene in recording.scenes for person in scene.people})


def true_times(recording: Recording) -> Sequence[int]:
    """Times of the scenes, ns: captures if the source's clock ran like the node's, or arrivals."""
    captures = [scene.stamp_ns for scene in recording.scenes]
    in_order = all(a < b for a, b in itertools.pairwise(captures))
    span_ns = captures[-1] - captures[0]
    arrived_ns = recording.arrival_ns[-1] - recording.arrival_ns[0]
    fits = abs(span_ns - arrived_ns) < 1_000_000_000
    return captures if in_order and fits else recording.arrival_ns


def _only(scene: Scene, person: int) -> Scene:
    return replace(scene, people=tuple(p for p in scene.people if p.id == person))


def _chosen(recording: Recording, kept: Sequence[int]) -> Recording:
    return replace(
        recording,
        scenes=[recording.scenes[k] for k in kept],
        arrival_ns=[recording.arrival_ns[k] for k in kept],
        utc_ns=[recording.utc_ns[k] for k in kept] if recording.utc_ns else (),
    )
