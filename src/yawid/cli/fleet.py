"""The command ``yawid fleet``, which makes one data set from thousands of logs."""

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from yawid.cli.options import Command, add_run_options, choice, read_options_of, settings_of
from yawid.errors import ConfigError, SinkError
from yawid.runs.stop import StopFlag
from yawid.sinks.door import print_line, say

if TYPE_CHECKING:
    from yawid.fleet.run_fleet import FleetRun, Progress


def add_fleet(command: Command) -> None:
    """Give the command its arguments and options."""
    from msgspec import Meta

    from yawid.config.fields import Positive, like

    command.shape(
        "PATH... --out DATASET",
        "yawid fleet logs/ --out data\nyawid fleet 's3://bucket/**/*.BIN' --out data --workers 16",
        _fleet,
    )
    text = "logs, folders, globs or URLs (s3://, what fsspec knows; extra fleet)"
    command.option("paths", nargs="+", metavar="PATH", help=text)
    text = "folder of the data set, on this machine"
    command.option("--out", type=Path, required=True, metavar="DATASET", help=text)
    workers = Annotated[int, Meta(ge=1, description="be a whole number from 1")]
    command.option("--workers", type=workers, metavar="N", help="processes (default: one a core)")
    text = "a Dask scheduler in place of them: tcp://HOST:8786"
    address = like(r"(\w+://)?[^/]+:\d+/?", "be an address, tcp://HOST:8786")
    command.option("--scheduler", type=address, metavar="ADDRESS", help=text)
    command.flag("--retry", "run crashed and timed-out logs again")
    command.flag("--dry-run", "only count what would be done")
    text = "most seconds for a log (default: 600)"
    command.option("--timeout", type=Positive, default=600.0, metavar="S", help=text, rare=True)
    command.flag("--modes", "also keep the modes of every second", rare=True)
    text = "the aircraft of all logs (default: its serial number, or sysid:N)"
    command.option("--vehicle", metavar="NAME", help=text)
    text = "each log is of the aircraft that its folder is named after"
    command.option("--vehicle-from", **choice("folder"), help=text)
    add_run_options(command)


def _fleet(arguments: argparse.Namespace) -> int:
    from yawid.dataset.files import read_table
    from yawid.dataset.schema import TABLES
    from yawid.dataset.values import FAILED, USAGE
    from yawid.fleet.run_fleet import dry_run, run_fleet
    from yawid.sinks.terminal.console import Console

    run = _asked(arguments)
    if arguments.dry_run:
        planned = dry_run(run)
        size = f"{len(planned.todo)} logs, {planned.size / 1e6:.1f} MB"
        text = f"{size}; known already: {planned.known}"
        print_line(f"to run: {text}")
        return 0
    console = Console(sys.stderr)

    def began(progress: "Progress") -> None:
        console.say(f"{len(progress.todo)} logs to run, {progress.known} known already")

    def show(progress: "Progress") -> None:
        if console.is_due():
            console.show(progress.line())

    with StopFlag().installed() as stop:
        try:
            progress = run_fleet(run, stop, show, began)
        finally:
            console.close()
    if stop.is_set:
        left = len(progress.todo) - progress.done
        say(f"{stop.name}: {progress.done} logs are finished and saved, {left} were not reached")
    rows = ", ".join(f"{name} {len(read_table(run.out, name, ()))}" for name in TABLES)
    outcomes = Counter(read_table(run.out, "logs", ["outcome"])["outcome"].to_pylist())
    print_line(f"{run.out.absolute()}: {rows}")
    print_line(f"outcomes: {', '.join(f'{name} {n}' for name, n in sorted(outcomes.items()))}")
    if failed := progress.outcomes[FAILED]:
        say(
            f"{failed} logs failed for a reason that may pass: repeat the command to try them "
            f"again; {progress.first[FAILED]}"
        )
    if usage := progress.outcomes[USAGE]:
        say(f"{usage} logs were not run with these options; {progress.first[USAGE]}")
    if stop.is_set:
        return stop.exit_code
    if failed or {*(progress.outcomes or outcomes)} == {"unreadable"}:
        return SinkError.exit_code
    return ConfigError.exit_code if usage else 0


def _asked(arguments: argparse.Namespace) -> "FleetRun":
    from yawid.fleet.run_fleet import FleetRun
    from yawid.fleet.spec import Spec

    options = read_options_of(arguments)
    for one, other in (("workers", "scheduler"), ("vehicle", "vehicle_from")):
        if getattr(arguments, one) is not None and getattr(arguments, other) is not None:
            raise ConfigError(f"give --{one} or --{other.replace('_', '-')}, not both")
    key_file = None if options.key_file is None else str(options.key_file.absolute())
    return FleetRun(
        paths=arguments.paths,
        out=arguments.out,
        spec=Spec(
            settings_of(arguments),
            key_file,
            arguments.modes,
            arguments.vehicle,
            arguments.vehicle_from,
        ),
        workers=arguments.workers,
        scheduler=arguments.scheduler,
        retry=arguments.retry,
        timeout_s=arguments.timeout,
    )
