"""``docs/extending.md``: its package is built, installed and used as the page says."""

import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"```(?:python|toml|yaml)\n# (\S+)\n(.*?)```", PAGE, re.DOTALL))
COMMANDS = [
    line.removeprefix("$ ")
    for block in re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
]
PARTS = [name for name in FILES if name.startswith("my_parts/my_parts/")]
MAX_LINES = 45
TRIED = {
    "pip install", "predictors", "conformance predictor:slowing", "conformance source",
    "conformance link", "replay", "listen", "check", "run my_cell", "train perceptron",
    "train waves", "conformance predictor:perceptron", "calibrate", "run perceptron_cell",
}  # fmt: skip
UNSURE = """

class Unsure(Perceptron):
    def __init__(self, shape, options):
        super().__init__(shape, options)
        self.deviation = nn.Linear(shape.history_steps, shape.horizon_steps)

    def forward(self, window):
        moved = (window.positions - last_pose(window)).norm(dim=-1)
        log = 4.0 * self.deviation(moved.transpose(1, 2)).transpose(1, 2)  # a minute is short
        return torch.cat([super().forward(window), log[..., None]], -1)

    losses = Network.losses


class UnsurePredictor(NeuralPredictor):
    method, network_class = "unsure", Unsure
"""
"""The page's network, with a deviation of its own."""
STATED_M = """
import hri_predict
predictor = hri_predict.load_predictor("unsure", weights="unsure/unsure.safetensors")
found = hri_predict.forecast_at(hri_predict.open_recording("walking_2.npz"), predictor, 3.0)
print(found.std[0, -1, found.joints.index("r_wrist")])
"""


def free_port() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


def unsure(text: str) -> str:
    """The page's text, with the network that states a deviation."""
    return text.replace("perceptron", "unsure").replace("Perceptron", "Unsure")


class Place:
    """A folder with the page's files, and its package installed beside hri-predict."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ports = {port: free_port() for port in ("47850", "47851", "47852")}
        for name, text in FILES.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.with_ports(text), encoding="utf-8")
        (folder / "my_parts" / "my_parts" / "__init__.py").touch()
        network = folder / "my_parts" / "my_parts" / "network.py"
        network.write_text("import torch\n" + network.read_text("utf-8") + UNSURE, "utf-8")
        entries = folder / "my_parts" / "pyproject.toml"
        line = 'perceptron = "my_parts.network:PerceptronPredictor"\n'
        entries.write_text(entries.read_text("utf-8").replace(line, line + unsure(line)), "utf-8")
        for name in ("perceptron.yaml", "perceptron_cell.yaml"):
            text = FILES[name].replace("predictive,", "predictive, limits: {std_factor: 2},")
            (folder / unsure(name)).write_text(unsure(text), "utf-8")
        rest = np.array([[x, y, 0.7] for y in (0.25, 0.1, -0.1) for x in (0.2, -0.2)])
        (folder / "recordings").mkdir()
        paces = {"walking_1": 5, "walking_2": 6} | {f"recordings/{n}": n for n in (4, 5, 6, 7)}
        for name, pace in paces.items():
            swung = rest + 0.1 * np.sin(np.arange(180) / pace)[:, None, None]
            arms = {"positions": swung.astype(np.float32), "fps": np.float32(30)}
            np.savez(folder / f"{name}.npz", **arms)  # type: ignore[arg-type]
        installed = folder / "installed"
        pip = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-build-isolation"]
        pip += ["--quiet", "--no-index", "--target", str(installed), "./my_parts"]
        subprocess.run(pip, cwd=folder, check=True, timeout=120)
        self.environment = os.environ | {"PYTHONPATH": str(installed)}

    def with_ports(self, text: str) -> str:
        """The page's ports replaced by some that are free here."""
        for there, here in self.ports.items():
            text = text.replace(there, here)
        return text

    def start(self, *command: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, *command],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            text=True,
        )

    def hri_predict(self, start: str, of=str) -> "subprocess.Popen[str]":
        """Start the page's command that begins so; ``of`` may change it."""
        (command,) = [of(c) for c in COMMANDS if c.startswith(f"hri-predict {start}")]
        return self.start("-m", *self.with_ports(command).replace("hri-", "hri_", 1).split())

    def said(self, start: str, of=str) -> str:
        """What the page's command that begins so prints; it succeeds."""
        process = self.hri_predict(start, of)
        out, _ = process.communicate(timeout=300)
        assert process.returncode == 0, out
        return out

    def send(self, seconds: float) -> "subprocess.Popen[str]":
        return self.start("send.py", self.ports["47850"], str(seconds))


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return Place(tmp_path_factory.mktemp("extending"))


