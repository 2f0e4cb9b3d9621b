import pytest

from hri_predict.joint_map import load_joint_map
from hri_predict.people import People
from hri_predict.people_settings import PeopleSettings
from hri_predict.scene import Scene
from hri_predict.settings import Pose
from hri_predict.source import SourceSettings

MS = 1_000_000


class Room:
    """A source and a people stage on one clock; scenes arrive ``latency`` after capture."""

    rate_hz = 25.0
    steps = 10

    def __init__(
        self, declares_noise=False, source=None, joint_map="canonical", latency=5 * MS, **people
    ):
        self.people = People(
            PeopleSettings(**people),
            load_joint_map(joint_map),
            SourceSettings(
                kind="test", room_from_source=Pose(), min_latency_s=latency / 1e9, **(source or {})
            ),
            self.rate_hz,
            declares_noise,
            self.steps,
            self.rate_hz,
        )
        self.latency = latency
        self.now = 1_000_000 * MS
        self.sequence = 100

    def see(self, *persons, times=1, sees_room=True, step=1, stamp_error=0):
        for _ in range(times):
            self.now += 40 * MS
            self.sequence += step
            scene = Scene(self.now - self.latency + stamp_error, self.sequence, sees_room, persons)
            self.people.receive(scene, self.now)
        return self.snapshot()

    def snapshot(self, later=0):
        return self.people.snapshot(self.now + later)

    def count(self, name):
        return self.snapshot().counters.get(name, 0)


@pytest.fixture(scope="session")
def make_room() -> type[Room]:
    return Room
