"""``calibrate``: find or check the zone sizes that give the stated coverage."""

from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.calibrate import checking, making, site
from hri_predict.cli.calibrate.inputs import HORIZON_S, Data, calibrated_settings
from hri_predict.cli.common import (
    ClusterOption,
    JobsOption,
    JointMapOption,
    JsonOption,
    one_of,
    own_map,
    processes,
    without_effect,
)
from hri_predict.lab.datasets.disturbances import DISTURBED_S
from hri_predict.lab.datasets.splits import USES


def calibrate(
    *,
    predictor: Annotated[
        str, typer.Option(help="Name of the predictor; hri-predict predictors lists them.")
    ],
    data: Annotated[list[Path], typer.Option(help="A recording, or a folder of them. Repeatable.")],
    weights: Annotated[Path | None, typer.Option(help="Weights of a trained predictor.")] = None,
    horizon: Annotated[
        float, typer.Option(help="Horizon in seconds; at most the predictor's own.")
    ] = HORIZON_S,
    check: Annotated[
        bool, typer.Option("--check", help="Measure a calibration instead of making one.")
    ] = False,
    leave_out: Annotated[
        bool,
        typer.Option(
            "--leave-out",
            help="Leave each set of the data pack out of the calibration in turn, and measure on "
            "it.",
        ),
    ] = False,
    with_noise: Annotated[
        bool,
        typer.Option(
            "--noise",
            help="Keep a calibration, and measure how much its zones grow with tracker noise.",
        ),
    ] = False,
    onto: Annotated[
        str | None,
        typer.Option(
            help="Move a calibration (shipped, or a file) towards the people in --data: those of "
            "your site.",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="With --onto: folder for a page about coverage and sizes."),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="With --check or --noise: the calibration.", show_default="the shipped one"
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            help="Split of the data pack.", show_default="calibration; with --check: test"
        ),
    ] = None,
    joint_map: JointMapOption = None,
    tracked: Annotated[
        bool | None,
        typer.Option(
            "--tracked/--as-recorded",
            help="Use each recording twice: as recorded, and slower, noisier and with gaps, as "
            "from a camera tracker.",
            show_default="tracked; with --check: as recorded",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File for the calibration; with --check: folder for tables and pictures; with "
            "--leave-out: folder for the figures and each calibration.",
            show_default="PREDICTOR.calibration.json; with --leave-out: none",
        ),
    ] = None,
    card: Annotated[
        Path | None,
        typer.Option(help="With --check: Markdown card; its section about zones is replaced."),
    ] = None,
    disturb: Annotated[
        bool,
        typer.Option(
            "--disturb", help="With --check: also with noise, a wrong scale and a moved camera."
        ),
    ] = False,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate a predictor's zones on recordings; --check measures how often they hold people.

    The number of recordings counts, not their length: a guarantee of 90 %
    needs 9, one of 95 % needs 19, and one of 99 % needs 99.

    --onto starts from an existing calibration and moves it towards your site's recordings; the
    fewer they are, the smaller the change.

    Example: hri-predict calibrate --predictor sinn --data ../shared/data
    """
    settings = calibrated_settings(predictor, weights, horizon)
    if split is not None:
        one_of("--split", split, USES)
    chosen = Data(data, split, own_map(joint_map), processes(jobs, cluster), cluster)
    if check and leave_out:
        raise ConfigError(
            "--check: has no effect with --leave-out, which measures as well; give only one of them"
        )
    given: dict[str, Any] = {
        "--onto": onto,
        "--report": report,
        "--noise": with_noise or None,
        "--calibration": calibration,
        "--disturb": disturb or None,
        "--card": card,
        "--tracked": tracked,
        "--jobs": jobs,
        "--cluster": cluster,
    }

    def refuse(where: str, *flags: str) -> None:
        without_effect({flag: given[flag] for flag in flags}, where)

    made = out or Path(f"{predictor}.calibration.json")
    if disturb and horizon < DISTURBED_S:
        raise ConfigError(
            f"--horizon {horizon:g}: --disturb measures at {DISTURBED_S:g} s; give that or more"
        )
    if check or leave_out:
        other = "with --check" if check else "with --leave-out"
        refuse(other, "--onto", "--report", "--noise")
    if check:
        checking.check(
            settings=settings,
            data=chosen,
            path=calibration,
            tracked=bool(tracked),
            out=out,
            card=card,
            disturb=disturb,
            as_json=as_json,
        )
        return
    if leave_out:
        refuse("with --leave-out", "--calibration", "--disturb", "--card", "--tracked")
        making.leave_out(settings=settings, data=chosen, out=out, as_json=as_json)
        return
    if with_noise:
        own = ("--onto", "--report", "--disturb", "--card", "--tracked", "--jobs", "--cluster")
        refuse("with --noise", *own)
        making.add_noise(
            settings=settings, data=chosen, path=calibration, out=made, as_json=as_json
        )
        return
    refuse("without --check", "--calibration", "--disturb", "--card")
    if onto is not None:
        refuse("with --onto", "--tracked", "--jobs", "--cluster")
        site.commission(
            settings=settings, data=chosen, onto=onto, out=made, report=report, as_json=as_json
        )
        return
    refuse("without --onto", "--report")
    making.make(
        settings=settings, data=chosen, tracked=tracked is not False, out=made, as_json=as_json
    )
