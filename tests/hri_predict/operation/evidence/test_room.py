"""Which files of an evidence folder are the node's own."""

from hri_predict.operation.evidence import room

OURS = "20260101T000000.000Z-arm_1-stop-2.mcap"
OTHERS = ("20260101T000000.000Z-arm_1-stop-KEEP.mcap", "20260101T000000.000Z-amr-stop.mcap")


def test_only_files_that_a_node_kept_are_counted(tmp_path):
    for name in (OURS, *OTHERS, "report.mcap"):
        (tmp_path / name).write_bytes(b"seconds")
    assert room.sizes(tmp_path, ["arm_1"]) == {OURS: 7}


def test_only_names_that_a_node_changed_are_restored(tmp_path):
    for name in (OURS, *OTHERS):
        (tmp_path / f"{name}.removing").write_bytes(b"seconds")
    assert room.Room(tmp_path, ["arm_1"], 1e6).sizes == {OURS: 7}
    left = sorted(path.name for path in tmp_path.glob("*.removing"))
    assert left == sorted(f"{name}.removing" for name in OTHERS)


def test_a_file_that_another_program_deleted_is_not_named_as_removed(tmp_path):
    names = [f"2026010{day}T000000.000Z-arm_1-stop.mcap" for day in (1, 2, 3)]
    for name in names:
        (tmp_path / name).write_bytes(b"seconds")
    kept = room.Room(tmp_path, ["arm_1"], 7)
    (tmp_path / names[0]).unlink()
    assert kept.put_aside() == [names[1]]
    assert list(kept.sizes) == [names[2]]
