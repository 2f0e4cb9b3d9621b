"""The report as HTML: what was tried, what came of it, what is open, and who answers for it."""

import json

from hri_predict.base.markup import Content, Markup, document, join, table, tag
from hri_predict.commissioning.page.plots import echo_plot, grid_plot, stopping_plot
from hri_predict.commissioning.report import (
    Echo,
    Outcome,
    Registration,
    Report,
    Signature,
    Step,
    Stopping,
    Times,
    Walk,
)
from hri_predict.commissioning.stopping import worst

_STYLE = """
@page { size: A4; margin: 16mm 14mm; }
* { box-sizing: border-box; }
body { font: 10.5pt/1.4 "Helvetica Neue", Arial, sans-serif; color: #222; margin: 0 auto;
  max-width: 182mm; padding: 6mm 0; }
h1 { font-size: 17pt; margin: 0 0 1mm; }
h2 { font-size: 12.5pt; margin: 7mm 0 1.5mm; border-bottom: 0.3mm solid #222; }
h2, h3 { break-after: avoid; }
h3 { font-size: 10.5pt; margin: 3mm 0 1mm; }
p { margin: 1.5mm 0; }
ul { margin: 1mm 0; padding-left: 5mm; }
table { border-collapse: collapse; width: 100%; margin: 1.5mm 0 3mm; font-size: 9pt; }
thead { display: table-header-group; }
tr, figure, svg { break-inside: avoid; }
th, td { border-bottom: 0.2mm solid #bbb; padding: 0.8mm 1.5mm; text-align: right;
  vertical-align: top; overflow-wrap: break-word; }
th:first-child, td:first-child { text-align: left; }
.left td, .left th { text-align: left; }
.mono { font: 8pt/1.4 Menlo, Consolas, monospace; overflow-wrap: anywhere; }
.badge { display: inline-block; padding: 0.3mm 2.5mm; border-radius: 1mm; color: #fff;
  font-weight: bold; print-color-adjust: exact; -webkit-print-color-adjust: exact; }
.passed { background: #1b7837; } .failed { background: #b2182b; }
.open { background: #9a6700; } .skipped { background: #666; }
.warning { border: 0.5mm solid #b2182b; padding: 2mm 3mm; font-weight: bold; margin: 3mm 0; }
.plots { display: flex; flex-wrap: wrap; gap: 3mm; }
figure { margin: 1mm 0; } figcaption { font-size: 9pt; }
svg { max-width: 100%; height: auto; print-color-adjust: exact;
  -webkit-print-color-adjust: exact; }
.tight td, .tight th { padding: 0.15mm 1mm; font-size: 7.5pt; }
.tight .mono { font-size: 7pt; line-height: 1.2; }
.page { break-before: page; }
.sign td { height: 13mm; } .small { font-size: 8.5pt; color: #444; }
"""
_TITLES = {
    "registration": "1 Registration of the sensor",
    "echo": "2 Reaction time through each link's echo",
    "stopping": "3 Stopping test",
    "walk": "4 Walk test",
}


def page_of(report: Report, digest: str) -> str:
    """The whole page; it loads nothing, and no script runs in it."""
    title = f"Commissioning of {report.cell}"
    return document(
        title,
        _STYLE,
        _top(report, digest, title),
        *(_step(report, name, step) for name, step in report.steps.named()),
        _less_safe(report),
        _notes(report),
        _signatures(report.signatures),
        _identity(report, digest),
    )


def _badge(outcome: Outcome) -> Markup:
    return tag("span", outcome, class_=f"badge {outcome}")


def _top(report: Report, digest: str, title: str) -> Markup:
    parts: list[Content] = [tag("h1", title), tag("p", _badge(report.outcome))]
    if report.simulated:
        parts.append(
            tag(
                "p",
                "SIMULATED: people or controllers in this report are not real. It shows that the "
                "procedure works, and nothing about the cell.",
                class_="warning",
            )
        )
    facts = [
        ("made", f"{report.made:%Y-%m-%d %H:%M} UTC"),
        ("hri-predict", report.identity.versions.get("hri-predict")),
        ("protocol", report.identity.versions.get("protocol")),
        ("configuration", tag("span", report.identity.config_hash, class_="mono")),
        ("this report", tag("span", digest, class_="mono")),
    ]
    rows = [tag("tr", tag("td", name), tag("td", value)) for name, value in facts]
    parts.append(tag("table", *rows, class_="left"))
    if report.open:
        parts += [tag("h3", "Not passed"), _list(report.open)]
    parts.append(
        tag(
            "p",
            "The node advises; it is not a safety function. This report records what was "
            "measured at "
            "this cell on that day. It does not replace the risk assessment.",
            class_="small",
        )
    )
    return join(parts)


