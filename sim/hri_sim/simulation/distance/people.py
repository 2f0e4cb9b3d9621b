"""People for the working distance: their activities, and the joints that their tracker sees."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import floor
from pathlib import Path

from hri_predict.base.errors import ConfigError, UnusableRecordingError, nearest
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.common import one_of
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.lab.datasets.splits import is_pack
from hri_predict.recording.format_table import ENDINGS
from hri_predict.run.working_distance.measure import WARM_S
from hri_sim.simulation.motion import PROCEDURAL, load_motion

SHORTEST_S = WARM_S + 0.5
"""Minimum length of a recording, seconds."""
_RATE_HZ = 30.0


@dataclass(frozen=True, kw_only=True)
class Activity:
    """An activity of a person.

    Attributes:
        name: for ``--activity`` and tables.
        text: description.
        motion: a recording below the data pack's root, or a script; see ``load_motion``.
        absent: body parts that are never present.
        of_set: the requested set; "": requested individually.
    """

    name: str
    text: str
    motion: str
    absent: tuple[str, ...] = ()
    of_set: str = ""

    @property
    def is_recorded(self) -> bool:
        """Whether it needs a recording."""
        return not self.motion.startswith(PROCEDURAL + ":")


ACTIVITIES = {
    each.name: each
    for each in (
        Activity(name="window", text="wipes a window", motion="cmu_mocap/test/washwindow_1"),
        Activity(name="tools", text="works with tools", motion="motion/cmu_tools/62_04"),
        Activity(
            name="seated",
            text="assembles, seated",
            motion="assembly/task1_human2_trial1",
            absent=("left_leg", "right_leg"),
        ),
        Activity(
            name="beside",
            text="picks and places next to a robot",
            motion="motion/beside_robot/PickPlaceCloseHuman_3",
        ),
        Activity(name="passing", text="walks past", motion=f"{PROCEDURAL}:passing"),
        Activity(name="talking", text="stands and talks", motion=f"{PROCEDURAL}:talking"),
        Activity(name="reaching", text="reaches in occasionally", motion=f"{PROCEDURAL}:reaching"),
    )
}

SETS = {
    "arms": "assembly",
    **{
        name: f"motion/{name}"
        for name in ("beside_robot", "cmu_tools", "cmu_subjects", "cmu_dance")
    },
}
"""The data pack's sets that ``calibrate --leave-out`` leaves out, with their folders."""


@dataclass(frozen=True, kw_only=True)
class Sight:
    """The joints of a person that a tracker sees.

    Attributes:
        name: name in ``--tracker`` and in tables.
        tracker: joint map with the delivered joints; ``None``: all joints.
        lacks: canonical joints that are never delivered.
        hidden: canonical joints that the tracker supports but cannot see in this case.
        lost: share of time in which the tracker loses each arm and leg for a moment.
    """

    name: str
    tracker: str | None = None
    lacks: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    lost: float = 0.0


def _both(*parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}" for part in parts for side in ("l", "r"))


_LEGS = _both("knee", "ankle", "foot")
_BELOW = ("waist", *_both("hip"), *_LEGS)
FULL = Sight(name="full")
SIGHTS = {
    each.name: each
    for each in (
        FULL,
        Sight(name="coco17", tracker="coco17"),
        Sight(name="mediapipe33", tracker="mediapipe33"),
        Sight(name="azure_kinect32", tracker="azure_kinect32"),
        Sight(name="zed34", tracker="zed34"),
        Sight(name="limbs-lost", lost=0.2),
        Sight(name="hands-hidden", hidden=_both("wrist", "hand")),
        Sight(name="arm-hidden", hidden=("r_elbow", "r_wrist", "r_hand")),
        Sight(name="feet-hidden", hidden=_both("ankle", "foot")),
        Sight(name="legs-hidden", hidden=_LEGS),
        Sight(name="waist-hidden", hidden=_BELOW),
        Sight(name="upper-body", lacks=_BELOW),
        Sight(name="marker_clusters9", tracker="marker_clusters9"),
    )
}
"""The whole body, and the measured trackers; *hidden* joints are known to the tracker."""
assert all(joint in JOINTS for each in SIGHTS.values() for joint in (*each.lacks, *each.hidden))


def own_sights() -> list[str]:
    """Return the names of sights that are not joint maps."""
    return [name for name, sight in SIGHTS.items() if sight.tracker is None]


def sights(names: Sequence[str]) -> list[Sight]:
    """Return the sights for ``--tracker``.

    Args:
        names: a name in ``SIGHTS``, or any joint map's name or file; with ``+`` several together,
            such as ``coco17+legs-hidden`` for such a tracker in front of a bench.

    Raises:
        ConfigError: unknown name; two joint maps in one.
    """
    split = [[name] if Path(name).is_file() else name.split("+") for name in names]
    return [
        _together(name, [_sight(part) for part in parts])
        for name, parts in zip(names, split, strict=True)
    ]


