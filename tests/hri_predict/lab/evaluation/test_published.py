"""Printed numbers: as the papers' averages have them, and never shown under another protocol."""

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.lab.datasets.cmu_benchmark import MEAN_OVER
from hri_predict.lab.evaluation.benchmarks import Cmu
from hri_predict.lab.evaluation.published import comparable, published
from tests.shared import DATA, needs_data

# Means over the five actions, rounded, formed by hand from the papers' tables.
FIVE: dict[tuple[str, int], list[float | None]] = {
    ("TrajectoryCNN", 25): [11.0, 20.2, 40.9, 51.8, 99.5],
    ("AuxFormer", 10): [9.6, 17.1, 33.2, 41.2],
    ("AuxFormer", 25): [75.5],
    ("PGBIG", 25): [10.7, 19.9, 37.2, 44.8, 57.3, 79.1],
    ("MSR-GCN", 25): [11.1, 19.6, 35.8, 43.6, 79.8],
    ("GGMotion", 25): [10.3, 19.2, 35.7, 43.6, 57.2, 81.9],
    ("GGMotion", 10): [9.2, 16.7, 32.8, 41.4],
    ("STB", 10): [7.4, None, 34.3, 43.6],
    ("KD-Former", 25): [0.22, 0.46, 0.76, 0.92, 1.07, 1.25],
}


@pytest.mark.parametrize(("method", "n_out"), FIVE)
def test_means_over_the_five_actions(method, n_out):
    (entry,) = [e for e in published(Cmu.published) if (e.method, e.n_out) == (method, n_out)]
    assert len(entry.columns) == len(FIVE[method, n_out])
    for column, expected in zip(entry.columns, FIVE[method, n_out], strict=True):
        values = [entry.at(action, column) for action in MEAN_OVER]
        if expected is None:
            assert None in values
        else:
            digits = 1 if expected > 3 else 2
            known = [value for value in values if value is not None]
            assert len(known) == 5
            assert np.mean(known) == pytest.approx(expected, abs=0.51 * 10**-digits)


@needs_data
def test_pgbig_is_the_packs_copy_of_its_result_file():
    text = (DATA / "README.md").read_text(encoding="utf-8")
    lines = text[text.index("PGBIG's published result file") :].splitlines()[2:]
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in lines[2:8]]
    (entry,) = [e for e in published(Cmu.published) if e.method == "PGBIG"]
    assert entry.errors == {row[0]: [float(c) for c in row[1:]] for row in rows}


def test_only_the_same_protocol_is_comparable():
    def names(windows, n_in, n_out, error):
        found = comparable(Cmu.published, windows, n_in=n_in, n_out=n_out, error=error)
        return {e.method for e in found}

    assert names("all", 10, 25, "mpjpe") == {"PGBIG", "MSR-GCN", "GGMotion", "SPGSN", "AuxFormer"}
    assert names("all", 25, 25, "mpjpe") == {"SINN"}
    assert names("all", 10, 10, "mpjpe") == {"GGMotion", "SPGSN", "AuxFormer", "STB"}
    assert names("8-seeds", 10, 25, "mpjpe") == {"TrajectoryCNN", "LearnTrajDep"}
    assert names("8-seeds", 10, 10, "mpjpe") == names("8-seeds", 10, 25, "mpjpe")  # same windows
    assert names("80-seeds", 50, 25, "euler") == {"KD-Former"}
    assert names("80-seeds", 10, 25, "mpjpe") == names("8-seeds", 50, 25, "euler") == set()


def test_where_a_number_cannot_be_taken_as_it_stands_a_note_says_so():
    notes = {e.method: e.note for e in published(Cmu.published)}
    assert "future frame" in notes["STB"]
    assert "one frame early" in notes["KD-Former"]
    assert "not stated" in notes["SINN"]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "cannot be read"),
        (b"\xff\xfe", "not UTF-8"),
        (b"[1, 2", "not valid YAML"),
        (b"method: M", "published"),
        (b"[7]", "published"),
    ],
)
def test_a_broken_file_of_printed_numbers_is_one_line(tmp_path, content, told):
    file = tmp_path / "printed.yaml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=told):
        published(file)
