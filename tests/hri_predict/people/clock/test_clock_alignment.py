import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.people.clock.clock_alignment import JUMPED_SCENES, ClockAlignment
from hri_predict.people.clock.offset_line import MAX_DRIFT

MS = 1_000_000
S = 1000 * MS
PERIOD = 40 * MS
OFFSET = 7_000 * S  # the source's clock is that far behind the node's


class Sender:
    """A source with a clock of its own; knows the true capture times."""

    def __init__(self, alignment):
        self.alignment = alignment
        self.true_ns = 10_000 * S
        self.sequence = 0
        self.receipt_ns = 0

    def send(self, latency=5 * MS, stamp_error=0, steps=1, wait=PERIOD):
        """Send the next capture; returns how wrong its aligned capture is (+ = too new)."""
        self.sequence += steps
        self.true_ns += wait
        self.receipt_ns = max(self.receipt_ns, self.true_ns + latency)
        stamp = self.true_ns - OFFSET + stamp_error
        capture = self.alignment.align(stamp, self.sequence, self.receipt_ns)
        assert capture <= self.receipt_ns
        return capture - self.true_ns

    def send_many(self, count, **kwargs):
        return [self.send(**kwargs) for _ in range(count)]


@pytest.fixture
def sender():
    return Sender(ClockAlignment(PERIOD, 5 * MS))


def test_even_latency_is_aligned_exactly(sender):
    assert sender.send_many(100) == [0] * 100
    assert sender.alignment.offset_ns == OFFSET
    assert not sender.alignment.jumped


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_jitter_never_makes_a_capture_much_too_new(seed, spread_ms):
    rng = np.random.default_rng(seed)
    sender = Sender(ClockAlignment(PERIOD, 5 * MS))
    latencies = 5 * MS + rng.integers(0, spread_ms * MS, 500)
    latencies[::7] = 5 * MS  # some come at once
    errors = [sender.send(latency=int(latency)) for latency in latencies]
    assert sender.alignment.jumps == 0
    # at first nothing is known; afterwards drift of 1 ms/s is all that may be taken for granted
    assert max(errors[50:]) <= 1 * MS
    assert min(errors) >= -1


def test_the_unknown_first_delay_is_unlearnt(sender):
    sender.send(latency=300 * MS)
    errors = sender.send_many(50)
    assert errors[10:] == [0] * 40


def test_an_added_delay_shows_as_age_and_is_said(sender):
    sender.send_many(250)
    assert not sender.alignment.late
    errors = sender.send_many(300 * 25, latency=205 * MS)
    assert sender.alignment.jumps == 0
    assert sender.alignment.late
    # none of it goes into the offset; the clock might run fast, so age may grow a little
    assert max(errors) == 0
    assert min(errors) >= -300 * S * MAX_DRIFT
    # and when the delay goes away, the offset is right again
    assert sender.send_many(60 * 25)[-1] == 0
    assert not sender.alignment.late


