"""The commands on the file of a run: ``yawid view``, ``report``, ``export`` and ``recover``."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from yawid.cli.options import Commands, add_command
from yawid.cli.standard_streams import hush
from yawid.sinks.door import say, tell

Run = Callable[[argparse.Namespace], int]


def add_finished_run(commands: Commands) -> None:
    """Add these commands to the parser."""
    view = _on_run(
        commands, "view", "show a finished run in Rerun, PlotJuggler or Foxglove",
        "yawid view yawid-out/flight.mcap\nyawid view yawid-out/flight.mcap --in plotjuggler",
    )  # fmt: skip
    view.add_argument(
        "--in", dest="viewer", choices=("rerun", "plotjuggler", "foxglove"), default="rerun",
        help="the program to show it in (default: rerun)",
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
    report.add_argument(
        "-o", "--out", type=Path, metavar="R.html",
        help="(default: next to the MCAP, with its name)",
    )  # fmt: skip
    report.add_argument(
        "--png", type=Path, metavar="DIR", help="also write its pictures, a PNG each, into DIR"
    )
    _add_force(report, _report, "files that exist")
    export = _on_run(
        commands, "export", "write a finished run's samples and results as a table",
        "yawid export yawid-out/flight.mcap\nyawid export flight.mcap -o flight.csv --force",
    )  # fmt: skip
    export.add_argument(
        "-o", "--out", type=Path, metavar="OUT.parquet|.csv|.npz",
        help="(default: Parquet next to the MCAP, with its name)",
    )  # fmt: skip
    _add_force(export, _export, "a file that exists")
    recover = add_command(
        commands, "recover", "BROKEN.mcap -o OUT.mcap",
        "make a proper MCAP of one that was cut off",
        "yawid recover yawid-out/live.mcap.part -o flight.mcap\n"
        "yawid recover damaged.mcap -o whole.mcap --force",
    )  # fmt: skip
    recover.add_argument(
        "broken", metavar="BROKEN.mcap", type=Path, help="what a crash left, .part or damaged"
    )
    recover.add_argument(
        "-o", "--out", metavar="OUT.mcap", type=Path, required=True, help="the file to write"
    )
    _add_force(recover, _recover, "a file that exists")


def _on_run(commands: Commands, name: str, what: str, examples: str) -> argparse.ArgumentParser:
    """Add a command that takes the file of a finished run."""
    command = add_command(commands, name, "RUN.mcap", what, examples)
    command.add_argument("mcap", metavar="RUN.mcap", type=Path, help="the file of a finished run")
    return command


def _add_force(command: argparse.ArgumentParser, run: Run, what: str) -> None:
    """Add the option ``--force``, and set the function that runs the command."""
    command.add_argument("--force", action="store_true", help=f"overwrite {what}")
    command.set_defaults(run=run)


def _view(arguments: argparse.Namespace) -> int:
    from yawid.errors import ConfigError
    from yawid.runs.view import VIEWERS, view

    if arguments.viewer != "rerun":
        if arguments.save is not None or arguments.to is not None or arguments.force:
            raise ConfigError(
                f"--save, --to and --force work with Rerun only, not with {arguments.viewer}"
            )
        tell(str(VIEWERS[arguments.viewer](arguments.mcap)))
        return 0
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
        tell(str(arguments.save.absolute()))
    return 0


def _report(arguments: argparse.Namespace) -> int:
    from yawid.errors import ConfigError

    if arguments.out is not None and arguments.out.suffix.lower() not in (".html", ".htm"):
        raise ConfigError(
            f"a report is one HTML file: --out must end with .html, got {arguments.out}; a browser "
            "prints it as PDF"
        )
    hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
    from yawid.report.write import write_report
    from yawid.sinks.terminal.progress import progress

    with progress(sys.stderr, f"report of {arguments.mcap.name}"):
        path = write_report(arguments.mcap, arguments.out, png=arguments.png, force=arguments.force)
    tell(str(path))
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from yawid.tables.export import export

    tell(str(export(arguments.mcap, arguments.out, force=arguments.force)))
    return 0


def _recover(arguments: argparse.Namespace) -> int:
    from yawid.sinks.mcap.recover import recover

    found = recover(arguments.broken, arguments.out, force=arguments.force)
    topics = ", ".join(f"{topic} {count}" for topic, count in sorted(found.counts.items()))
    if found.left_out:
        say(f"left out, as it is damaged or unknown: {found.left_out}")
    tell(f"{arguments.out}: {topics}")
    return 0