def _step(report: Report, name: str, step: Step[object] | None) -> Markup:
    title = tag("h2", _TITLES[name], class_="page" if name == "walk" else None)
    if step is None:
        return join([title, tag("p", "Not done.")])
    by = f"{step.at:%Y-%m-%d %H:%M} UTC{f', {step.by}' if step.by else ''}"
    parts: list[Content] = [title, tag("p", _badge(step.outcome), " ", by)]
    if step.identity != report.identity.hash:
        parts.append(tag("p", "Done before the cell was changed: do it again.", class_="warning"))
    if step.simulated:
        parts.append(tag("p", "With simulated people or controllers.", class_="small"))
    if step.note:
        parts.append(tag("p", f"Note: {step.note}"))
    if step.why:
        parts.append(_list(step.why))
    result = step.result
    if isinstance(result, Registration):
        parts += _registration(result)
    elif isinstance(result, Echo):
        parts += _echo(result)
    elif isinstance(result, Stopping):
        parts += _stopping(result)
    elif isinstance(result, Walk):
        parts += _walk(result)
    return join(parts)


def _registration(result: Registration) -> list[Content]:
    rows = [
        (
            ", ".join(f"{v:.3f}" for v in point.point),
            ", ".join(f"{v:.3f}" for v in point.seen),
            _mm(point.spread_m),
            _mm(point.error_m),
            _mm(point.residual_m),
        )
        for point in result.points
    ]
    head = ("point touched, m", f"{result.joint} seen at, m", "noise, mm", "error, mm", "fit, mm")
    return [
        table(head, rows),
        tag(
            "p",
            f"Error: with the pose as configured. Allowed: {_mm(result.tolerance_m)} mm "
            f"(risk.person_uncertainty_m). Fit: with the pose that fits these points best. "
            f"{'That pose was written into the configuration. ' if result.written else ''}"
            f"Lengths of the room per length of the source: {result.scale:.3f}.",
            class_="small",
        ),
    ]


def _echo(result: Echo) -> list[Content]:
    rows = [
        (
            link.link,
            link.echoes,
            _times(link.in_node),
            _times(link.round_trip),
            _ms(link.both_ways_ms),
            f"{link.allowed_ms:.1f}",
            link.measured_by or "no one",
        )
        for link in result.links
    ]
    head = (
        "link", "echoes", "in the node: p50 / p99 / max", "round trip: p50 / p99 / max",
        "on the link, both ways: max", "allowed", "measured by",
    )  # fmt: skip
    plots = [
        tag("figure", echo_plot(link), tag("figcaption", link.link))
        for link in result.links
        if link.in_node is not None
    ]
    return [
        tag("p", f"Measured for {result.seconds:g} s in shadow mode; times in milliseconds."),
        table(head, rows),
        tag(
            "p",
            "Round trip: from sending a RobotState until an advice that echoes its counter, by the "
            "controller. Allowed: twice delay_s and what may block the wire. The node alone cannot "
            "see the wire.",
            class_="small",
        ),
        tag("div", *plots, class_="plots"),
    ]


def _stopping(result: Stopping) -> list[Content]:
    rows = []
    for (robot, stated), stop in worst(result).items():
        count = sum(s.robot == robot and s.stated_m_s == stated for s in result.stops)
        rows.append(
            (
                f"{robot}, {stated:g} m/s",
                count,
                f"{stop.speed_m_s:.2f}",
                _of(stop.total_s, stop.allowed_s),
                _of(stop.total_m, stop.allowed_m),
                _of(stop.braking_s, stop.table_s),
                _of(stop.braking_m, stop.table_m),
                stop.measured_by,
                "yes" if stop.passed else "NO",
            )
        )
    head = (
        "robot, stated speed", "stops", "m/s", "whole / allowed, ms", "mm",
        "braking / table, ms", "mm", "by", "passed",
    )  # fmt: skip
    plots = [
        tag("figure", stopping_plot(curve, stops, distance), tag("figcaption", curve.robot))
        for curve in result.curves
        if (stops := [s for s in result.stops if s.robot == curve.robot])
        for distance in (False, True)
    ]
    finest = max((1e3 * stop.resolution_s for stop in result.stops), default=0.0)
    return [
        tag("p", "The worst stop at each speed, from the command and from the onset of braking."),
        table(head, rows),
        tag("div", *plots, class_="plots"),
        tag(
            "p",
            f"Line: stopping table. RobotStates came at most {finest:.0f} ms apart, so a braking "
            f"time is known to twice that; this is allowed beyond the table, and not beyond the "
            f"whole.",
            class_="small",
        ),
    ]


