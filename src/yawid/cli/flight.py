"""The commands on a flight: ``yawid replay``, ``live``, ``inspect`` and ``orders``."""

import argparse
import sys
import webbrowser
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from yawid.cli.main import code_of
from yawid.cli.options import (
    ALL,
    RUN_OPTIONS,
    WRITTEN,
    AsJson,
    command,
    read_options_of,
    said,
    settings_of,
)
from yawid.config.fields import like
from yawid.config.run import COLUMNS, STREAM
from yawid.errors import ConfigError, UnwrittenError
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.door import print_answer, print_line, say
from yawid.sources.formats import RUN, recorded
from yawid.system.stores import Place, place_of

if TYPE_CHECKING:
    from yawid.answers.run_summary import RunSummary
    from yawid.sinks.pages import Page

DEFAULT_OUT = "yawid-out"
INTERRUPTED = 130
ASKED_HZ = 50.0
_ENDPOINT = (
    "udpin:HOST:PORT, udpbcast:HOST:PORT, mcast:, tcp:HOST:PORT or a serial port such as "
    "/dev/ttyUSB0,57600; udpout:HOST:PORT with --request-rates; IPv6 as udpin:[::1]:14560"
)
_PUBLISH = (
    "transmit: the answer once a second as MAVLink, NAMED_VALUE_FLOAT and STATUSTEXT, to "
    "udpout:HOST:PORT (a ground station listens there), to whoever sends to udpin:HOST:PORT, "
    "or to tap: back over the tap's own link, so to the vehicle as well; may be given several "
    "times (default: transmit nothing)"
)
_REQUEST = (
    "transmit: ask the vehicle for attitude and servos at HZ, 50 if left out "
    "(default: transmit nothing)"
)
_VIEWER = "a Rerun recording, or a viewer: rerun+http://HOST:PORT/proxy (default: off)"
_LIVE_VIEWER = (
    "a Rerun recording, or a viewer: spawn its window, serve it to this machine's browser, or "
    "rerun+http://HOST:PORT/proxy (default: off)"
)
_REPORT = "write a report next to each answer; on a terminal, open one log's in the browser"
Log = Annotated[Path, said("LOG", recorded())]
Out = Annotated[Path, said("DIR", f"folder of the files (default: {DEFAULT_OUT})", group=WRITTEN)]
ForceAll = Annotated[bool, said("", "overwrite files that exist", "--force", group=WRITTEN)]
EachAsJson = Annotated[bool, said("", "print one JSON object per log", "--json", group=WRITTEN)]
Viewer = Annotated[
    str,
    like(r"off|save|spawn|rerun\+http.*", "be off, save, spawn or rerun+http://..."),
    said("off|save|spawn|URL", _VIEWER, group=WRITTEN),
]
LiveViewer = Annotated[
    str,
    like(r"off|save|spawn|serve|rerun\+http.*", "be off, save, spawn, serve or rerun+http://..."),
    said("off|save|spawn|serve|URL", _LIVE_VIEWER, group=WRITTEN),
]


@command(
    "LOG...",
    "yawid replay flight.tlog --report\nyawid replay flight.tlog --rerun save\n"
    "yawid replay day/*.BIN --out answers --json > answers.jsonl",
    RUN_OPTIONS,
)
def replay(
    arguments: argparse.Namespace,
    logs: Annotated[
        list[Place], said("LOG", f"{recorded()}, or {RUN.said}", nargs="+", type=place_of)
    ],
    *,
    out: Out = Path(DEFAULT_OUT),
    force: ForceAll = False,
    as_json: EachAsJson = False,
    rerun: Viewer = "off",
    report: Annotated[bool, said("", _REPORT, group=WRITTEN)] = False,
) -> int:
    """Replay each log; return the highest exit code."""
    from yawid.runs.outputs import Outputs, output_names
    from yawid.runs.replay import replay as replay_log

    settings, read_options = settings_of(arguments), read_options_of(arguments)
    _compile_behind()

    def run(log: Place, outputs: Outputs) -> int:
        try:
            summary = replay_log(log, settings, outputs, stop, read_options)
        except UnwrittenError as error:
            print_answer(error.summary, _page_of, as_json=as_json)
            raise
        print_answer(summary, _page_of, as_json=as_json)
        if report:
            _write_report(summary, force=force, as_json=as_json, is_only=len(logs) == 1)
        return summary.exit_code

    codes: list[int] = []
    unreached: list[Place] = []
    with StopFlag().installed() as stop:
        for log, name in zip(logs, output_names(logs), strict=True):
            if stop.is_set:
                unreached.append(log)
                continue
            try:
                codes.append(code_of(partial(run, log, Outputs(out, name, rerun, force))))
            except Interrupted:
                unreached.append(log)
    if unreached:
        say(f"{stop.name}: not reached: {', '.join(map(str, unreached))}")
    if unreached or (stop.is_set and INTERRUPTED in codes):
        return stop.exit_code  # the verdict's code is that of SIGINT, even after SIGTERM
    return max(codes, default=0)


