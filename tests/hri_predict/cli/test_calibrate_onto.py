"""``hri-predict calibrate --onto``: a calibration moved to a site; one clear line for a mistake."""

import json
from datetime import date
from functools import partial

import numpy as np
import pytest

from hri_predict.zones.calibration import load_calibration
from tests.commands import status_of
from tests.hri_predict.cli.test_calibrate import CV, _short_fit, walking  # noqa: F401

run = partial(status_of, "calibrate")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Recordings of many people, their calibration, and recordings of a site."""
    place = tmp_path_factory.mktemp("place")
    for folder, seeds in (("many", range(4)), ("site", range(10, 13))):
        (place / folder).mkdir()
        for seed in seeds:
            walking(place / folder / f"walking_{seed}.npz", seed)
    assert run(*CV, "--data", place / "many", "--out", place / "base.json") == 0
    return place


@pytest.fixture
def refused(capsys):
    """The only line that a mistake gives."""

    def call(*arguments):
        capsys.readouterr()
        assert run(*arguments) == 2
        out, err = capsys.readouterr()
        assert out == ""
        (line,) = err.splitlines()
        return line

    return call


@pytest.mark.long
def test_a_calibration_is_moved_and_says_what_it_gained(place, tmp_path, capsys):
    out, report = tmp_path / "site.json", tmp_path / "page"
    where = ["--data", place / "site", "--onto", place / "base.json"]
    assert run(*CV, *where, "--out", out, "--report", report, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads((report / "site.json").read_text())
    assert told["parts"] == 3
    assert {m["when"] for m in told["measured"]} == {"before", "after"}
    assert all(0 <= share <= 1 for m in told["measured"] for share in m["held"])
    assert (report / "site.md").read_text().startswith("# Zones of constant_velocity")
    base, made = load_calibration(place / "base.json"), load_calibration(out)
    assert made.recordings == base.recordings
    assert made.scale.to_json() == base.scale.to_json()
    assert made.made == date.today() or made.made is not None  # over midnight
    assert made.site is not None
    names = [r.name for r in made.site.recordings]
    assert names == [f"walking_{n} from minute 0" for n in (10, 11, 12)]
    assert all(r.digest for r in made.site.recordings)
    for of in ("joint", "body"):
        assert (np.isfinite(made.estimated[of]) >= np.isfinite(base.estimated[of])).all()
        assert (made.guaranteed[of] >= base.guaranteed[of]).all()


def test_of_one_part_nothing_can_be_held_out(place, tmp_path, capsys):
    one = ["--data", place / "site" / "walking_10.npz", "--onto", place / "base.json"]
    assert run(*CV, *one, "--out", tmp_path / "site.json", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    after = [m for m in told["measured"] if m["when"] == "after"]
    assert all(share is None for m in after for share in m["held"])
    assert any("record longer" in note for note in told["notes"])


def test_what_moves_no_zone_is_told_as_too_little(place, tmp_path, capsys, monkeypatch):
    one = ["--data", place / "site" / "walking_10.npz", "--onto", place / "base.json"]
    assert run(*CV, *one, "--out", tmp_path / "moved.json", "--json") == 0
    said = "too little data to change the zones (parts by speed: "
    assert said not in capsys.readouterr().out
    # a part with no window of any speed, as of somebody whose trunk is hardly ever seen
    monkeypatch.setattr("hri_predict.lab.calibration.site.mixing.FULL_WINDOWS", 10**9)
    assert run(*CV, *one, "--out", tmp_path / "same.json", "--json") == 0
    assert said in json.loads(capsys.readouterr().out)["notes"][0]


def test_a_recording_of_the_base_would_count_twice(place, tmp_path, refused):
    data = ["--data", place / "many" / "walking_0.npz", "--onto", place / "base.json"]
    line = refused(*CV, *data, "--out", tmp_path / "site.json")
    assert "is part of the base calibration and would count twice; leave it out" in line


def test_a_calibration_of_another_predictor_is_refused(place, tmp_path, refused):
    data = ["--data", place / "site", "--onto", place / "base.json"]
    line = refused("--predictor", "zero_velocity", *data, "--out", tmp_path / "site.json")
    assert "is of predictor constant_velocity, not zero_velocity; give" in line


def test_a_moved_calibration_is_not_moved_again(place, tmp_path, refused):
    out = tmp_path / "site.json"
    data = ["--data", place / "site", "--onto"]
    assert run(*CV, *data, place / "base.json", "--out", out) == 0
    line = refused(*CV, *data, out, "--out", tmp_path / "again.json")
    assert "was already moved to a site; give the original calibration" in line


def test_the_base_is_not_overwritten(place, refused):
    base = place / "base.json"
    line = refused(*CV, "--data", place / "site", "--onto", base, "--out", base)
    assert "is the base calibration, which is not overwritten; name another file" in line


def test_a_recording_without_anybody_is_refused(place, tmp_path, refused, capsys):
    walking(tmp_path / "short.npz", 1, frames=40)
    data = ["--data", tmp_path / "short.npz", "--onto", place / "base.json"]
    assert run(*CV, *data, "--out", tmp_path / "site.json") == 2
    lines = capsys.readouterr().err.splitlines()
    assert "left out" in lines[0]
    assert "no other recording is left; record while people work" in lines[-1]


@pytest.mark.parametrize("horizon", ["0.8", "1.21"])  # 1.21 takes one step more
def test_another_horizon_is_refused(place, tmp_path, refused, horizon):
    data = ["--data", place / "site", "--onto", place / "base.json", "--horizon", horizon]
    line = refused(*CV, *data, "--out", tmp_path / "site.json")
    assert "reaches 1.2 s; give --horizon 1.2" in line


@pytest.mark.parametrize("again", ["0.5", "0.52"])  # 0.52 s is what the base covers
def test_the_horizon_of_the_base_is_accepted_though_it_is_not_whole_steps(place, tmp_path, again):
    base, short = tmp_path / "short.json", ["--horizon", "0.5"]
    assert run(*CV, "--data", place / "many", *short, "--out", base) == 0
    data = ["--data", place / "site", "--onto", base, "--horizon", again]
    assert run(*CV, *data, "--out", tmp_path / "site.json") == 0


@pytest.mark.parametrize(
    "flags",
    [["--report", "r"], ["--onto", "shipped", "--check"], ["--onto", "shipped", "--tracked"]],
)
def test_flags_without_effect_are_refused(place, refused, flags):
    assert "has no effect" in refused(*CV, "--data", place / "site", *flags)
