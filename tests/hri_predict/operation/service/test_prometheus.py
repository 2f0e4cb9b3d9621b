"""A real Prometheus (Debian's) scrapes a real node; its promtool judges the text."""

import json
import shutil
import signal
import subprocess
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

import pytest
import yaml

from hri_predict.base.files import data_path
from tests.hri_predict.operation.service.cells import NotifySocket, Service, cell, written
from tests.waiting import eventually, free_port

HAVE = shutil.which("prometheus") and shutil.which("promtool")
pytestmark = [
    pytest.mark.long,
    pytest.mark.realtime,
    pytest.mark.skipif(not HAVE, reason="needs Debian's package prometheus"),
]
START_S = 30.0


def get(url: str) -> str:
    with urllib.request.urlopen(url, timeout=5) as answer:
        return str(answer.read().decode())


def tried(url: str) -> str:
    try:
        return get(url)
    except OSError:
        return ""


class Prometheus:
    """The program, with one target that it scrapes each second."""

    def __init__(self, folder: Path, target: int) -> None:
        port = free_port()
        scraped = {"job_name": "cell", "static_configs": [{"targets": [f"127.0.0.1:{target}"]}]}
        config = {"global": {"scrape_interval": "1s"}, "scrape_configs": [scraped]}
        (folder / "prometheus.yml").write_text(yaml.safe_dump(config), encoding="utf-8")
        self.process = subprocess.Popen(
            [
                "prometheus",
                f"--config.file={folder / 'prometheus.yml'}",
                f"--storage.tsdb.path={folder / 'tsdb'}",
                f"--web.listen-address=127.0.0.1:{port}",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.url = f"http://127.0.0.1:{port}"

    def ask(self, query: str) -> list[dict[str, Any]]:
        """The rows of a query; a query that is wrong is an HTTP error."""
        said = get(f"{self.url}/api/v1/query?{urllib.parse.urlencode({'query': query})}")
        rows: list[dict[str, Any]] = json.loads(said)["data"]["result"]
        return rows

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(20)


def expressions(job: str) -> list[str]:
    """What the shipped dashboard asks."""
    dashboard = json.loads(data_path("service", "grafana.json").read_text(encoding="utf-8"))
    found = [each["expr"] for panel in dashboard["panels"] for each in panel.get("targets", [])]
    for name, value in (("__rate_interval", "5s"), ("job", job), ("instance", ".*")):
        found = [each.replace(f"${name}", value) for each in found]
    assert not any("$" in each for each in found)
    return found


def test_prometheus_takes_every_metric_and_the_dashboard_finds_its_rows(tmp_path):
    port = free_port()
    notify = NotifySocket(str(tmp_path / "notify"))
    service = Service(written(tmp_path, cell(metrics={"port": port})), notify)
    prometheus = Prometheus(tmp_path, port)
    try:
        assert notify.listen(START_S, until="READY=1"), service.says()
        text = eventually(lambda: tried(f"http://127.0.0.1:{port}/metrics"))
        judged = subprocess.run(
            ["promtool", "check", "metrics"], input=text, text=True, capture_output=True, timeout=30
        )
        assert (judged.returncode, judged.stdout, judged.stderr) == (0, "", "")
        eventually(lambda: tried(f"{prometheus.url}/-/ready"), START_S)
        ticks = "rate(hri_ticks_total[5s]) > 5"
        eventually(lambda: prometheus.ask(ticks), START_S)  # it needs two scrapes
        assert prometheus.ask("up")[0]["value"][1] == "1"
        rows = {each: len(prometheus.ask(each)) for each in expressions("cell")}
    finally:
        prometheus.end()
        service.end()
        notify.close()
    assert len(rows) >= 15
    empty = {each for each, count in rows.items() if not count}
    # this cell has no links, and the others count what did not happen here
    excused = ("hri_link_", "> 0", "separation")
    assert all(any(each in query for each in excused) for query in empty), empty


def test_promtool_refuses_what_is_wrong():
    judged = subprocess.run(
        ["promtool", "check", "metrics"],
        input="# TYPE a counter\na{b=} 1\n",
        text=True,
        capture_output=True,
        timeout=30,
    )
    assert judged.returncode != 0
