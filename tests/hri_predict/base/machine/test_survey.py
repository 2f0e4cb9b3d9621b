"""What is said of machines, read from folders that look like their ``/proc`` and ``/sys``."""

import os

import pytest

from hri_predict.base.machine import survey as module
from hri_predict.base.machine.realtime import RealtimeSettings
from hri_predict.base.machine.survey import survey

GOOD = {
    "proc/version": "Linux version 6.1 #1 SMP PREEMPT_RT",
    "proc/swaps": "Filename Type Size Used Priority",
    "proc/self/cgroup": "0::/system.slice/node.service",
    "proc/self/timerslack_ns": "1000",
    "proc/sys/kernel/sched_rt_runtime_us": "-1",
    "proc/sys/kernel/sched_rt_period_us": "1000000",
    "sys/fs/cgroup/system.slice/cpu.max": "max 100000",
    "sys/devices/system/cpu/isolated": "",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance",
    "sys/kernel/mm/transparent_hugepage/enabled": "always [madvise] never",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc",
}


@pytest.fixture(autouse=True)
def permitted(monkeypatch):
    monkeypatch.setattr(module, "set_fifo", lambda _priority: "")
    monkeypatch.setattr(module, "lock_memory", lambda: "not here; do this")
    monkeypatch.setattr(module, "usable_cores", lambda: {0, 1})


def found(root, settings=None, **files):
    """The findings about a machine with these files, by name."""
    for path, text in (GOOD | {k: v for k, v in files.items() if v is not None}).items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text + "\n", encoding="utf-8")
    return {each.name: each for each in survey(settings or RealtimeSettings(), root)}


def test_a_machine_that_is_set_up_lacks_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "lock_memory", lambda: "")
    settings = RealtimeSettings(priority=50, lock_memory=True)
    there = found(tmp_path, settings)
    assert {name: each.remedy for name, each in there.items() if each.remedy} == {}
    assert not any(each.refused for each in there.values())


@pytest.mark.parametrize(
    ("name", "path", "text", "remedy"),
    [
        ("kernel", "proc/version", "Linux version 6.1 #1 SMP PREEMPT_DYNAMIC", "PREEMPT_RT"),
        (
            "frequency governor",
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "powersave",
            "cpupower",
        ),
        ("swap", "proc/swaps", "Filename Type\n/dev/sda2 partition", "swapoff"),
        (
            "transparent huge pages",
            "sys/kernel/mm/transparent_hugepage/enabled",
            "[always] madvise never",
            "madvise",
        ),
        ("timer slack", "proc/self/timerslack_ns", "50000", "TimerSlackNSec"),
        (
            "clock source",
            "sys/devices/system/clocksource/clocksource0/current_clocksource",
            "hpet",
            "tsc",
        ),
        ("processor quota", "sys/fs/cgroup/cpu.max", "150000 100000", "CPUQuota"),
        (
            "processor quota",
            "sys/fs/cgroup/system.slice/node.service/cpu.max",
            "50000 100000",
            "CPUQuota",
        ),
        ("isolated cores", "sys/devices/system/cpu/isolated", "2-3", "realtime.cpus: [2-3]"),
    ],
)
def test_what_a_machine_lacks_comes_with_the_remedy(tmp_path, name, path, text, remedy):
    assert found(tmp_path)[name].remedy == ""
    assert remedy in found(tmp_path, **{path: text})[name].remedy


def test_the_smallest_quota_above_the_node_counts(tmp_path):
    quotas = {
        "sys/fs/cgroup/cpu.max": "400000 100000",
        "sys/fs/cgroup/system.slice/cpu.max": "150000 100000",
        "sys/fs/cgroup/system.slice/node.service/cpu.max": "max 100000",
    }
    assert found(tmp_path, **quotas)["processor quota"].found == "1.5 cores"


def test_a_system_without_these_files_is_not_known_and_no_error(tmp_path):
    names = {each.name: each.found for each in survey(RealtimeSettings(), tmp_path)}
    assert names["clock source"] == names["timer slack"] == "not known"


def test_one_core_is_too_few(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "usable_cores", lambda: {0})
    assert "second core" in found(tmp_path)["cores"].remedy


def test_only_what_is_configured_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "set_fifo", lambda priority: f"no {priority}; do that")
    there = found(tmp_path)
    assert [each.refused for each in there.values() if each.refused] == []
    assert "do this" in there["locked memory"].remedy
    asked = RealtimeSettings(priority=7, lock_memory=True, cpus=(0,), inference_cpus=(5,))
    there = found(tmp_path, asked)
    assert there["SCHED_FIFO 7"].remedy == "no 7; do that"
    refused = {each.refused for each in there.values() if each.refused}
    assert refused == {"priority", "lock_memory", "inference_cpus"}
    assert "name some of these" in there["realtime.inference_cpus"].remedy


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="needs Linux")
def test_looking_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.undo()
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    survey(RealtimeSettings())
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before
