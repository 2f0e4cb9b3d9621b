"""The splits of the data pack: who may be where, checked against the pack's own manifest."""

import csv
import itertools
import re
import subprocess
from collections import Counter

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.lab.datasets.splits import USES, benchmark_split, in_pack, is_pack, split
from tests.house import ROOT
from tests.shared import DATA

needs_pack = pytest.mark.skipif(not (DATA / "motion").exists(), reason="needs ../shared/data")
SETS = ("beside_robot", "cmu_tools", "cmu_subjects", "cmu_misc", "cmu_dance")
MOTION_USES = ("fit", "validation", "calibration", "test_motion")
IN_TEST = {"35", "49"}
# cmu_mocap/train names nobody: those that the pack's README names, and those found by their looks
PEOPLE = {
    "02": ["walking_1"],
    "05": ["walking_2"],
    "06": ["walking_3"],
    "07": ["walking_4", "walking_5"],
    "08": [f"walking_extra_{n}" for n in range(13, 18)],
    "16": [f"walking_extra_{n}" for n in range(27, 35)],
    "35": ["running_1", "running_3", "running_4", "running_5"],
    "49": ["jumping_2", "walking_extra_51"],
}


def manifest():
    with (DATA / "motion" / "manifest.csv").open(encoding="utf-8") as file:
        return {f"motion/{row['set']}/{row['name']}": row for row in csv.DictReader(file)}


def uses():
    return {name: use for use in USES for name in split(use)}


def test_no_recording_is_in_two_lists():
    counts = Counter(name for use in (*USES, "left_out") for name in split(use))
    assert set(counts.values()) == {1}


def test_the_old_test_list_is_unchanged_and_tested_alone():
    names = split("test")
    assert len(names) == 24
    assert all(name.startswith("cmu_mocap/test/") for name in names)
    assert not any(n.startswith("cmu_mocap/test/") for use in MOTION_USES for n in split(use))


def test_the_page_about_zones_has_the_command_for_calibration_recordings_that_it_never_saw():
    """Those of version 1's lists fit and validation, on which its earlier weights were fitted."""
    seen = {f"basketball_signal_{n}" for n in (3, 4)} | {f"walking_{n}" for n in (1, 5)}
    seen |= {f"walking_extra_{n}" for n in (19, 20, 21, 25, 26, 35, 36, 48, 49)}
    known = {f"cmu_mocap/train/{name}" for name in seen}
    assert known < set(split("calibration"))
    page = (ROOT / "docs" / "measured" / "zones.md").read_text(encoding="utf-8")
    lines = [line for line in page.splitlines() if line.startswith(("seen=", "sed "))]
    command = "\n".join(lines).removesuffix(" > unseen.txt")
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True)
    left = [name for name in split("calibration") if name not in known]
    assert done.stdout.split() == [
        word for name in left for word in ("--data", f"../shared/data/{name}.npz")
    ]


def test_the_benchmark_keeps_the_train_recordings_of_version_1():
    fit, validation = benchmark_split("fit"), benchmark_split("validation")
    assert not set(fit) & set(validation)
    assert (len(fit), len(validation)) == (19, 6)
    assert all(name.startswith("train/") for name in (*fit, *validation))


@needs_pack
def test_the_lists_and_what_is_left_out_are_the_whole_pack():
    listed = {name for use in (*USES, "left_out") for name in split(use)}
    there = {str(p.relative_to(DATA).with_suffix("")) for p in DATA.rglob("*.npz")}
    assert listed == there


@needs_pack
def test_people_of_the_test_are_in_test_motion_or_left_out():
    where = uses()
    theirs = [name for name, row in manifest().items() if row["person_in_test"]]
    assert len(theirs) == 29
    assert {where[name] for name in theirs} == {"test_motion"}
    assert {row["subject"] for row in map(manifest().__getitem__, theirs)} == IN_TEST
    for person in IN_TEST:
        assert not [n for n in PEOPLE[person] if f"cmu_mocap/train/{n}" in where]


