"""All kinds of attacks, by name: each draws one from a random generator."""

from collections.abc import Callable, Mapping

import numpy as np

from tests.attacks.kinds import (
    acknowledges,
    controls,
    exits,
    identity,
    occluders,
    robots,
    runners,
    trackers,
)
from tests.attacks.play import Attack

KINDS: Mapping[str, Callable[[np.random.Generator], Attack]] = {
    f"{module.__name__.rpartition('.')[2]}.{draw.__name__}": draw
    for module, draws in (
        (
            identity,
            (
                identity.one_capture,
                identity.slides,
                identity.beside,
                identity.alternates,
                identity.half_seen,
            ),
        ),
        (exits, (exits.inside, exits.passes, exits.crouches)),
        (
            acknowledges,
            (
                acknowledges.zero,
                acknowledges.mirrored,
                acknowledges.guessed,
                acknowledges.forgotten,
            ),
        ),
        (occluders, (occluders.truck,)),
        (robots, (robots.frozen, robots.contradict, robots.muted_again)),
        (
            trackers,
            (
                trackers.repeats,
                trackers.loops,
                trackers.coasts,
                trackers.frozen_without_noise,
                trackers.zeros,
                trackers.hip_centred,
            ),
        ),
        (runners, (runners.runner,)),
        (
            controls,
            (
                controls.stands,
                controls.leaves,
                controls.other_ids,
                controls.half_seen,
                controls.returns,
            ),
        ),
    )
    for draw in draws
}
