"""A8, A10, A11: trackers that repeat, send lost joints as zeros, or send bodies without a place."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.attacks.people import J, at, ease, walk
from tests.attacks.play import RATE_HZ, Attack, Reported


def _visitor(rng: np.random.Generator) -> tuple[Callable[[float], np.ndarray], float, float]:
    """A person who walks up and reaches in; when the walk begins and ends."""
    bearing, speed = float(rng.uniform(-0.2, 0.3)), float(rng.uniform(1.0, 1.6))
    start_s, far = 3.0, at(bearing, float(rng.uniform(3.8, 4.6)))
    there_s = start_s + float(np.hypot(*(far - at(bearing, 1.0)))) / speed
    target = [*at(bearing, 0.7), 0.5]

    def joints(t: float) -> np.ndarray:
        share = ease(t, there_s, 0.5)
        return walk(t, [far, at(bearing, 1.0)], speed, start_s, reach=share, target=target)

    return joints, start_s, there_s


def repeats(rng: np.random.Generator) -> Attack:
    """From a moment within the walk on, the last skeleton again with noise."""
    joints, start_s, there_s = _visitor(rng)
    since_s, noise_m = float(rng.uniform(start_s + 0.25, there_s - 0.6)), rng.uniform(0.0, 0.008)
    return Attack(
        name=f"repeats since {since_s:.2f} s with {noise_m * 1e3:.1f} mm of noise",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(min(t, since_s)))],
        seconds=there_s + 4.0,
        noise_m=float(noise_m),
        declares_noise=True,
    )


def loops(rng: np.random.Generator) -> Attack:
    """A loop of the last captures, bit for bit."""
    joints, start_s, there_s = _visitor(rng)
    since = int(RATE_HZ * rng.uniform(start_s + 0.25, there_s - 0.6))
    period = int(rng.integers(2, 46))
    kept: dict[int, np.ndarray] = {}

    def seen(t: float, k: int) -> list[Reported]:
        if k < since:
            kept[k] = joints(t) + np.random.default_rng(k).normal(0.0, 0.004, (21, 3))
            return [(1, kept[k])]
        return [(1, kept[since - period + (k - since) % period])]

    return Attack(
        name=f"loops {period} captures since capture {since}",
        truth=lambda t: [joints(t)],
        seen=seen,
        seconds=there_s + 4.0,
        noise_m=0.0,
        declares_noise=True,
    )


def coasts(rng: np.random.Generator) -> Attack:
    """The last skeleton goes on at a constant velocity, past the robot."""
    joints, start_s, there_s = _visitor(rng)
    since_s = float(rng.uniform(start_s + 0.4, there_s - 0.6))
    speed, angle = rng.uniform(0.8, 1.6), rng.uniform(0.25, 0.5) * np.pi * rng.choice([-1, 1])
    velocity = speed * np.array([np.cos(angle), np.sin(angle), 0.0])
    return Attack(
        name=f"coasts since {since_s:.2f} s at {np.round(velocity[:2], 1)} m/s",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [
            (1, joints(t) if t < since_s else joints(since_s) + velocity * (t - since_s))
        ],
        seconds=there_s + 4.0,
    )


def frozen_without_noise(rng: np.random.Generator) -> Attack:
    """A source that declares no noise freezes while its stamps go on."""
    joints, start_s, there_s = _visitor(rng)
    since_s = float(rng.uniform(start_s + 0.25, there_s - 0.6))
    return Attack(
        name=f"frozen since {since_s:.2f} s, noise is not declared",
        truth=lambda t: [joints(t)],
        seen=lambda t, k: [(1, joints(min(t, since_s)))],
        seconds=there_s + 4.0,
        noise_m=0.0,
        declares_noise=False,
    )


def zeros(rng: np.random.Generator) -> Attack:
    """The reaching arm is lost, and its joints are sent as the sensor's origin."""
    joints, _, there_s = _visitor(rng)
    origin = (float(rng.uniform(-4.0, 4.0)), float(rng.uniform(-4.0, 4.0)), 1.1)
    since_s = there_s - float(rng.uniform(0.0, 1.5))
    lost = [J[f"r_{name}"] for name in ("elbow", "wrist", "hand")][int(rng.integers(0, 3)) :]

    def seen(t: float, k: int) -> list[Reported]:
        body = joints(t)
        if t >= since_s:
            body[lost] = origin
        return [(1, body)]

    def change(data: dict[str, Any]) -> None:
        data["source"]["room_from_source"] = {"xyz": list(origin)}

    return Attack(
        name=f"{len(lost)} joints sent as zeros of a sensor at {np.round(origin, 1)}",
        truth=lambda t: [joints(t)],
        seen=seen,
        seconds=there_s + 4.0,
        origin=origin,
        change=change,
    )


def hip_centred(rng: np.random.Generator) -> Attack:
    """Coordinates relative to the hips: the person walks into the robot on the spot."""
    joints, _, there_s = _visitor(rng)
    origin = np.array([rng.uniform(2.0, 4.0), rng.uniform(-1.0, 1.0), 0.95])
    exact = bool(rng.random() < 0.5)  # the waist itself has no noise

    def seen(t: float, k: int) -> list[Reported]:
        body = joints(t)
        body = body - body[J["waist"]] + origin
        return [(1, body)]

    return Attack(
        name=f"relative to the hips, at {np.round(origin, 1)}, waist exact: {exact}",
        truth=lambda t: [joints(t)],
        seen=seen,
        seconds=there_s + 3.0,
        noise_m=0.003,
        origin=tuple(origin) if exact else (0.0, 0.0, -9.0),
        change=lambda data: data["source"].update(room_from_source={"xyz": origin.tolist()}),
    )
