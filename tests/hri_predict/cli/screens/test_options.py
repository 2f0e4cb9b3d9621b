"""What the terminal says of screens, and what the demo shows by itself."""

import sys

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli import run
from hri_predict.cli.screens import options
from hri_predict.viewing.feed import Feed


@pytest.mark.parametrize(
    ("installed", "says"),
    [(True, "hri-predict try"), (False, "pip install -e '/srv/clone[viewer,camera]'")],
)
def test_the_demos_last_line_says_how_to_go_on(monkeypatch, installed, says):
    monkeypatch.setattr(options.feed, "has_viser", lambda: installed)
    monkeypatch.setattr(
        options,
        "for_this_installation",
        lambda text: text.replace("'hri-predict", "-e '/srv/clone"),
    )
    assert says in options.how_to_see()
    assert "\n" not in options.how_to_see()


def test_the_terminal_has_the_addresses_of_the_screens_that_listen():
    shown = Feed([])
    assert options.addresses(None) == options.addresses(shown) == ""
    shown._heard("viewer", "http://127.0.0.1:1")
    assert options.addresses(shown) == "viewer: http://127.0.0.1:1  Ctrl-C ends it"


def test_a_page_is_opened_once_though_its_screen_starts_again():
    opened: list[str] = []
    shown = Feed([], opened.append)
    shown._heard("viewer", "http://127.0.0.1:1")
    shown._heard("viewer", "http://127.0.0.1:1")
    assert opened == ["http://127.0.0.1:1"]


@pytest.mark.parametrize(
    ("terminal", "installed", "asked", "port"),
    [
        (True, True, {}, 0),
        (False, True, {}, None),
        (True, False, {}, None),
        (True, True, {"speed": "max"}, None),
        (True, True, {"as_json": True}, None),
        (True, True, {"viewer": 8090}, 8090),
    ],
)
def test_in_a_terminal_the_demo_shows_the_3d_view_if_it_is_installed(
    monkeypatch, terminal, installed, asked, port
):
    ports = []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    monkeypatch.setattr(run, "has_viser", lambda: installed)
    monkeypatch.setattr(run, "screens", lambda viewer, *others: ports.append(viewer))
    monkeypatch.setattr(run, "go", lambda *arguments: None)
    run.demo(**asked)
    assert ports == [port]


def test_an_address_that_no_screen_listens_on_is_an_error():
    with pytest.raises(ConfigError, match="--viewer-host: has no effect without --viewer or"):
        options.screens(None, None, "0.0.0.0")
    options.screens(None, None, "127.0.0.1")
