"""The commands: ``hri-predict demo | run | check | replay | listen | predictors | train | ...``."""

from typing import Annotated

import typer

from hri_predict import __version__
from hri_predict.cli import (
    alerts,
    config,
    convert,
    discover,
    evaluate,
    evidence,
    fleet,
    listen,
    protocol,
    run,
    service,
    train,
    urdf,
)
from hri_predict.cli.bench import bench
from hri_predict.cli.calibrate.calibrate import calibrate
from hri_predict.cli.check import check, conformance, predictors
from hri_predict.cli.commission import commission
from hri_predict.cli.explain.explain import explain
from hri_predict.cli.explain.report import report
from hri_predict.cli.init.init import init
from hri_predict.cli.register import register
from hri_predict.cli.simulate.simulate import simulate

app = typer.Typer(
    help="Predict where people near a robot will be, and advise the robot's controller in time.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"hri-predict {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """Take the options that come before a command's name; the app holds the help text."""


app.command()(run.demo)
app.command()(run.run)
app.command()(init)
app.command()(check.check)
app.command()(alerts.alerts)
app.command()(register.register)
app.command()(commission.commission)
app.command()(run.replay)
app.command()(explain)
app.command()(report)
app.command()(listen.listen)
app.command()(fleet.fleet)
app.command()(evidence.evidence)
app.command()(service.service)
app.command()(discover.discover)
app.command()(predictors.predictors)
app.command()(conformance.conformance)
app.command()(train.train)
app.command()(train.ablate)
app.command()(evaluate.evaluate)
app.command()(evaluate.card)
app.command()(calibrate)
app.command()(simulate)
app.command()(convert.convert)
app.command()(urdf.urdf)
app.add_typer(bench.app, name="bench")
app.add_typer(config.app, name="config")
app.add_typer(protocol.app, name="protocol")
