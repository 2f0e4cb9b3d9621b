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
    assert "1 of 2 got worse by more than 1.5 times:\n  fast: part 1" in worse.stdout
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
