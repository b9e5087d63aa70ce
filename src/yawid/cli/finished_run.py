"""The commands on the file of a run: ``yawid view``, ``report`` and ``export``."""

import argparse
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from yawid.cli.options import Command, choice, numbers
from yawid.cli.standard_streams import hush
from yawid.errors import ConfigError
from yawid.sinks.door import print_line, say

WHAT = ("samples", "manoeuvres", "modes", "model")
OF_AIRCRAFT = (
    "mass", "ixx", "izz", "ixz", "area", "span", "rudder-max-deg", "aileron-max-deg", "density",
)  # fmt: skip
"""What JSBSim's coefficients need to know of the aircraft, in kg, m and deg."""


def add_view(command: Command) -> None:
    """Give the command its arguments and options."""
    examples = "yawid view yawid-out/flight.mcap\nyawid view yawid-out/flight.mcap -o flight.rrd"
    from yawid.config.fields import like

    command.shape("RUN.mcap", examples, _view)
    command.option("mcap", metavar="RUN.mcap", type=Path, help="the file of a finished run")
    command.page("X.rrd", "write a recording instead")
    text = "send it to a viewer: rerun+http://HOST:PORT/proxy"
    viewer = like(r"rerun\+http.*", "be rerun+http://HOST:PORT/proxy")
    command.option("--to", type=viewer, metavar="URL", help=text)


def add_report(command: Command) -> None:
    """Give the command its arguments and options."""
    examples = "yawid report yawid-out/flight.mcap\nyawid report flight.mcap -o flight.html --force"
    command.shape("RUN.mcap", examples, _report)
    command.option("mcap", metavar="RUN.mcap", type=Path, help="the file of a finished run")
    command.page("R.html", "(default: next to the MCAP, with its name)")


def add_export(command: Command) -> None:
    """Give the command its arguments and options."""
    from yawid.config.fields import like

    command.shape(
        "RUN|LOG",
        "yawid export yawid-out/flight.mcap\nyawid export flight.mcap -o flight.csv --force\n"
        "yawid export flight.tlog --what model --of 2 -o model.mat",
        _export,
    )
    kinds = "the MCAP of a finished run, or a log to replay"
    command.option("log", metavar="RUN|LOG", type=Path, help=kinds)
    text = "what is written (default: samples)"
    command.option("--what", **choice(*WHAT), default="samples", help=text)
    text = "whose model: the flight's, the bare airframe's, or manoeuvre N's (default: flight)"
    which = like(r"flight|bare|\d+", "be flight, bare or the number of a manoeuvre")
    command.option("--of", type=which, default="flight", metavar="flight|bare|N", help=text)
    command.page(
        "OUT.parquet|.csv|.npz|.json|.mat|.xml",
        "(default: next to RUN or LOG, Parquet or JSON); a model: .json, .mat, .xml (JSBSim)",
    )
    command.option(
        "--aircraft", type=partial(numbers, OF_AIRCRAFT), metavar="NAME=VALUE,...", rare=True,
        default={},
        help=f"for .xml: {', '.join(OF_AIRCRAFT)} in kg, m and deg; ixz is the integral of x z "
        "(density: the standard atmosphere's at the altitude flown)",
    )  # fmt: skip


def _view(arguments: argparse.Namespace) -> int:
    from yawid.runs.view import view

    if arguments.out is not None and arguments.to is not None:
        raise ConfigError("give --out or --to, not both")
    view(arguments.mcap, arguments.out, arguments.to or "spawn", force=arguments.force)
    if arguments.out is not None:
        print_line(str(arguments.out.absolute()))
    return 0


def _report(arguments: argparse.Namespace) -> int:
    hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
    from yawid.report.write import write_report
    from yawid.sinks.terminal.progress import progress

    with progress(sys.stderr, f"report of {arguments.mcap.name}"):
        path = write_report(arguments.mcap, arguments.out, force=arguments.force)
    print_line(str(path))
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from yawid.sources.formats import RUN, format_of
    from yawid.tables.export import check_name, export
    from yawid.tables.replay import run_of

    log, what = arguments.log, arguments.what
    if what == "model":
        print_line(str(_model(arguments)))
        return 0
    check_name(out := arguments.out or log.with_suffix(".parquet"))  # a replay takes long
    with TemporaryDirectory() as folder:
        mcap = log if format_of(log) is RUN else run_of(log).mcap(Path(folder))
        print_line(str(export(mcap, out, what, force=arguments.force)))
    return 0


def _model(arguments: argparse.Namespace) -> Path:
    from yawid.tables.model_file import MODEL_FORMATS, write_model
    from yawid.tables.replay import run_of

    which, log = arguments.of, arguments.log
    out = log.with_suffix(".json") if arguments.out is None else arguments.out
    if out.suffix not in MODEL_FORMATS:
        raise ConfigError(
            f"--out {out}: the name of a model must end in {', '.join(MODEL_FORMATS)}"
        )
    run = run_of(log, **({"lateral": "auto"} if which == "bare" else {}))
    given = dict.fromkeys(name.replace("-", "_") for name in OF_AIRCRAFT)
    given |= {name.replace("-", "_"): value for name, value in arguments.aircraft.items()}
    of = int(which) if which.isdigit() else which
    path, model = write_model(run, of, out, given, force=arguments.force)
    for reason in model.reasons:
        say(f"{'warning' if model.usable else 'not usable'} {reason}")
    return path
