"""A schema without advice: the mock controller forgets it, since another node may follow."""

from tests.hri_sim.controllers.test_controller import GOOD, Pair, running


def test_a_schema_that_no_advice_follows_is_forgotten():
    pair = Pair().run(1, advice=None)
    pair.run(9999, advice=None, schema=None)  # another node, of another version, may follow
    pair.run(300, schema=None)
    assert max(pair.speeds) == 0.0
    assert pair.causes[-1] == "schema"
    pair.run(900)
    assert pair.moving


def test_after_a_silence_as_well_a_schema_that_no_advice_follows_is_forgotten():
    pair = running()
    pair.run(1500, advice=None, schema=None)
    pair.run(1, advice=None)
    at = pair.ms
    pair.run(1099, advice=None, schema=None)
    pair.run(300, schema=None)
    assert max(pair.speeds[at:]) == 0.0
    pair.run(900)
    assert pair.moving


def test_a_schema_is_known_for_a_second_without_advice():
    pair = Pair().run(1, advice=None)
    pair.run(959, advice=None, schema=None)
    pair.run(40)
    pair.run(300, schema=None)
    assert pair.moving
    assert pair.core.report().counter_errors == 0


def test_with_a_schema_that_no_advice_follows_the_counters_are_forgotten():
    pair = Pair("can").run(1, schema=None)  # its counter counts although no Schema came before
    pair.run(1000, advice=None)
    for _ in range(30):
        pair.node.encode(GOOD)  # lost
    pair.run(1999, advice=None, schema=None)
    pair.run(300)
    assert pair.moving
    assert pair.core.report().counter_errors == 0
