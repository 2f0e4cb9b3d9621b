"""Plots are written whole or not at all, and are named once."""

import pytest

pytest.importorskip("matplotlib")

from PIL import Image

from hri_predict.base.errors import ConfigError
from hri_predict.base.figures import Figure, legend_below, panels, write_figure


def drawn() -> Figure:
    figure, grid = panels(4, 3, (2.0, 1.0))
    for axes in grid:
        axes.plot([0, 1], [1, 0], label="a line")
    legend_below(figure)
    return figure


def test_panels_share_one_legend_and_spare_places_are_empty():
    figure = drawn()
    assert [axes.get_visible() for axes in figure.axes] == [True] * 4 + [False] * 2
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a line"]


def test_a_png_has_its_size_and_few_colours(tmp_path):
    path = write_figure(drawn(), tmp_path / "new" / "a.png", dpi=50)
    with Image.open(path) as image:
        assert (image.format, image.size) == ("PNG", (330, 140))
        assert len(image.getcolors() or []) <= 128


def test_an_svg_has_no_date(tmp_path):
    text = write_figure(drawn(), tmp_path / "a.svg").read_text()
    assert text.startswith("<?xml")
    assert "dc:date" not in text


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hri_predict.base.files.os.replace", full)
    with pytest.raises(ConfigError, match=r"--plot .*a\.png: cannot be written: No space left"):
        write_figure(drawn(), path, option="--plot")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    with pytest.raises(ConfigError, match=r"--out .*b\.png: cannot be written"):
        write_figure(drawn(), path / "b.png")
