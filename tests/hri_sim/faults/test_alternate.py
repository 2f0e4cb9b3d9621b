from tests.hri_sim.faults.test_injector import heard, window


def test_alternate_shows_two_people_in_turn_under_one_id():
    scenes = [s for _, s in heard(window("alternate", person=10, other=11, captures=2))]
    assert [len(s.people) for s in scenes] == [2] * 25 + [1] * 25 + [2] * 50
    assert {s.people[0].id for s in scenes} == {10}
    # the second person of scene k stands at 100 + k
    shown = [s.people[0].positions[0, 0] - k for k, s in enumerate(scenes)]
    assert shown[25:33] == [0.0, 0.0, 100.0, 100.0, 0.0, 0.0, 100.0, 100.0]
