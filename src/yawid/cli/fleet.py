"""The commands on many flights: ``yawid fleet``, ``trend``, ``diff`` and ``serve``."""

import argparse
import sys
import webbrowser
from collections import Counter
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from yawid.cli.options import (
    RUN_OPTIONS,
    AsJson,
    Force,
    command,
    read_options_of,
    said,
    settings_of,
)
from yawid.config.fields import Positive, like
from yawid.errors import ConfigError, SinkError, SourceError
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.door import print_answer, print_line, say
from yawid.system.stores import Place, place_of

if TYPE_CHECKING:
    from yawid.fleet.run_fleet import FleetRun, Progress
    from yawid.trend.diff import Diff
    from yawid.trend.trend import Trend

CHANGED = 7
NOTHING_COMPARED = 5
_PATHS = "logs, folders, globs or URLs (s3://, what fsspec knows; extra fleet)"
_NAME = "the aircraft of all logs (default: its serial number, or sysid:N)"
_SCHEDULER = "a Dask scheduler in place of them: tcp://HOST:8786"


@command(
    "PATH... --out DATASET",
    "yawid fleet logs/ --out data\nyawid fleet 's3://bucket/**/*.BIN' --out data --workers 16",
    RUN_OPTIONS,
)
def fleet(
    arguments: argparse.Namespace,
    paths: Annotated[list[str], said("PATH", _PATHS, nargs="+")],
    *,
    out: Annotated[Path, said("DATASET", "folder of the data set, on this machine")],
    workers: Annotated[
        int | None,
        Meta(ge=1, description="be a whole number from 1"),
        said("N", "processes (default: one a core)"),
    ] = None,
    scheduler: Annotated[
        str | None,
        like(r"(\w+://)?[^/]+:\d+/?", "be an address, tcp://HOST:8786"),
        said("ADDRESS", _SCHEDULER),
    ] = None,
    retry: Annotated[bool, said("", "run crashed and timed-out logs again")] = False,
    dry_run: Annotated[bool, said("", "only count what would be done")] = False,
    timeout: Annotated[
        Positive, said("S", "most seconds for a log (default: 600)", rare=True)
    ] = 600.0,
    modes: Annotated[bool, said("", "also keep the modes of every second", rare=True)] = False,
    vehicle: Annotated[str | None, said("NAME", _NAME)] = None,
    vehicle_from: Annotated[
        Literal["folder"] | None,
        said("", "each log is of the aircraft that its folder is named after"),
    ] = None,
) -> int:
    """Make one data set of thousands of logs."""
    from yawid.fleet import run_fleet
    from yawid.fleet.spec import Spec

    for one, other in ("workers", "scheduler"), ("vehicle", "vehicle_from"):
        if getattr(arguments, one) is not None and getattr(arguments, other) is not None:
            raise ConfigError(f"give --{one} or --{other.replace('_', '-')}, not both")
    spec = Spec(settings_of(arguments), _key_file(arguments), modes, vehicle, vehicle_from)
    run = run_fleet.FleetRun(
        paths=paths, out=out, spec=spec, workers=workers, scheduler=scheduler, retry=retry,
        timeout_s=timeout,
    )  # fmt: skip
    if dry_run:
        planned = run_fleet.dry_run(run)
        size = f"{len(planned.todo)} logs, {planned.size / 1e6:.1f} MB"
        print_line(f"to run: {size}; known already: {planned.known}")
        return 0
    return _run(run)


def _key_file(arguments: argparse.Namespace) -> str | None:
    key = read_options_of(arguments).key_file
    return None if key is None else str(key.absolute())


def _run(run: "FleetRun") -> int:
    from yawid.dataset.files import read_table
    from yawid.dataset.schema import TABLES
    from yawid.dataset.values import FAILED, USAGE
    from yawid.fleet.run_fleet import run_fleet
    from yawid.sinks.terminal.console import Console

    console = Console(sys.stderr)

    def began(progress: "Progress") -> None:
        console.say(f"{len(progress.todo)} logs to run, {progress.known} known already")

    def show(progress: "Progress") -> None:
        if console.is_due():
            console.show(progress.line())

    with StopFlag().installed() as stop, closing(console):
        progress = run_fleet(run, stop, show, began)
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


@command("DATASET", "yawid trend data\nyawid trend data --vehicle serial:4711 -o trend.html")
def trend(
    dataset: Annotated[Path, said("DATASET", "folder made by yawid fleet")],
    *,
    vehicle: Annotated[str | None, said("ID", "only this vehicle, judged among all")] = None,
    as_json: AsJson = False,
    out: Annotated[Path | None, said("R.html", "write a page as well", "-o", "--out")] = None,
    force: Force = False,
) -> int:
    """Print what changed over a fleet's flights."""
    from yawid.trend.table import trend_page
    from yawid.trend.trend import trend as trend_of

    report, studied = trend_of(dataset, vehicle)
    if out is not None:
        from yawid.trend.page import write_page

        write_page(report, studied, out, force=force)
    print_answer(report, trend_page, as_json=as_json)
    return _code(report)


RunOrSet = Annotated[Place, said("", "the MCAP of a finished run, or a data set", type=place_of)]


@command("A B", "yawid diff before.mcap after.mcap\nyawid diff data-2025 data-2026 --json")
def diff(a: RunOrSet, b: RunOrSet, *, as_json: AsJson = False) -> int:
    """Print what changed between two runs or data sets."""
    from yawid.trend.diff import diff as diff_of
    from yawid.trend.table import diff_page

    report = diff_of(a, b)
    print_answer(report, diff_page, as_json=as_json)
    return _code(report)


def _code(report: "Trend | Diff") -> int:
    if report.changed:
        return CHANGED
    return 0 if report.judged else NOTHING_COMPARED


@command("[FOLDER]", "yawid serve\nyawid serve logs --port 8041 --no-browser", RUN_OPTIONS)
def serve(
    arguments: argparse.Namespace,
    folder: Annotated[
        Path, said("DIR", "folder of the logs (default: the current one)", nargs="?")
    ] = Path(),
    *,
    port: Annotated[
        int,
        Meta(ge=0, le=65535, description="be a port, or 0 for a free one"),
        said("N", "port of the page (default: 8040)"),
    ] = 8040,
    no_browser: Annotated[bool, said("", "open no browser, only print the address")] = False,
) -> int:
    """Serve a folder's flights as pages, on this machine alone, until a signal ends it."""
    from yawid.fleet.spec import Spec
    from yawid.system.processes import HERE, has_desktop

    if not folder.is_dir():
        raise SourceError(f"{folder} is no folder: make it, or give the folder of the logs")
    try:
        from yawid.serve import server
    except ImportError as error:
        raise ConfigError(f"{error}: pip install 'yawid[serve]'") from error
    from yawid.serve.flights import Flights

    spec = Spec(settings_of(arguments), _key_file(arguments))
    with closing(server.opened(port)) as listening, ExitStack() as stack:
        running = server.server_of(Flights(folder.absolute(), spec, stack))
        address = f"http://{HERE}:{listening.getsockname()[1]}/"
        print_line(f"{address} shows the flights in {folder.absolute()}; Ctrl-C ends it")
        if not no_browser and has_desktop():
            webbrowser.open(address)
        with suppress(Interrupted):
            running.run(sockets=[listening])
    return 0
