"""The plot: files of both kinds, and wrong ones refused before anything is measured."""

import re

import pytest

from hri_predict.base.errors import ConfigError
from hri_sim.bench import plot
from hri_sim.bench.rows import Row

SECTIONS = {
    "scaling": [
        Row(part=f"tick, {n}", unit="ms", p50=n, p99=2 * n, axis="people", size=n, series="sinn")
        for n in (1.0, 4.0, 16.0)
    ],
    "parts": [Row(part=f"part {k}", unit="µs", p50=1.0 + k, p99=9.0, max=20.0, aim=3.0)
              for k in range(20)],
    "jitter": [Row(part="bus", unit="ms", note="not here")],
}  # fmt: skip


@pytest.mark.parametrize(("name", "magic"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml")])
def test_a_plot_of_each_kind(tmp_path, name, magic):
    pytest.importorskip("matplotlib", reason="matplotlib is an extra")
    path = tmp_path / name
    plot.check(path)
    plot.plot(path, SECTIONS, "a machine")
    assert path.read_bytes().startswith(magic)


def test_the_smallest_of_many_rows_are_left_out_and_this_is_said():
    ((title, rows),) = plot._panels("parts", SECTIONS["parts"])
    assert title == "parts, µs (the 14 largest of 20)"
    assert [row.p50 for row in rows] == [7.0 + k for k in range(14)]


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"ends in \.png or \.svg"):
        plot.check(tmp_path / "a.jpg")


def test_a_missing_library_is_one_line(tmp_path, no_matplotlib):
    with pytest.raises(
        ConfigError,
        match=re.escape("matplotlib; install it with: pip install 'hri-predict[plots]'"),
    ):
        plot.check(tmp_path / "a.png")
