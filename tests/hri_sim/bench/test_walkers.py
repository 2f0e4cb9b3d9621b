"""What the cost of judging is measured on: the size it says, and the branch that is dearest."""

from hri_predict.risk.separation.nearest import BodiesInTime
from hri_predict.risk.types import Assessment
from hri_predict.zones.body_zones import BodyZones
from hri_sim.bench import parts


def test_the_measured_tick_is_as_large_as_it_says(monkeypatch):
    seen: list[tuple[tuple[int, ...], int]] = []
    least = BodiesInTime.least

    def spied(self, robots):
        seen.extend((robot.capsules.radius.shape, int(robot.until.max())) for robot in robots)
        return least(self, robots)

    monkeypatch.setattr(BodiesInTime, "least", spied)
    zones, judge = parts.risk_calls()
    bodies, assessment = zones(), judge()
    assert isinstance(bodies, BodyZones)
    assert isinstance(assessment, Assessment)
    people, steps, segments = bodies.zones.capsules.radius.shape
    assert (people, steps - 1, segments) == (4, 25, 20)
    assert len(assessment.advices) == 2
    # both robots: the present speed and all four levels, now and 25 horizons, 8 capsules
    assert [shape for shape, _ in seen] == [(5, 26, 8)] * 2
    assert max(last for _, last in seen) == 25  # the highest level stands only then
    assert "25 horizons x 2 robots x 8 capsules" in parts.TITLE
