"""The settings of a simulation, and its results."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hri_predict.lab.evaluation.table import Table


@dataclass(frozen=True, kw_only=True)
class SimulationRequest:
    """The settings of a simulation; see ``hri-predict simulate``.

    Predictors are ``NAME`` or ``NAME=WEIGHTS``. A calibration applies only to the predictor for
    which it was made.
    """

    config: Path
    predictors: tuple[str, ...] = ()
    calibrations: tuple[Path, ...] = ()
    modes: tuple[str, ...] = ()
    coverages: tuple[float, ...] = ()
    motions: tuple[str, ...] = ()
    joint_map: str | None = None
    tracker: str | None = None
    lacks: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    lost_limbs: float = 0.0
    noise_m: float | None = None
    wander_m: float | None = None
    episodes: int = 2000
    seed: int = 0
    people: int = 1
    jobs: int = 1
    cluster: str | None = None
    out: Path | None = None
    resume: bool = False


@dataclass(frozen=True, kw_only=True)
class OcclusionRequest:
    """Episodes with people lost by cameras; see ``hri-predict simulate --occlude``."""

    config: Path
    predictor: str | None = None
    modes: tuple[str, ...] = ("predictive", "iso", "fixed")
    rates_hz: tuple[float, ...] = (8.0, 15.0, 30.0)
    episodes: int = 2000
    first: int = 0
    seed: int = 0
    cameras: int = 1
    free_space: bool = False
    occlude: bool = True
    jobs: int = 1
    cluster: str | None = None


@dataclass(frozen=True, kw_only=True)
class OcclusionRow:
    """The result of one episode in one mode.

    Attributes:
        index, mode: the episode's index and mode.
        contacts, contacts_standing: touches by a moving and by a standing robot.
        permitted: mean speed limit, as a fraction of the robot's maximum speed.
        lost: fraction of the ticks in which a person was lost.
    """

    index: int
    mode: str
    contacts: int
    contacts_standing: int
    permitted: float
    lost: float


@dataclass(frozen=True, kw_only=True)
class DistanceRequest:
    """A measurement of working distances; see ``hri-predict simulate --distance``.

    Empty choices stand for the defaults of ``distance.run``.
    """

    config: Path
    robot: str | None = None
    activities: tuple[str, ...] = ()
    trackers: tuple[str, ...] = ()
    noises_m: tuple[float, ...] = ()
    error_m: float = 0.0
    predictors: tuple[str, ...] = ()
    modes: tuple[str, ...] = ()
    data: Path | None = None
    seconds: float | None = None
    jobs: int = 1
    cluster: str | None = None
    out: Path | None = None


@dataclass(frozen=True, kw_only=True)
class SimulationReport:
    """The result of a simulation, as shown and written.

    Attributes:
        tables, notes: for readers.
        json: the same for programs.
        files: the files written.
        disagreements: one line for each episode whose result in the whole node differs.
    """

    tables: Sequence[Table]
    notes: Sequence[str]
    json: str
    files: Sequence[Path]
    disagreements: Sequence[str]