def _walk(result: Walk) -> list[Content]:
    grid = result.grid
    rows = [
        (
            robot.robot,
            ", ".join(f"{name} {count}" for name, count in robot.ticks_at.items()),
            robot.stops,
            "-" if robot.least_separation_m is None else f"{robot.least_separation_m:.2f}",
            f"{robot.mean_limit_m_s:.2f}",
        )
        for robot in result.robots
    ]
    return [
        tag(
            "p",
            tag("strong", f"{100 * grid.coverage:.0f} %"),
            f" of the floor that counts ({len(grid.area)} cells of {grid.cell_m:g} m; "
            f"{100 * result.least_coverage:.0f} % asked for), {result.seconds:.0f} s; people "
            f"vanished in view: {result.people_lost}.",
        ),
        tag("figure", grid_plot(grid)),
        tag(
            "p",
            "Blue: a person was seen, darker for longer. White: no person was seen there, because "
            "none walked there or because the sensor does not see it. Red cross: a person "
            "vanished. Grey: outside source.field_of_view. The floor that counts is within each "
            "robot's reach plus the protective separation distance.",
            class_="small",
        ),
        table(("robot", "ticks at each level", "stops", "nearest, m", "mean limit, m/s"), rows),
        tag(
            "p",
            f"Recording {result.recording}, SHA-256 ",
            tag("span", result.recording_sha256, class_="mono"),
            f"; advices {result.advices}, SHA-256 ",
            tag("span", result.advices_sha256, class_="mono"),
            class_="small",
        ),
    ]


def _less_safe(report: Report) -> Markup:
    title = tag("h2", "5 Settings that are less safe than their defaults")
    if not report.less_safe:
        return join([title, tag("p", "None.")])
    rows = [(*line.partition(": ")[::2], "") for line in report.less_safe]
    block = table(("setting", "value, and what it permits", "accepted by"), rows)
    return join([title, tag("div", block, class_="left")])


def _notes(report: Report) -> Markup:
    content = _list(report.notes) if report.notes else tag("p", "None.")
    return join([tag("h2", "6 Open notes"), content])


def _signatures(signatures: list[Signature]) -> Markup:
    shown = signatures or [Signature(role="carried out by"), Signature(role="checked by")]
    rows = [(each.role, each.name, each.date, "") for each in shown]
    block = table(("role", "name", "date", "signature"), rows)
    return join([tag("h2", "Signatures"), tag("div", block, class_="left sign")])


def _identity(report: Report, digest: str) -> Markup:
    files = [
        (key, file.path, tag("span", file.sha256, class_="mono"))
        for key, file in report.identity.files.items()
    ]
    values = [
        (key, tag("span", json.dumps(value, ensure_ascii=False), class_="mono"))
        for key, value in report.identity.config.items()
    ]
    return join(
        [
            tag("h2", "What was validated"),
            tag("h3", "Files that the configuration depends on"),
            tag("div", table(("key", "file", "SHA-256"), files), class_="left"),
            tag("h3", "Versions"),
            tag("div", table(("what", "version"), report.identity.versions.items()), class_="left"),
            tag("h3", "Configuration, with all defaults"),
            tag("div", table(("key", "value"), values), class_="left tight"),
            tag(
                "p",
                "The hash of this report, ",
                tag("span", digest, class_="mono"),
                ", is over report.json, from which this page was made. It shows damage and "
                "careless editing. It has no secret in it: who changes the report on purpose can "
                "compute it again. Note it elsewhere, or sign the print.",
                class_="small",
            ),
        ]
    )


def _list(lines: list[str]) -> Markup:
    return tag("ul", *(tag("li", line) for line in lines))


def _times(times: Times | None) -> str:
    if times is None:
        return "-"
    return f"{times.p50_ms:.1f} / {times.p99_ms:.1f} / {times.max_ms:.1f}"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _mm(value: float) -> str:
    return f"{1e3 * value:.0f}"


def _of(value: float | None, allowed: float) -> str:
    return "-" if value is None else f"{1e3 * value:.0f} / {1e3 * allowed:.0f}"