@needs_pack
def test_a_person_who_is_named_is_in_one_list():
    """But for the sets of one person or one couple, which are split by recording."""
    where: dict[str, str] = uses()
    found: dict[str, set[str]] = {}
    for name, row in manifest().items():
        person = row["subject"].removesuffix(" (inferred)")
        if person not in ("unknown", "60", "61", "62"):
            found.setdefault(person, set()).add(where[name])
    for person, names in PEOPLE.items():
        if person not in IN_TEST:
            found.setdefault(person, set()).update(where[f"cmu_mocap/train/{n}"] for n in names)
    assert {person: lists for person, lists in found.items() if len(lists) > 1} == {}


@needs_pack
def test_each_set_gives_a_part_to_each_list():
    where = uses()
    for part, use in itertools.product(SETS, MOTION_USES):
        assert any(where[name] == use for name, row in manifest().items() if row["set"] == part)


@needs_pack
def test_shares_of_motion_are_as_stated():
    """About 40, 10 and, of those who are not in the test, a third; the rest is test_motion."""
    where, rows = uses(), manifest()
    share = Counter(where[name] for name in rows)
    free = sum(not row["person_in_test"] for row in rows.values())
    assert share["fit"] / len(rows) == pytest.approx(0.40, abs=0.03)
    assert share["validation"] / len(rows) == pytest.approx(0.10, abs=0.03)
    assert share["calibration"] / free == pytest.approx(1 / 3, abs=0.03)


@needs_pack
def test_both_partners_of_a_dance_are_on_one_side():
    where = uses()
    dances = [n for n in where if re.search(r"cmu_dance/salsa_\d+$", n)]
    assert len(dances) == 26
    for name in dances:
        stem, number = name.rsplit("_", 1)
        partner = f"{stem}_{(int(number) + 14) % 30 + 1:02d}"
        assert where[partner] == where[name]


@needs_pack
def test_beside_robot_takes_turns_over_its_tasks():
    where, rows = uses(), manifest()
    tasks: dict[str, Counter[str]] = {}
    for name, row in rows.items():
        if row["set"] == "beside_robot":
            tasks.setdefault(row["label"], Counter())[where[name]] += 1
    for task, counts in tasks.items():  # a task of two recordings gives to two lists
        assert len(counts) >= min(3, counts.total()), task
        assert counts["fit"] + counts["calibration"] >= 1, task
    order = sorted(
        (n for n in rows if "/beside_robot/" in n),
        key=lambda n: (n.rsplit("_", 1)[0], int(n.rsplit("_", 1)[1])),
    )
    once = "fit calibration test_motion fit calibration validation fit calibration"
    turn = f"{once} fit calibration test_motion".split()
    assert [where[n] for n in order] == [turn[i % 11] for i in range(len(order))]


@needs_pack
def test_every_name_is_a_file_below_the_pack_or_its_cmu_mocap():
    assert all(in_pack(DATA, name).is_file() for use in USES for name in split(use))
    assert in_pack(DATA / "cmu_mocap", split("test")[0]) == in_pack(DATA, split("test")[0])
    assert is_pack(DATA)
    assert is_pack(DATA / "cmu_mocap")
    assert not is_pack(DATA / "motion")
    with pytest.raises(ConfigError, match=r"has no motion/.*give the data pack's folder"):
        in_pack(DATA / "cmu_mocap", split("test_motion")[-1])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("fit: [train/walking_1]", "version is missing; write 'version: 2'"),
        ("version: 1\nfit: [a]", "version is 1; write 'version: 2'"),
        ("version: 2\nfti: [a]", "'fit' must be a list of recordings; did you mean 'fti'?"),
        ("version: 2\nfit: 3", "'fit' must be a list of recordings"),
    ],
)
def test_a_users_file_that_says_something_else_is_one_clear_line(tmp_path, text, says):
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(says)) as error:
        split("fit", str(path))
    assert "\n" not in str(error.value)
    with pytest.raises(ConfigError, match=re.escape(str(path))):
        benchmark_split("fit", str(path))