def _together(name: str, parts: Sequence[Sight]) -> Sight:
    """Return what a tracker sees to which all parts apply."""
    if len(parts) == 1:
        return parts[0]
    maps = [part.tracker for part in parts if part.tracker is not None]
    if len(maps) > 1:
        raise ConfigError(f"--tracker {name}: {len(maps)} joint maps; a tracker has one")
    return Sight(
        name="+".join(part.name for part in parts),
        tracker=maps[0] if maps else None,
        lacks=tuple(dict.fromkeys(joint for part in parts for joint in part.lacks)),
        hidden=tuple(dict.fromkeys(joint for part in parts for joint in part.hidden)),
        lost=max(part.lost for part in parts),
    )


def _sight(name: str) -> Sight:
    if name in SIGHTS:
        return SIGHTS[name]
    known = [*SIGHTS, *map_names()]
    if name not in known and not name.endswith(YAML_ENDINGS):
        raise ConfigError(
            f"--tracker {name}: unknown{nearest(name, known)} ({', '.join(SIGHTS)}; or the name "
            f"or file of any joint map; or several joined by +)"
        )
    load_joint_map(name)
    is_file = name.endswith(YAML_ENDINGS)
    tracker = str(Path(name).absolute()) if is_file else name
    return Sight(name=Path(name).stem if is_file else name, tracker=tracker)


def activities(names: Sequence[str], data: Path | None) -> tuple[list[Activity], list[str]]:
    """Return the activities with the paths of their recordings, and a line about omitted ones.

    Args:
        names: names in ``ACTIVITIES``; names in ``SETS``, for each recording of the set that is
            long enough; or recordings of the user.
        data: the data pack; ``None``: without it, recorded activities are left out.

    Raises:
        ConfigError: an activity is unknown, or none is left; a recording is too short.
        RecordingError: one cannot be read.
    """
    found: list[Activity] = []
    missing, notes = [], []
    for name in names:
        if Path(name).suffix.lower() in ENDINGS:
            found.append(_own_recording(name))
            continue
        one_of("--activity", name, [*ACTIVITIES, *SETS])
        if name in ACTIVITIES and not ACTIVITIES[name].is_recorded:
            found.append(ACTIVITIES[name])
        elif data is not None and (path := _in_pack(data, name)).exists():
            chosen, short = _of_pack(name, path.resolve())
            found += chosen
            if short:
                notes.append(
                    f"{name}: {short} recordings left out (under {SHORTEST_S:g} s, or unusable)."
                )
        else:
            missing.append(name)
    if not missing:
        return found, notes
    simulated = [each.name for each in ACTIVITIES.values() if not each.is_recorded]
    said = (
        f"the data pack with the recordings for {', '.join(missing)} is not in "
        f"{data or '../shared/data'}; name its folder with --data, or your own recordings with "
        f"--activity FILE; simulated people need none: {', '.join(simulated)}"
    )
    if not found:
        raise ConfigError(f"--activity: {said}")
    return found, [*notes, f"Left out: {said}"]


def _own_recording(name: str) -> Activity:
    if not Path(name).is_file():
        raise ConfigError(f"--activity {name}: no such recording; check the path")
    path = Path(name).resolve()
    lasts_s = load_motion(str(path), _RATE_HZ).duration_s
    if lasts_s < SHORTEST_S:
        raise ConfigError(
            f"--activity {name}: lasts {floor(lasts_s * 1e3) / 1e3:.3f} s, of which the first "
            f"{WARM_S:g} s do not count; give a recording of {SHORTEST_S:g} s or more"
        )
    return Activity(name=path.stem, text=f"recording {path.stem}", motion=str(path))


def _in_pack(data: Path, name: str) -> Path:
    return data / (SETS[name] if name in SETS else f"{ACTIVITIES[name].motion}.npz")


def _of_pack(name: str, path: Path) -> tuple[list[Activity], int]:
    """Return an activity, or each recording of a set; and the number of unusable recordings."""
    if name in ACTIVITIES:
        return [replace(ACTIVITIES[name], motion=str(path))], 0
    absent = ACTIVITIES["seated"].absent if name == "arms" else ()
    found, paths = [], sorted(path.glob("*.npz"))
    for each in paths:
        with suppress(UnusableRecordingError):  # too short even to be read
            if load_motion(str(each), _RATE_HZ).duration_s >= SHORTEST_S:
                text = f"{name}/{each.stem}"
                found.append(
                    Activity(name=text, text=text, motion=str(each), absent=absent, of_set=name)
                )
    if not found:
        raise ConfigError(
            f"--activity {name}: {path} holds no recording (.npz) of {SHORTEST_S:g} s or more; "
            f"copy it again, or name another"
        )
    return found, len(paths) - len(found)


def pack(data: Path | None) -> Path | None:
    """Return the data pack's folder: as given, or next to the project if it exists there.

    Raises:
        ConfigError: the given folder is not the data pack.
    """
    folder = data or Path("../shared/data")
    if is_pack(folder):
        return folder
    if data is None:
        return None
    raise ConfigError(
        f"--data {data}: not the data pack (no cmu_mocap/test in it); give its folder, or name "
        f"recordings with --activity FILE"
    )
