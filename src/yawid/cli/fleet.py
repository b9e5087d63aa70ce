"""The command ``yawid fleet``, which makes one data set from thousands of logs."""

import argparse
import re
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from yawid.cli.options import (
    Commands,
    add_command,
    add_estimator_options,
    add_log_options,
    add_signing,
    read_options_of,
    settings_of,
)
from yawid.errors import ConfigError, SinkError
from yawid.runs.stop import StopFlag
from yawid.sinks.door import print_line

if TYPE_CHECKING:
    from yawid.fleet.run_fleet import FleetRun, Plan, Progress


def add_fleet(commands: Commands) -> None:
    """Add the command to the parser."""
    fleet = add_command(
        commands, "fleet", "PATH... --out DATASET",
        "replay thousands of logs into one data set (extra fleet: URLs, Dask)",
        "yawid fleet logs/ --out data\nyawid fleet 's3://bucket/**/*.BIN' --out data --workers 16",
    )  # fmt: skip
    text = "logs, folders, globs or URLs (s3://, what fsspec knows)"
    fleet.add_argument("paths", nargs="+", metavar="PATH", help=text)
    text = "folder of the data set, on this machine"
    fleet.add_argument("--out", type=Path, required=True, metavar="DATASET", help=text)
    where = fleet.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler: tcp://HOST:8786")
    fleet.add_argument("--retry", action="store_true", help="run crashed and timed-out logs again")
    fleet.add_argument(
        "--verify", action="store_true", help="recognise logs by content, not by time"
    )
    fleet.add_argument("--dry-run", action="store_true", help="only count what would be done")
    text = "most seconds for a log (default: 600)"
    fleet.add_argument("--timeout", type=float, default=600.0, metavar="S", help=text)
    fleet.add_argument("--modes", action="store_true", help="also keep the modes of every second")
    whose = fleet.add_mutually_exclusive_group()
    text = "the aircraft of all logs (default: its serial number, or sysid:N)"
    whose.add_argument("--vehicle", metavar="NAME", help=text)
    text = "each log is of the aircraft that its folder is named after"
    whose.add_argument("--vehicle-from", choices=("folder",), help=text)
    add_signing(fleet)
    add_estimator_options(fleet)
    add_log_options(fleet)
    fleet.set_defaults(run=_fleet)


def _fleet(arguments: argparse.Namespace) -> int:
    from yawid.dataset.files import read_table
    from yawid.dataset.schema import TABLES
    from yawid.dataset.values import USAGE
    from yawid.fleet.run_fleet import dry_run, run_fleet
    from yawid.sinks.terminal.progress import Console

    run = _asked(arguments)
    if arguments.dry_run:
        plan = dry_run(run)
        text = f"{len(plan.todo)} logs, {plan.size / 1e6:.1f} MB; known already: {plan.known}"
        print_line(f"to run: {text}")
        return 0
    console = Console(sys.stderr)

    def began(plan: "Plan") -> None:
        console.say(f"{len(plan.todo)} logs to run, {plan.known} known already")

    def show(progress: "Progress") -> None:
        if console.is_due():
            console.show(progress.line())

    with StopFlag().installed() as stop:
        try:
            progress = run_fleet(run, stop, show, began)
        finally:
            console.close()
    if stop.is_set:
        left = progress.logs - progress.done
        console.say(
            f"{stop.name}: {progress.done} logs are finished and saved, {left} were not reached"
        )
    rows = ", ".join(f"{name} {len(read_table(run.out, name, ()))}" for name in TABLES)
    outcomes = Counter(read_table(run.out, "logs", ["outcome"])["outcome"].to_pylist())
    print_line(f"{run.out.absolute()}: {rows}")
    print_line(f"outcomes: {', '.join(f'{name} {n}' for name, n in sorted(outcomes.items()))}")
    if progress.failed:
        console.say(
            f"{progress.failed} logs failed for a reason that may pass: repeat the command to try "
            f"them again; {progress.why_failed}"
        )
    if usage := progress.outcomes[USAGE]:
        console.say(f"{usage} logs were not run with these options; {progress.why_usage}")
    if stop.is_set:
        return stop.exit_code
    if progress.failed or {*(progress.outcomes or outcomes)} == {"unreadable"}:
        return SinkError.exit_code
    return ConfigError.exit_code if usage else 0


def _asked(arguments: argparse.Namespace) -> "FleetRun":
    from yawid.fleet.run_fleet import FleetRun
    from yawid.fleet.spec import Spec

    options = read_options_of(arguments)
    if arguments.workers is not None and arguments.workers < 1:
        raise ConfigError(f"--workers must be at least 1, got {arguments.workers}")
    if not arguments.timeout > 0.0:
        raise ConfigError(f"--timeout must be > 0, got {arguments.timeout:g}")
    address: str | None = arguments.scheduler
    if address is not None and not re.fullmatch(r"(\w+://)?[^/]+:\d+/?", address):
        raise ConfigError(f"--scheduler must be an address, tcp://HOST:8786, got {address!r}")
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
        scheduler=address,
        retry=arguments.retry,
        verify=arguments.verify,
        timeout_s=arguments.timeout,
    )
