"""``bench``: sections by name, what is saved and compared, and wrong command lines."""

import json

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import ConfigError, LinkError
from hri_sim.bench import command as bench
from hri_sim.bench.rows import Row, Section


def section(*p50: float) -> Section:
    def rows(_scope):
        for number, value in enumerate(p50):
            yield Row(part=f"part {number}", unit="ms", p50=value, p99=2 * value)

    return Section("a section", rows)


def broken() -> Section:
    def rows(_scope):
        yield Row(part="first", unit="ms", p50=1.0)
        raise LinkError("no such wire; plug it in")

    return Section("breaks", rows)


@pytest.fixture(autouse=True)
def two_sections(monkeypatch):
    for name in list(bench.SECTIONS):
        monkeypatch.delitem(bench.SECTIONS, name)
    monkeypatch.setitem(bench.SECTIONS, "fast", section(1.0, 2.0))
    monkeypatch.setitem(bench.SECTIONS, "broken", broken())


def run(*arguments):
    return CliRunner().invoke(bench.app, list(map(str, arguments)))


def test_all_sections_and_none_lost_by_another():
    done = run("--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert [row["part"] for row in told["sections"]["fast"]] == ["part 0", "part 1"]
    assert [row["part"] for row in told["sections"]["broken"]] == ["first", "ended early"]
    assert told["sections"]["broken"][1]["note"] == "no such wire; plug it in"
    assert told["machine"]["cores"] >= 1


def test_only_one_section():
    done = run("--only", "fast", "--json")
    assert list(json.loads(done.stdout)["sections"]) == ["fast"]


def test_a_table():
    done = run("--only", "fast")
    assert "fast: a section" in done.stdout
    assert "part 1" in done.stdout
    assert "cores" in done.stdout


def test_comparing_two_runs(tmp_path, monkeypatch):
    before = tmp_path / "before.json"
    assert run("--only", "fast", "--save", before).exit_code == 0
    same = run("--only", "fast", "--baseline", before)
    assert same.exit_code == 0
    assert "nothing of 2 got worse" in same.stdout
    monkeypatch.setitem(bench.SECTIONS, "fast", section(1.0, 4.0))
    worse = run("--only", "fast", "--baseline", before)
    assert worse.exit_code == 1
    assert "1 of 2 got worse by more than 1.5 times:\n  fast: part 1 (p50 " in worse.stdout
    lenient = run("--only", "fast", "--baseline", before, "--worse-than", "2.5")
    assert lenient.exit_code == 0
    told = json.loads(run("--only", "fast", "--baseline", before, "--json").stdout)
    assert [change["verdict"] for change in told["changes"]] == ["as before", "worse"]


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (["--only", "fest"], "did you mean 'fast'"),
        (["--worse-than", "2"], "has no effect without --baseline"),
        (["--baseline", "none.json"], "none.json: cannot be read: No such file"),
        (["--plot", "a.jpg"], "ends in .png or .svg"),
        (["--quick", "memory"], "--quick: has no effect before memory"),
    ],
)
def test_wrong_options_are_refused_in_one_line(asked, told):
    done = run(*asked)
    assert isinstance(done.exception, ConfigError), done.output
    assert told in str(done.exception)
    assert "\n" not in str(done.exception)


def test_a_baseline_that_is_too_long_is_not_read(tmp_path):
    path = tmp_path / "before.json"
    path.write_text(" " * 1_000_001, encoding="utf-8")
    assert "longer than 1000000 characters" in str(run("--baseline", path).exception)


def test_a_factor_out_of_range_is_refused(tmp_path):
    path = tmp_path / "before.json"
    run("--only", "fast", "--save", path)
    done = run("--baseline", path, "--worse-than", "0.5")
    assert "give 1 to 100" in str(done.exception)


@pytest.mark.parametrize(("flag", "name"), [("--save", "a.json"), ("--plot", "a.png")])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_measured(
    flag, name, tmp_path, monkeypatch
):
    def measured(_scope):
        pytest.fail("measured")

    monkeypatch.setitem(bench.SECTIONS, "fast", Section("no", measured))
    (tmp_path / "file").touch()
    (tmp_path / name).mkdir()
    for path in (tmp_path / "file" / name, tmp_path / name):
        result = run("--only", "fast", flag, path)
        assert isinstance(result.exception, ConfigError)
        assert "name another file" in str(result.exception)


def saved_with(path, **values):
    """Save a run of two rows, and change the figures of the second, or of both."""
    run("--only", "fast", "--save", path)
    told = json.loads(path.read_text(encoding="utf-8"))
    both = values.pop("both", False)
    for row in told["sections"]["fast"][0 if both else 1 :]:
        row.update(values)
    path.write_text(json.dumps(told), encoding="utf-8")


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"p50": 0.0}, "p50 0, now 2: their ratio means nothing"),
        ({"p50": -1.0}, "p50 -1, now 2: their ratio means nothing"),
        ({"p99": float("nan")}, "p99 nan, now 4: their ratio means nothing"),
        ({"unit": "us"}, "the baseline is in us, not in ms"),
        ({"more_is_better": True}, "the other direction"),
        ({"part": "part 7"}, "fast: part 1: new"),
    ],
)
def test_what_was_not_compared_is_counted_and_named(tmp_path, values, why):
    before = tmp_path / "before.json"
    saved_with(before, **values)
    done = run("--only", "fast", "--baseline", before)
    assert done.exit_code == 0, done.output
    assert "nothing of 1 got worse" in done.stdout
    assert "were not compared:" in done.stdout
    assert why in done.stdout


def test_a_baseline_with_which_nothing_compares_fails(tmp_path):
    before = tmp_path / "before.json"
    saved_with(before, both=True, unit="us")
    for flags in ((), ("--json",)):
        done = run("--only", "fast", "--baseline", before, *flags)
        assert done.exit_code == 2
        assert "nothing could be compared" in done.stderr


def test_a_baseline_of_other_sections_is_refused_before_anything_is_measured(tmp_path, monkeypatch):
    before = tmp_path / "before.json"
    run("--only", "fast", "--save", before)

    def never(_scope):
        raise AssertionError("it was measured")
        yield

    monkeypatch.setitem(bench.SECTIONS, "broken", Section("never", never))
    done = run("--only", "broken", "--baseline", before)
    assert isinstance(done.exception, ConfigError)
    assert "has no figure to compare with broken (its sections: fast)" in str(done.exception)
    told = json.loads(before.read_text(encoding="utf-8"))
    told["machine"]["yardstick_us"] = 10**400
    before.write_text(json.dumps(told), encoding="utf-8")
    monkeypatch.setitem(bench.SECTIONS, "fast", Section("never", never))
    done = run("--only", "fast", "--baseline", before)
    assert isinstance(done.exception, ConfigError), done.output
    assert "not a bench of this version" in str(done.exception)
