"""Pictures of calibrated zones: stated against measured coverage, and radius by horizon.

``write_pictures`` writes them, and the filmstrip of ``filmstrip``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.figures import README_INCHES, Figure, write_figure
from hri_predict.base.looks import PALETTE
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.predictor import Predictor
from hri_predict.lab.calibration.coverage import Calibrated, Coverage
from hri_predict.lab.calibration.filmstrip import zone_filmstrip
from hri_predict.lab.calibration.judgement import WAYS, ZoneJudgement
from hri_predict.lab.calibration.scene import middle_window, zone_scene
from hri_predict.lab.calibration.scores import Scores, evidence_of
from hri_predict.zones.calibration import OFS, Calibration, plain
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import LEVELS, CoverageSettings, HumanLimits

SHOWN_MS = (200, 400, 1000)
UNDER_POINTS, OVER_POINTS = 1.0, 3.0
"""Tolerated percentage points below the stated level, and above it (as calibrated)."""
BALLS_M_S = (1.6, 2.0)
_Part = Literal["arm", "leg", "trunk"]
LIMBS: tuple[tuple[str, _Part], ...] = (("hand", "arm"), ("foot", "leg"), ("waist", "trunk"))
"""Joints whose radii are shown, without their side, and the limb that ``Reach`` bounds."""
_RADII_M = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)
_QUESTIONS = (("joint", "Each joint by itself"), ("body", "Whole body (all joints at once)"))
_BLUE, _ORANGE, _GREEN, _PINK = PALETTE[:4]
_TICKS = (0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
_ASIDE = 0.24  # between the marks of the same horizon
_TOP = 0.9995  # 100.0 % when rounded; the scale has no end
_BAND, _GREY = "#DDEFE8", "#555555"


_STYLES = dict(zip(WAYS, ((_BLUE, "o"), (_GREEN, "^"), (_ORANGE, "s")), strict=True))
_NAMES = dict(
    zip(
        WAYS,
        ("as calibrated", "as run, without the self-check", "as run (physical cut, self-check)"),
        strict=True,
    )
)
_WALKING = "walking"
_FILMED = ("walking", "washwindow")

Coverages = Mapping[tuple[float, str, str], Coverage]
"""(level, question, way) -> measured coverage; see ``judgement``."""


def write_pictures(
    *,
    out: Path,
    predictor: Predictor,
    scores: Sequence[Scores],
    judged: ZoneJudgement,
    beside: Mapping[str, tuple[Sequence[Scores], Calibrated]],
) -> list[Path]:
    """Write every picture of an evaluation of zones into a folder.

    ``zones_reliability.png``, ``zones_radii.png`` (of walking, if a recording shows it) and
    ``zones_filmstrip.png`` (walking and washing a window, or else the first two actions; not
    written if no recording shows the second after a window).

    Args:
        out: the folder.
        predictor, scores, judged, beside: see ``judgement.judge_zones``.

    Returns:
        The files.

    Raises:
        ConfigError: a file cannot be written.
    """
    figures = {
        "zones_reliability.png": reliability(judged.coverage, judged.predictor, judged.rate_hz)
    }
    walks = [i for i, s in enumerate(scores) if s.action.startswith(_WALKING)]
    shown = walks or range(len(scores))
    methods = {judged.predictor: (judged.calibration, [scores[i] for i in shown])}
    methods |= {
        name: (by.calibration, [theirs[i] for i in shown]) for name, (theirs, by) in beside.items()
    }
    what = f"recordings of {_WALKING}" if walks else "recordings"
    figures["zones_radii.png"] = radii(methods, what, HumanLimits())
    actions = [a for a in _FILMED if a in judged.actions] or list(judged.actions[:2])
    settings = CoverageSettings()
    scenes = [
        zone_scene(*found, Calibrated(predictor, judged.calibration), settings)
        for action in actions
        if (found := middle_window(scores, action)) is not None
    ]
    if scenes:
        held = "each joint" if settings.of == "joint" else "the whole body"
        subject = f"{100 * settings.level:g} % of {held}, {settings.basis}"
        figures["zones_filmstrip.png"] = zone_filmstrip(
            scenes, predictor.skeleton, judged.predictor, subject
        )
    return [write_figure(figure, out / name) for name, figure in figures.items()]


# -- coverage -----------------------------------------------------------------------------------


def reliability(coverage: Coverages, predictor: str, rate_hz: float) -> Figure:
    """Draw stated against measured coverage, with 95 % intervals by recording.

    One panel per question, one group per level. A horizon that was not measured has no mark, and a
    single recording has no interval.

    Args:
        coverage: coverage of one set of recordings, with estimated radii; missing ways are skipped.
        predictor: name of the predictor, for the title.
        rate_hz: steps per second.
    """
    figure = Figure(figsize=(README_INCHES, 5.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    ways = [way for way in WAYS if any(way == key[2] for key in coverage)]
    lowest = LEVELS[0] - UNDER_POINTS / 100
    for axes, (of, title) in zip(panels, _QUESTIONS, strict=True):
        _stated(axes)
        for (level, question, way), measured in coverage.items():
            if question == of:
                aside = _ASIDE * (ways.index(way) - (len(ways) - 1) / 2)
                place = LEVELS.index(level) * len(SHOWN_MS) + aside
                lowest = min(
                    lowest,
                    _marks(
                        axes=axes,
                        coverage=measured,
                        of=of,
                        place=place,
                        style=_STYLES[way],
                        rate_hz=rate_hz,
                    ),
                )
        axes.set_title(title, fontsize=11)
    _stretched(panels[0], lowest)
    units = max((c.names for c in coverage.values()), key=len, default=())
    actions = dict.fromkeys(a for c in coverage.values() for a in c.actions)
    figure.suptitle(
        f"Stated and measured coverage: {predictor},\n"
        f"{len(units)} recordings ({', '.join(a.replace('_', ' ') for a in actions)})",
        fontsize=12,
    )
    _explain(figure, panels[0], ways, len(units))
    return figure


def _stretched(axes: Any, lowest: float) -> None:
    """A logit scale: 90, 95 and 99 % are about equally far apart."""
    axes.set_yscale("logit")
    bottom = max(t for t in _TICKS if t <= max(lowest, _TICKS[0]))
    axes.set_ylim(bottom, _TOP)
    shown = [t for t in _TICKS if t >= bottom]
    axes.set_yticks([*shown, _TOP], [*(f"{100 * t:g}" for t in shown), "100"])
    axes.minorticks_off()
    axes.set_ylabel("measured coverage, % (stretched towards 100)", fontsize=10)


def _stated(axes: Any) -> None:
    """Draw the stated levels as a staircase that the marks should be near, and the axis below."""
    places = len(SHOWN_MS)
    for group, level in enumerate(LEVELS):
        ends = [group * places - 0.5, (group + 1) * places - 0.5]
        wanted = level - UNDER_POINTS / 100, min(level + OVER_POINTS / 100, _TOP)
        axes.fill_between(ends, *wanted, color=_BAND)
        axes.plot(ends, [level, level], color="black", linewidth=1.5)
        if group:
            axes.axvline(ends[0], color="#BBBBBB", linewidth=0.8)
    axes.set_xlim(-0.5, places * len(LEVELS) - 0.5)
    axes.set_xticks(range(places * len(LEVELS)), SHOWN_MS * len(LEVELS), fontsize=8.5)
    middle = [group * places + (places - 1) / 2 for group in range(len(LEVELS))]
    names = [f"\n{100 * level:g} %, estimated" for level in LEVELS]
    below = axes.secondary_xaxis("bottom")
    below.set_xticks(middle, names, fontsize=9.5)
    below.tick_params(length=0, pad=7)
    below.set_xlabel("ms ahead, and below it the stated coverage", fontsize=10)
    axes.grid(axis="y", alpha=0.3)


def _marks(
    *, axes: Any, coverage: Coverage, of: str, place: float, style: tuple[str, str], rate_hz: float
) -> float:
    """One mark per horizon with its interval; returns the lowest end of all intervals."""
    share = coverage.share(of)
    several = len(coverage.names) > 1  # one recording says nothing about others
    low, high = coverage.interval(of) if several else (share, share)
    colour, marker = style
    lowest = 1.0
    for index, ms in enumerate(SHOWN_MS):
        step = round(ms * rate_hz / 1000) - 1
        if not 0 <= step < len(share) or not np.isfinite(share[step]):
            continue
        x = place + index
        mark, *ends = np.clip([share[step], low[step], high[step]], _TICKS[0], _TOP)
        axes.plot([x, x], ends, "_-", color=colour, linewidth=1.3, markersize=5)
        axes.plot(x, mark, marker, color=colour, markersize=5.5, clip_on=False, zorder=3)
        lowest = min(lowest, float(ends[0]))
    return lowest


def _explain(figure: Figure, axes: Any, ways: Sequence[str], count: int) -> None:
    labels = [
        *(_NAMES[way] for way in ways),
        "stated coverage",
        f"tolerated: {UNDER_POINTS:g} point below (as calibrated, up to {OVER_POINTS:g} above)",
    ]
    handles = [
        axes.plot([], [], marker, color=colour, markersize=5.5)[0]
        for colour, marker in (_STYLES[way] for way in ways)
    ]
    handles.append(axes.plot([], [], color="black", linewidth=1.5)[0])
    handles.append(axes.fill_between([], [], [], color=_BAND))
    if count > 1:
        labels.append("95 % interval, resampling whole recordings")
        handles.append(axes.plot([], [], "|", color=_GREY, markersize=10, markeredgewidth=1.3)[0])
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=9)


# -- radii --------------------------------------------------------------------------------------


def radii(
    methods: Mapping[str, tuple[Calibration, Sequence[Scores]]],
    data: str,
    limits: HumanLimits,
    level: float = LEVELS[-1],
) -> Figure:
    """Draw the radius of a hand's, a foot's and the trunk's zone by horizon.

    Metres, without the limb's thickness.

    Args:
        methods: name -> a predictor's calibration, and its scores of the recordings; radii are
            means over their windows, and the first method is shown with the range of 90 % of
            windows.
        data: description of the recordings, for the title ("test recordings of walking").
        limits: see ``HumanLimits``.
        level: level of the calibrated radii.
    """
    figure = Figure(figsize=(README_INCHES, 4.9), layout="constrained")
    panels = figure.subplots(1, len(LIMBS), sharey=True)
    end_s = 1.0
    for axes, (joint, part) in zip(panels, LIMBS, strict=True):
        _limits(axes, limits, part, end_s)
        for (name, entry), colour in zip(methods.items(), (_BLUE, _ORANGE, _PINK), strict=False):
            _calibrated(
                axes=axes,
                name=name,
                entry=entry,
                joint=joint,
                level=level,
                colour=colour,
                with_range=name == next(iter(methods)),
            )
        axes.set_title(f"{'trunk' if part == 'trunk' else joint}", fontsize=11)
        axes.set_xlim(0, 1000 * end_s)
        axes.set_xticks(range(200, 1001, 200))
        axes.set_xlabel("ms ahead of the capture", fontsize=10)
        axes.grid(alpha=0.3)
    panels[0].set_yscale("log")  # from centimetres to what a leg can reach within a second
    panels[0].set_ylim(_RADII_M[0] / 2, _RADII_M[-1] * 1.6)
    panels[0].set_yticks(_RADII_M, [f"{r:g}" for r in _RADII_M])
    panels[0].minorticks_off()
    panels[0].set_ylabel("radius of the joint's zone, m (log scale)", fontsize=10)
    names = {s.name for _, scores in methods.values() for s in scores}
    figure.suptitle(
        f"Radii of {' and '.join(methods)}, calibrated alike ({100 * level:g} %, estimated),\n"
        f"before the physical cut; mean over the windows of {len(names)} {data}",
        fontsize=12,
    )
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=9)
    return figure


def _limits(axes: Any, limits: HumanLimits, part: _Part, end_s: float) -> None:
    """Balls that do not depend on a forecast."""
    t = np.linspace(0.0, end_s, 101)
    for speed, line in zip(BALLS_M_S, ("--", ":"), strict=True):
        axes.plot(1000 * t, speed * t, line, color="black", label=f"ball growing at {speed:g} m/s")
    own = limits.reach[part]
    reach = np.minimum(own.speed_m_s * t, (own.burst_m_s + 0.5 * own.sustained_m_s2 * t) * t)
    axes.plot(
        1000 * t, reach, "-.", color=_GREY, label="limits of what a body can do (the physical cut)"
    )


def _calibrated(
    *,
    axes: Any,
    name: str,
    entry: tuple[Calibration, Sequence[Scores]],
    joint: str,
    level: float,
    colour: str,
    with_range: bool,
) -> None:
    calibration, scores = entry
    if joint not in calibration.joints:
        return
    ms = 1000 / calibration.rate_hz * np.arange(1, calibration.steps + 1)
    for of, line in zip(OFS, ("--", "-"), strict=True):
        low, mean, high = radius_by_step(
            calibration, scores, joint, CoverageSettings(level=level, of=of)
        )
        if of == "body" and with_range and np.isfinite(high).all():
            label = f"{name}, whole body: 90 % of all joints and windows"
            axes.fill_between(ms, low, high, color=colour, alpha=0.15, label=label, lw=0)
        what = "whole body" if of == "body" else "each joint"
        label = f"{name}, {100 * level:g} % of {what}"
        axes.plot(ms, mean, line, color=colour, label=label, linewidth=1.9 if of == "body" else 1.4)


def radius_by_step(
    calibration: Calibration, scores: Sequence[Scores], joint: str, settings: CoverageSettings
) -> tuple[Floats, Floats, Floats]:
    """Estimated radii of a joint and its other side over the windows of ``scores``, metres.

    Args:
        joint: its name without its side.

    Returns:
        (H,) the 5th percentile, the mean and the 95th percentile; NaN where there is no window,
        infinite where one is not calibrated.
    """
    radii = Radii(calibration, settings, CANONICAL, calibration.steps)
    own = [i for i, name in enumerate(CANONICAL.joints) if plain(name) == joint]
    found = [radii.of(s.speed_m_s, evidence_of(s))[..., own] for s in scores]
    if not found:
        unknown = np.full(calibration.steps, np.nan)
        return unknown, unknown, unknown
    values = np.concatenate([f.swapaxes(1, 2).reshape(-1, calibration.steps) for f in found])
    low, high = np.quantile(values, (0.05, 0.95), axis=0, method="nearest")
    return low, values.mean(0), high