def _page_of(summary: "RunSummary") -> "Page":
    from yawid.sinks.run_page import whole_page  # --json needs nothing of it

    return whole_page(summary)


def _write_report(summary: "RunSummary", *, force: bool, as_json: bool, is_only: bool) -> None:
    """Write the report of a run; open it in the browser if somebody waits for one log's."""
    from yawid.report.write import write_report
    from yawid.system.processes import has_desktop

    page = write_report(Path((summary.files or {})["mcap"]), force=force)
    (say if as_json else print_line)(f"report: {page}")
    if is_only and sys.stdout.isatty() and has_desktop():
        webbrowser.open(page.as_uri())


def _compile_behind() -> None:
    """Compile the estimators in another process during the first run, if a person starts it."""
    from yawid.estimation.machine.kept import passed_by
    from yawid.estimation.machine.runner import RUNNER

    if sys.stderr.isatty() and RUNNER.compile_behind():
        say("first run: the estimators are being compiled in the background, once per installation")
        if why := passed_by():
            say(why)


@command(
    "ENDPOINT",
    "yawid live udpin:127.0.0.1:14560\nyawid live /dev/ttyUSB0,57600 --sysid 3 --rerun spawn",
    RUN_OPTIONS - {COLUMNS},
)
def live(
    arguments: argparse.Namespace,
    endpoint: Annotated[str, said("ENDPOINT", _ENDPOINT)],
    *,
    seconds: Annotated[float | None, said("N", "stop after N seconds (default: at Ctrl-C)")] = None,
    no_record: Annotated[bool, said("", "write no tlog", rare=True)] = False,
    request_rates: Annotated[float | None, said("HZ", _REQUEST, nargs="?", const=ASKED_HZ)] = None,
    publish: Annotated[Sequence[str], said("ENDPOINT", _PUBLISH)] = (),
    out: Out = Path(DEFAULT_OUT),
    force: ForceAll = False,
    as_json: EachAsJson = False,
    rerun: LiveViewer = "off",
) -> int:
    """Run a live session; print the result of each vehicle's and return the highest exit code."""
    from yawid.config.run import RunConfig
    from yawid.runs.live import LiveOptions, session_name
    from yawid.runs.live import live as live_session
    from yawid.runs.outputs import Outputs, served
    from yawid.sinks.terminal.console import console_for

    if Path(endpoint).is_file():
        raise ConfigError(
            f"{endpoint} is a file, not a live link: use yawid replay for a log, or give "
            "an endpoint such as udpin:127.0.0.1:14560"
        )
    every_vehicle = arguments.sysid == ALL
    if every_vehicle:
        arguments.sysid = None
    config = RunConfig(**settings_of(arguments))
    outputs = Outputs(out, session_name(), rerun, force, not no_record)
    options = LiveOptions(
        endpoint, seconds, request_rates, every_vehicle=every_vehicle, publish=tuple(publish)
    )
    read, console = read_options_of(arguments), console_for(sys.stderr)
    with StopFlag().installed() as stop, served(outputs) as outputs:
        ended = live_session(options, config, outputs, stop, console, read)
    for session in ended:
        print_answer(session.summary, _page_of, as_json=as_json)
    return max(session.exit_code for session in ended)


@command(
    "LOG",
    "yawid inspect flight.tlog\nyawid inspect flight.tlog --card | lp\n"
    "yawid inspect flight.BIN --json --from 300 --to 420",
    RUN_OPTIONS,
)
def inspect(
    arguments: argparse.Namespace,
    log: Log,
    *,
    card: Annotated[bool, said("", "print what to fly next instead: a card on one page")] = False,
    as_json: AsJson = False,
) -> int:
    """Print what a log can answer."""
    from yawid.runs.inspect_log import inspect as inspect_log
    from yawid.sinks.terminal.inspection import card_page, inspection_page

    settings, read_options = settings_of(arguments), read_options_of(arguments)
    report = inspect_log(log, settings, read_options, with_card=card)
    print_answer(report, card_page if card else inspection_page, as_json=as_json)
    return report.exit_code


@command(
    "LOG",
    "yawid orders flight.tlog\nyawid orders flight.tlog --from 300 --to 420",
    RUN_OPTIONS - {STREAM},  # they mean nothing here
)
def orders(arguments: argparse.Namespace, log: Log, *, as_json: AsJson = False) -> int:
    """Print which orders describe a log best."""
    from yawid.runs.choose_orders import orders_report
    from yawid.sinks.run_page import orders_page

    report = orders_report(log, settings_of(arguments), read_options_of(arguments))
    print_answer(report, orders_page, as_json=as_json)
    return report.verdict.exit_code
