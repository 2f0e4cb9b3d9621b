"""The container file: its form, and that nothing in it runs as root or listens outside."""

import json
from pathlib import Path

TEXT = (Path(__file__).resolve().parents[2] / "deploy" / "Containerfile").read_text("utf-8")
KNOWN = {"ARG", "FROM", "COPY", "RUN", "ENV", "WORKDIR", "USER", "VOLUME", "STOPSIGNAL"} | {
    "ENTRYPOINT",
    "CMD",
}


def instructions():
    lines = [line for line in TEXT.splitlines() if not line.lstrip().startswith("#")]
    whole = "\n".join(lines).replace("\\\n", " ")
    return [line.split(None, 1) for line in whole.splitlines() if line.strip()]


def test_every_instruction_is_known_and_has_an_argument():
    assert {name for name, _ in instructions()} == KNOWN


def test_only_an_argument_stands_before_its_base():
    names = [name for name, _ in instructions()]
    assert set(names[: names.index("FROM")]) == {"ARG"}


def test_lists_are_json_so_that_signals_reach_the_node():
    lists = {n: json.loads(a) for n, a in instructions() if n in ("ENTRYPOINT", "CMD", "VOLUME")}
    assert lists["ENTRYPOINT"] == ["/opt/hri-predict/bin/hri-predict"]
    assert lists["CMD"][0] == "run"


def test_the_node_is_not_root_and_no_port_is_opened():
    names = [name for name, _ in instructions()]
    users = [argument for name, argument in instructions() if name == "USER"]
    assert users == ["hri-predict"]
    assert names.index("USER") < names.index("ENTRYPOINT")
    assert "EXPOSE" not in TEXT
    assert "0.0.0.0" not in TEXT
