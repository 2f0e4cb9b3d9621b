"""The site of all pages builds without a warning, and needs no network to be read."""

import os
import re
from pathlib import Path

import pytest

from tests.processes import python

pytestmark = pytest.mark.long  # builds the whole site

ROOT = Path(__file__).resolve().parents[1]
CONTRACTS = {
    "source": "hri_predict.contracts.source.Source",
    "link": "hri_predict.contracts.link.Link",
    "predictors": "hri_predict.contracts.predictor.Predictor",
    "skeleton": "hri_predict.base.skeleton.Skeleton",
    "ring_buffer": "hri_predict.people.ring_buffer.RingBuffer",
    "risk_engine": "hri_predict.risk.engine.RiskEngine",
    "messages": "hri_predict.protocol.codec.encode_payloads",
}
"""What each page of ``docs/api`` must describe."""
FETCHED = re.compile(r'<(?:script|img|iframe)[^>]* src="https?:|<link[^>]* href="https?:')


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("material", reason="needs the extra 'docs'")
    pytest.importorskip("mkdocstrings", reason="needs the extra 'docs'")
    folder = tmp_path_factory.mktemp("site")
    done = python(
        *["-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir"],
        folder,
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_pages_from_outside_of_docs_are_on_the_site(site: Path) -> None:
    for page in ("index", "drivers/PROTOCOL", "drivers/SCENE_STREAM", "drivers/SCENE_JSON"):
        assert (site / f"{page}.html").stat().st_size > 10_000
    assert (site / "drivers" / "c" / "index.html").exists()
    assert (site / "configs" / "robots" / "ur5e.yaml").exists()  # which a guide links to


@pytest.mark.parametrize("page", CONTRACTS)
def test_every_contract_has_a_page(site: Path, page: str) -> None:
    text = (site / "api" / f"{page}.html").read_text(encoding="utf-8")
    assert f'id="{CONTRACTS[page]}"' in text


def test_the_first_page_draws_the_way_of_a_frame(site: Path) -> None:
    text = (site / "index.html").read_text(encoding="utf-8")
    assert "┌ inference process ─" in text
    assert "predictors/process/worker.py" in text


def test_every_link_of_the_site_leads_somewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        if page.name == "404.html":  # its links start at the server's root
            continue
        text = page.read_text(encoding="utf-8")
        for link in re.findall(r'(?:href|src)="(?!\w+:)([^"#]+)', text):
            assert (page.parent / link).exists(), f"{page.relative_to(site)}: {link}"


def test_no_page_fetches_from_a_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not FETCHED.search(page.read_text(encoding="utf-8")), page


def test_no_table_stays_raw_text(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not re.search(r"^(?:<p>)?\|.*\|", page.read_text(encoding="utf-8"), re.M), page
