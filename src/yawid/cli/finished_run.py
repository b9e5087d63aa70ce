"""The commands on the file of a run: ``yawid view``, ``report`` and ``export``."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from yawid.cli.options import Commands, add_command, add_options
from yawid.cli.standard_streams import hush
from yawid.errors import ConfigError
from yawid.sinks.door import print_line, say

Run = Callable[[argparse.Namespace], int]
WHAT = ("samples", "manoeuvres", "modes", "model")
DIMENSIONS = (
    ("--mass", "KG", "mass"),
    ("--ixx", "KG_M2", "moment of inertia about the body's x axis"),
    ("--izz", "KG_M2", "that about its z axis"),
    ("--ixz", "KG_M2", "product of inertia, the integral of x z"),
    ("--area", "M2", "area of the wing"),
    ("--span", "M", "span of the wing"),
    ("--rudder-max-deg", "DEG", "deflection of the rudder at half its travel"),
    ("--aileron-max-deg", "DEG", "deflection of the aileron at half its travel"),
    ("--density", "KG_M3", "of the air (default: the standard atmosphere's at the altitude flown)"),
)


def add_finished_run(commands: Commands) -> None:
    """Add these commands to the parser."""
    view = _on_run(
        commands, "view", "show a finished run in Rerun",
        "yawid view yawid-out/flight.mcap\nyawid view yawid-out/flight.mcap --save flight.rrd",
    )  # fmt: skip
    view.add_argument("--save", type=Path, metavar="X.rrd", help="write a recording instead")
    view.add_argument(
        "--to", metavar="URL", help="send it to a viewer: rerun+http://HOST:PORT/proxy"
    )
    _add_force(view, _view, "a recording that exists")
    report = _on_run(
        commands, "report", "write a report of a finished run: one HTML file",
        "yawid report yawid-out/flight.mcap\nyawid report flight.mcap -o flight.html --force",
    )  # fmt: skip
    text = "(default: next to the MCAP, with its name)"
    report.add_argument("-o", "--out", type=Path, metavar="R.html", help=text)
    _add_force(report, _report, "files that exist")
    _add_export(commands)


def _add_export(commands: Commands) -> None:
    export = add_command(
        commands, "export", "RUN|LOG", "write samples, manoeuvres, modes or a model for others",
        "yawid export yawid-out/flight.mcap\nyawid export flight.mcap -o flight.csv --force\n"
        "yawid export flight.tlog --what model --of 2 -o model.mat",
    )  # fmt: skip
    export.add_argument(
        "log", metavar="RUN|LOG", type=Path, help="the MCAP of a finished run, or a log to replay"
    )
    export.add_argument(
        "--what", choices=WHAT, default="samples", help="what is written (default: samples)"
    )
    export.add_argument(
        "--of", default="flight", metavar="flight|bare|N",
        help="whose model: the flight's, the bare airframe's, or manoeuvre N's (default: flight)",
    )  # fmt: skip
    export.add_argument(
        "-o", "--out", type=Path, metavar="OUT.parquet|.csv|.npz|.json|.mat|.xml",
        help="(default: next to RUN or LOG, Parquet or JSON); a model: .json, .mat, .xml (JSBSim)",
    )  # fmt: skip
    group = export.add_argument_group("the aircraft, for JSBSim's coefficients (.xml)")
    add_options(group, ((name, float, metavar, text) for name, metavar, text in DIMENSIONS))
    _add_force(export, _export, "a file that exists")


def _on_run(commands: Commands, name: str, what: str, examples: str) -> argparse.ArgumentParser:
    command = add_command(commands, name, "RUN.mcap", what, examples)
    command.add_argument("mcap", metavar="RUN.mcap", type=Path, help="the file of a finished run")
    return command


def _add_force(command: argparse.ArgumentParser, run: Run, what: str) -> None:
    command.add_argument("--force", action="store_true", help=f"overwrite {what}")
    command.set_defaults(run=run)


def _view(arguments: argparse.Namespace) -> int:
    from yawid.runs.view import view

    if arguments.save is not None and arguments.save.suffix.lower() != ".rrd":
        raise ConfigError(
            f"--save writes a Rerun recording, whose name ends with .rrd, got {arguments.save}; a "
            "table is written by yawid export, a page by yawid report"
        )
    if arguments.save is not None and arguments.to is not None:
        raise ConfigError("give --save or --to, not both")
    if arguments.to is not None and not arguments.to.startswith("rerun+http"):
        raise ConfigError(f"--to must be rerun+http://HOST:PORT/proxy, got {arguments.to!r}")
    view(arguments.mcap, arguments.save, arguments.to or "spawn", force=arguments.force)
    if arguments.save is not None:
        print_line(str(arguments.save.absolute()))
    return 0


def _report(arguments: argparse.Namespace) -> int:
    if arguments.out is not None and arguments.out.suffix.lower() not in (".html", ".htm"):
        raise ConfigError(
            f"a report is one HTML file: --out must end with .html, got {arguments.out}; a browser "
            "prints it as PDF"
        )
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

    log, what, force = arguments.log, arguments.what, arguments.force
    if what == "model":
        print_line(str(_model(arguments)))
    elif format_of(log) is RUN:
        print_line(str(export(log, arguments.out, what, force=force)))
    else:
        out = log.with_suffix(".parquet") if arguments.out is None else arguments.out
        check_name(out)  # before a replay that takes long
        with TemporaryDirectory() as folder:
            print_line(str(export(run_of(log).mcap(Path(folder)), out, what, force=force)))
    return 0


def _model(arguments: argparse.Namespace) -> Path:
    from yawid.tables.model_file import MODEL_FORMATS, write_model
    from yawid.tables.replay import run_of

    which, log = arguments.of, arguments.log
    if which not in ("flight", "bare") and not which.isdigit():
        raise ConfigError(f"--of must be flight, bare or the number of a manoeuvre, got {which!r}")
    out = log.with_suffix(".json") if arguments.out is None else arguments.out
    if out.suffix not in MODEL_FORMATS:
        raise ConfigError(
            f"--out {out}: the name of a model must end in {', '.join(MODEL_FORMATS)}"
        )
    run = run_of(log, **({"lateral": "auto"} if which == "bare" else {}))
    names = [name[2:].replace("-", "_") for name, *_ in DIMENSIONS]
    given = {name: getattr(arguments, name) for name in names}
    of = int(which) if which.isdigit() else which
    path, model = write_model(run, of, out, given, force=arguments.force)
    for reason in model.reasons:
        say(f"{'warning' if model.usable else 'not usable'} {reason}")
    return path