def test_each_part_is_short():
    assert len(PARTS) == 5
    for name in PARTS:
        lines = [line for line in FILES[name].splitlines() if line.strip()]
        assert len(lines) <= MAX_LINES, name


def test_every_command_of_the_page_is_tried_here():
    begin = {command.removeprefix("hri-predict ") for command in COMMANDS}
    assert all(any(command.startswith(tried) for tried in TRIED) for command in begin)


def test_links_of_the_page_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (ROOT / "docs" / target).exists(), target


@pytest.mark.long
def test_the_predictor_is_listed_conforms_and_predicts(place):
    assert "slowing" in place.said("predictors")
    assert "predictor slowing: keeps its contract" in place.said("conformance predictor:slowing")
    assert "Summary" in place.said("replay")


@pytest.mark.long
@pytest.mark.parametrize("of", [str, unsure])
def test_a_network_of_one_s_own_is_trained_exported_calibrated_and_runs_in_the_node(place, of):
    trained = place.said("train perceptron", of)
    assert "epochs done: 10 epochs" in trained
    error = re.search(r"best validation: ([\d.]+) mm", trained)
    assert error is not None
    assert float(error[1]) < 100, "it has learnt little: standing still has 200"
    made = of("predictor perceptron: keeps its contract")
    assert made in place.said("conformance predictor:perceptron", of)
    place.said("calibrate", of)
    summary = json.loads(place.said("run perceptron_cell", of))
    assert summary["self_check"] is not None, "none of its forecasts was judged"
    if of is unsure:
        stated, _ = place.start("-c", STATED_M).communicate(timeout=300)
        assert 0.01 < float(stated) < 0.5, "it has learnt little: untrained, it states a metre"


@pytest.mark.long
def test_a_data_set_of_one_s_own_trains_the_network(place):
    trained = place.said("train waves")
    assert "epochs done: 2 epochs" in trained
    error = re.search(r"best validation: ([\d.]+) mm", trained)
    assert error is not None
    assert float(error[1]) < 200, "it has learnt nothing: standing still has about 400"


@pytest.mark.long
def test_the_link_conforms(place):
    assert "link udp_frames: keeps its contract" in place.said("conformance link")


@pytest.mark.long
@pytest.mark.realtime
def test_the_source_conforms_while_somebody_sends(place):
    sender = place.send(12)
    try:
        said = place.said("conformance source")
        assert "source camera: keeps its contract" in said
        assert "no scene arrived" not in said
    finally:
        sender.kill()
        sender.communicate()


@pytest.mark.long
@pytest.mark.realtime
def test_all_three_work_in_a_cell(place):
    sender, listener = place.send(30), place.hri_predict("listen")
    try:
        assert ": ok" in place.said("check")
        summary = json.loads(place.said("run my_cell"))
        assert summary["source"]["live"]["scenes"] > 30
        out, _ = listener.communicate(timeout=60)
    finally:
        for process in (sender, listener):
            process.kill()
            process.communicate()
    heard = [json.loads(line) for line in out.splitlines()]
    levels = {line["level"] for line in heard if line["message"] == "advice"}
    assert levels - {"unknown"}, "the listener heard no advice"
    states = {line.get("node_state") for line in heard if line["message"] == "status"}
    assert {"running", "degraded"} & states