@pytest.mark.parametrize("parts_per_million", [-200, -100, 100, 500])
def test_drift_is_followed(sender, parts_per_million):
    gained = [i * PERIOD * parts_per_million // 1_000_000 for i in range(25 * 120)]
    errors = [sender.send(stamp_error=error) for error in gained]
    # a fast clock: the newest scene is the evidence; a slow one: that of a minute must agree
    drift_ms = abs(parts_per_million) * 1e-3
    assert max(errors) <= 10 * drift_ms * MS
    assert min(errors) >= -60 * drift_ms * MS
    assert sender.alignment.jumps == 0


@pytest.mark.parametrize("parts_per_million", [-200, -20, 0, 20, 200])
def test_drift_is_estimated_through_jitter(sender, parts_per_million):
    rng = np.random.default_rng(0)
    for i in range(25 * 120):
        gained = i * PERIOD * parts_per_million // 1_000_000
        sender.send(latency=int(rng.uniform(5 * MS, 25 * MS)), stamp_error=gained)
    estimate = sender.alignment.estimate()
    assert estimate.drift_ppm == pytest.approx(parts_per_million, abs=5)
    assert estimate.offset_ns == sender.alignment.offset_ns
    assert (estimate.jumps, estimate.spikes) == (0, 0)


def test_drift_is_not_known_before_half_a_minute_and_outlasts_a_jump(sender):
    sender.send_many(25 * 25)
    assert sender.alignment.estimate().drift_ppm is None
    sender.send_many(25 * 15)
    assert sender.alignment.estimate().drift_ppm == pytest.approx(0, abs=1e-6)
    sender.send(stamp_error=3600 * S)
    estimate = sender.alignment.estimate()
    assert (estimate.drift_ppm, estimate.jumps) == (pytest.approx(0, abs=1e-6), 1)


@pytest.mark.parametrize("jump", [-3600 * S, -5 * S, -150 * MS, 150 * MS, 5 * S, 10**6 * S])
def test_a_jump_is_recognised_counted_and_carried_across(sender, jump):
    sender.send_many(100)
    errors = sender.send_many(JUMPED_SCENES, stamp_error=jump)
    assert sender.alignment.jumps == 1
    assert sender.alignment.jumped
    assert errors == [0] * JUMPED_SCENES
    assert sender.send_many(100, stamp_error=jump) == [0] * 100
    assert not sender.alignment.jumped
    assert sender.alignment.jumps == 1
    assert sender.alignment.offset_ns == OFFSET - jump


def test_a_jump_is_carried_across_lost_scenes(sender):
    sender.send_many(100)
    error = sender.send(stamp_error=5 * S, steps=4, wait=4 * PERIOD)
    assert sender.alignment.jumps == 1
    assert error == 0


@pytest.mark.parametrize("spike", [10 * S, 500 * MS, -10 * S, 90 * MS, 30 * MS, 15 * MS, -90 * MS])
def test_a_single_wrong_stamp_poisons_nothing(sender, spike):
    sender.send_many(100)
    sender.send(stamp_error=spike)
    errors = sender.send_many(400)
    if abs(spike) > 20 * MS:
        assert errors == [0] * 400
    else:  # too small to tell from a low latency: older by that much for up to 15 s
        assert all(-spike <= e <= 0 for e in errors)
    assert sender.send_many(400)[-1] == 0


def test_a_pause_is_no_jump(sender):
    sender.send_many(100)
    assert sender.send(wait=60 * S) == 0  # the sequence counts on, the clocks went on
    assert sender.send_many(50) == [0] * 50
    assert sender.alignment.jumps == 0


def test_a_stall_of_the_way_is_age_and_no_jump(sender):
    sender.send_many(100)
    stuck = [sender.send(latency=2 * S - i * PERIOD) for i in range(40)]  # a burst, then on time
    assert stuck == [0] * 40
    assert sender.send_many(50) == [0] * 50
    assert sender.alignment.jumps == 0


def test_a_slower_source_than_declared_is_no_jump(sender):
    assert sender.send_many(100, wait=5 * PERIOD) == [0] * 100
    assert sender.alignment.jumps == 0


def test_a_restarted_source_is_aligned_anew(sender):
    sender.send_many(100)
    sender.alignment.restart()
    sender.true_ns += 30 * S
    error = sender.send(stamp_error=-5000 * S)
    assert error == 0
    assert sender.alignment.jumped
    assert sender.alignment.jumps == 1


@pytest.mark.parametrize("delay_goes_on", [True, False])
def test_a_capture_that_is_late_before_another_clock_leaves_its_delay(sender, delay_goes_on):
    """The late capture is the last word on the delay: with another clock the node hears the same,
    whether the delay goes on or is over. So all are late, and it is said, until a new start."""
    sender.send_many(100)
    sender.send(latency=S)
    sender.alignment.restart()
    latency = S if delay_goes_on else 5 * MS
    sender.true_ns = sender.receipt_ns + 2 * S - latency
    heard = [sender.receipt_ns + 2 * S + k * PERIOD for k in range(1000)]
    errors = sender.send_many(1000, latency=latency, stamp_error=latency - 5000 * S)
    assert sender.receipt_ns - heard[-1] == PERIOD  # the same receipts and stamps in both
    assert max(errors) <= 0
    assert errors[-1] == pytest.approx(0 if delay_goes_on else 5 * MS - S, abs=30 * MS)
    assert sender.alignment.late


def test_a_capture_that_is_late_before_a_restart_with_the_same_clock_leaves_nothing(sender):
    sender.send_many(100)
    sender.send(latency=S)
    sender.alignment.restart()
    assert sender.send(wait=3 * S) == 0
    assert sender.send_many(100) == [0] * 100


def test_a_jump_during_a_pause_does_not_leave_an_old_capture(sender):
    """The sequence cannot bridge it: 20 s, but one step."""
    sender.send_many(100)
    assert sender.send(wait=20 * S, stamp_error=-100 * S) == 0
    assert sender.alignment.jumps == 1


@given(
    st.lists(
        st.tuples(st.integers(-(2**70), 2**70), st.integers(1, 2**40), st.integers(0, 10 * S)),
        max_size=40,
    )
)
def test_any_stamps_give_captures_that_are_not_in_the_future(scenes):
    alignment = ClockAlignment(PERIOD, 5 * MS)
    sequence = receipt = 0
    for stamp, steps, wait in scenes:
        sequence += steps
        receipt += wait
        assert alignment.align(stamp, sequence, receipt) <= receipt - 5 * MS
    # and whatever came before, an even source is soon trusted, with an age that is not too small
    sender = Sender(alignment)
    sender.sequence, sender.true_ns = sequence, receipt
    sender.send_many(JUMPED_SCENES + 5)
    errors = sender.send_many(20)
    assert not alignment.jumped
    assert max(errors) <= 1 * MS


def test_absurd_settings_are_refused():
    with pytest.raises(ValueError, match="period_ns"):
        ClockAlignment(0)


def test_before_anything_has_come_nothing_is_known_of_the_clock():
    assert ClockAlignment(40_000_000).estimate() is None
