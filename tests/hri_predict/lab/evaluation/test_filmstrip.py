"""The filmstrip shows one window of each action, chosen without regard to any forecast."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from hri_predict.lab.evaluation.filmstrip import bones, draw, middle, write_filmstrips
from hri_predict.lab.evaluation.recordings import baselines, built, forecast
from hri_predict.lab.evaluation.windows import Motion, origins
from hri_predict.predictors.neural.body import BODY

JOINTS = len(BODY.joints)
STEP_NS = 40_000_000


def wave(name: str, seconds: float = 4.0, seen=slice(None)) -> Motion:
    """A body of which each joint swings by itself, at 25 Hz."""
    steps = np.arange(round(25 * seconds) + 1)
    rest = np.random.default_rng(5).normal(size=(JOINTS, 3), scale=0.3)
    swing = np.sin(steps[:, None, None] / 9 + rest) * (0.1 + steps[:, None, None] / 500)
    observed = np.zeros((len(steps), JOINTS), bool)
    observed[:, seen] = True
    action = name.rpartition("_")[0]
    return Motion(
        name=name,
        action=action,
        stamps_ns=steps * STEP_NS,
        positions=rest + swing,
        observed=observed,
        rate_hz=25.0,
    )


def texts(figure) -> list[list[str]]:
    return [[text.get_text() for text in axes.texts] for axes in figure.axes]


def test_the_window_is_the_middle_origin_of_the_longest_recording():
    longest = wave("walking_2", 30.0)  # more origins than a batch holds
    scene = middle([wave("walking_1"), longest, wave("walking_3", 2.0)], 20)
    assert scene is not None
    times, _ = origins(longest)
    assert scene.recording == "walking_2"
    assert scene.time_s == pytest.approx(times[len(times) // 2] * 1e-9)
    step = round(scene.time_s * 25)
    assert scene.window.history.shape[:2] == (1, 20)
    for ms, at in ((0, step), (-160, step - 4), (400, step + 10), (1000, step + 25)):
        positions, known = scene.true(ms)
        assert known.all()
        assert positions == pytest.approx(longest.positions[at])


def test_no_window_without_a_second_of_known_future():
    assert middle([wave("running_1", 1.5)], 15) is None
    assert middle([], 15) is None


def test_a_picture_per_time_tells_the_error_and_that_of_standing_still():
    scene = middle([wave("walking_1")], 15)
    assert scene is not None
    predictor = built(baselines()["zero_velocity"])
    whole = forecast(predictor, scene.window)[0]
    shown = texts(draw("kalman", [scene], [whole]))
    scored = [j for j, name in enumerate(BODY.joints) if name[2:] != "hip"]
    moved = np.linalg.norm(scene.true(1000)[0] - scene.true(0)[0], axis=-1)[scored].mean()
    assert shown[-1] == [f"{1000 * moved:.0f} mm", f"still: {1000 * moved:.0f}"]
    assert shown[0] == ["walking_1, 1.8 s", "0.5 m"]
    short = texts(draw("kalman", [scene], [whole[:10]]))
    assert short[2] == shown[2]  # 400 ms
    assert short[3:] == [["beyond its horizon"]] * 3


@pytest.mark.long
def test_a_file_per_predictor_of_the_actions_asked_for(tmp_path):
    both = {name: built(baselines()[name]) for name in ("zero_velocity", "kalman")}
    arms = [j for j, name in enumerate(BODY.joints) if name[2:] in ("shoulder", "elbow", "wrist")]
    motions = [wave("walking_1"), wave("arms_1", seen=arms)]
    files = write_filmstrips(both, motions, tmp_path / "new", ["walking", "arms", "running"])
    assert [f.name for f in files] == ["filmstrip_zero_velocity.png", "filmstrip_kalman.png"]
    assert all(f.stat().st_size > 10_000 for f in files)
    assert files[0].read_bytes() != files[1].read_bytes()
    assert write_filmstrips(both, motions, tmp_path, ["running"]) == []


def test_a_body_of_a_tracker_that_lacks_joints_is_drawn_in_one_piece():
    """Every pair of seen joints is connected, whatever is missing; bridges are told apart."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        seen = rng.random(JOINTS) < rng.uniform(0.1, 1.0)
        lines = bones(seen)
        assert len(lines) == max(0, seen.sum() - 1)  # as a tree has
        group = {int(joint): {int(joint)} for joint in np.flatnonzero(seen)}
        for joint, other, bridged in lines:
            assert bridged == (BODY.parents[joint] != other)
            both = group[joint] | group[other]
            group.update(dict.fromkeys(both, both))
        assert all(len(connected) == seen.sum() for connected in group.values())


def test_a_body_that_is_seen_whole_has_its_own_bones():
    whole = bones(np.ones(JOINTS, bool))
    assert {(joint, other) for joint, other, _ in whole} == set(enumerate(BODY.parents)) - {(0, -1)}
    assert not any(bridged for *_, bridged in whole)
