"""The commands: ``hri-predict demo | run | check | replay | listen | predictors | train | ...``."""

import typer

from hri_predict.cli import (
    bench,
    calibrate,
    check,
    convert,
    discover,
    evaluate,
    fleet,
    listen,
    run,
    simulate,
    train,
)

app = typer.Typer(
    help="Predicts where people near a robot will be, and advises the robot's controller in time.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(run.demo)
app.command()(run.run)
app.command()(check.check)
app.command()(run.replay)
app.command()(listen.listen)
app.command()(fleet.fleet)
app.command()(discover.discover)
app.command()(check.predictors)
app.command()(train.train)
app.command()(evaluate.evaluate)
app.command()(calibrate.calibrate)
app.command()(simulate.simulate)
app.command()(convert.convert)
app.add_typer(bench.app, name="bench")
