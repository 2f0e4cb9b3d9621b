"""People, forecasts and checks that the self-check's tests are driven with."""

import numpy as np

from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants

RATE_HZ = 25.0
STEP_S = 1 / RATE_HZ
JOINTS = len(CANONICAL.joints)


def snapshot(tick, bodies, ids=(1,), observed=None, hz=RATE_HZ):
    """People seen at capture ``tick``: bodies (P, J, 3), observed (P, J)."""
    bodies = np.asarray(bodies, float)
    seen = np.ones(bodies.shape[:2], bool) if observed is None else observed
    capture = 10**9 + round(tick / hz * 1e9)
    return PeopleSnapshot(
        now_ns=capture + 30_000_000,
        ids=tuple(ids),
        history=np.repeat(np.nan_to_num(bodies)[:, None], 25, axis=1),
        observed=np.repeat(seen[:, None], 25, axis=1),
        capture_ns=np.full(len(ids), capture),
        last_positions=bodies,
        joint_age_s=np.where(seen, 0.0, 0.2),
        lost=(),
        reasons=(),
        newest_capture_ns=capture,
        captures=tick + 1,
        counters={},
    )


def still(people=1):
    return np.zeros((people, JOINTS, 3))


def forecast_off_by(metres, steps, people=1, joints=slice(None)):
    """Everybody stays, but for an error along x that is there from the first step on."""
    positions = np.zeros((people, steps, JOINTS, 3))
    positions[:, :, joints, 0] = metres
    return Forecast(positions, None)


def checker(steps=3, level=0.99, of="body", **settings):
    return SelfCheck(
        SelfCheckConstants(**settings),
        level=level,
        of=of,
        rate_hz=RATE_HZ,
        horizon_steps=steps,
        ranges=None,
    )


def radius(value, steps, people=1):
    return np.full((people, steps, JOINTS), value)


def drive(check, ticks, off, claimed=0.1, steps=3, start=0, **kwargs):
    """Tick by tick with forecasts that are ``off``; the trust of each tick."""
    trusts = []
    for tick in range(start, start + ticks):
        snap = snapshot(tick, still(), **kwargs)
        trusts.append(check.check(snap))
        check.note(snap, forecast_off_by(off, steps), radius(claimed, steps))
    return trusts
