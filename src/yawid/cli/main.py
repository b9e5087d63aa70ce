"""The command line: arguments to a configuration, errors to one line and an exit code.

Exit codes: 0 good, 1 regression mismatch, 2 usage or configuration, 3 no vehicle, rudder or yaw, 4
rate too low for an answer, 5 not excited or not identifiable, 6 input or output failed, 7 something
changed (trend, diff), 130 and 143 interrupted by SIGINT and SIGTERM. Results go to stdout,
everything else to stderr. Heavy imports wait until a command needs them.
"""

import argparse
import gc
import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from yawid import __version__
from yawid.cli.completion import add_completion
from yawid.cli.finished_run import add_finished_run
from yawid.cli.fleet import add_fleet
from yawid.cli.live import add_live
from yawid.cli.options import (
    OneLineParser,
    add_estimator_options,
    add_format,
    add_outputs,
    add_signing,
    auto_orders,
    config_of,
    outputs_of,
    read_options_of,
    settings_of,
)
from yawid.cli.paper import add_commands
from yawid.cli.regress import add_regress
from yawid.cli.standard_streams import bring_out, make_ready, mute, show
from yawid.cli.trend import add_trend
from yawid.cli.warm import add_warm
from yawid.errors import ConfigError, SinkError, YawidError
from yawid.runs.stop import Interrupted, StopFlag

if TYPE_CHECKING:
    from yawid.results.run_summary import Origin, RunSummary

_Page = TypeVar("_Page", bound="Origin")
INTERRUPTED = 130
GARBAGE_AFTER = 50_000
"""Allocations until garbage is searched for: what is imported stays, and by Python's own 700 a
short replay searches it a hundred times, for a thirtieth of its CPU."""


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="yawid", description="How does this aircraft's yaw answer its rudder, right now?"
    )
    parser.add_argument("--version", action="version", version=f"yawid {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    replay = commands.add_parser("replay", help="estimate from recorded flights")
    kinds = "tlog, dataflash .BIN, PX4 .ulg (extra ulog) or the MCAP of a finished run"
    replay.add_argument("logs", nargs="+", metavar="LOG", type=Path, help=kinds)
    add_format(replay)
    add_outputs(replay)
    replay.set_defaults(run=_replay)
    add_live(commands)
    recorded = "tlog, dataflash .BIN or PX4 .ulg (extra ulog)"
    for name, run, what in (
        ("inspect", _inspect, "say what a log can answer, and how to ask"),
        ("orders", _orders, "compare orders and delays on a log"),
    ):
        command = commands.add_parser(name, help=what)
        command.add_argument("log", metavar="LOG", type=Path, help=recorded)
        command.add_argument("--json", action="store_true", help="print one JSON object")
        add_format(command)
        add_signing(command)
        add_estimator_options(command)
        command.set_defaults(run=run)
    add_commands(commands)
    add_finished_run(commands)
    add_regress(commands)
    add_fleet(commands)
    add_trend(commands)
    add_warm(commands)
    add_completion(commands, parser)
    return parser


def _replay(arguments: argparse.Namespace) -> int:
    from yawid.runs.outputs import output_names
    from yawid.runs.replay import replay
    from yawid.sinks.mcap.chunks import is_mcap

    automatic, config = auto_orders(arguments), config_of(arguments)
    _compile_behind()
    read_options = read_options_of(arguments)
    codes: list[int] = []
    unreached: list[Path] = []
    with StopFlag().installed() as stop:
        for log, name in zip(arguments.logs, output_names(arguments.logs), strict=True):
            if stop.is_set:
                unreached.append(log)
                continue
            outputs = outputs_of(arguments, name)
            run = partial(replay, log, config, outputs, stop, read_options)
            if is_mcap(log):
                from yawid.runs.replay_mcap import replay_run

                run = partial(replay_run, log, settings_of(arguments), outputs, stop)
            try:
                run = partial(run, automatic=automatic)
                codes.append(_told(run, arguments.json, _print_summary))
            except Interrupted:
                unreached.append(log)
    if unreached:
        _say(f"{stop.name}: not reached: {', '.join(map(str, unreached))}")
    if unreached or (stop.is_set and INTERRUPTED in codes):
        return stop.exit_code  # of SIGTERM another than the verdict's
    return max(codes, default=0)


def _print_summary(summary: "RunSummary", stream: TextIO) -> None:
    from yawid.sinks.terminal.summary_table import print_summary

    print_summary(summary, stream)


def _compile_behind() -> None:
    """Have a first run followed by compiled ones, where somebody is there to start them."""
    from yawid.estimation.machine.runner import RUNNER

    if sys.stderr.isatty() and RUNNER.compile_behind():
        _say("the first run: the estimators are being compiled beside it, once per installation")


def _orders(arguments: argparse.Namespace) -> int:
    from yawid.runs.choose_orders import orders_report
    from yawid.sinks.terminal.summary_table import print_orders

    if arguments.orders is not None:
        raise ConfigError("--orders: yawid orders compares them all; leave it out")
    report = orders_report(arguments.log, config_of(arguments), read_options_of(arguments))
    if arguments.json:
        print(json.dumps(report), flush=True)
    else:
        show(print_orders, report)
    return 0


def _inspect(arguments: argparse.Namespace) -> int:
    from yawid.runs.inspect_log import inspect
    from yawid.sinks.terminal.inspection import print_inspection

    run = partial(inspect, arguments.log, config_of(arguments), read_options_of(arguments))
    return _told(run, arguments.json, print_inspection)


def _told(
    run: Callable[[], tuple[_Page, Any]],
    as_json: bool,
    page: Callable[[_Page, TextIO], None],
) -> int:
    """Do one run and print what came of it, for people as a page; return its code."""
    try:
        summary, verdict = run()
    except YawidError as error:
        return _explained(error)
    if as_json:
        print(json.dumps(summary.to_json()), flush=True)
    else:
        show(page, summary)
    code: int = verdict.exit_code
    return code


def _say(text: str) -> None:
    try:
        print(f"yawid: {text}", file=sys.stderr, flush=True)
    except OSError:
        mute(sys.stderr)


def _explained(error: YawidError) -> int:
    _say(" ".join(str(error).split()))
    return error.exit_code


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    gc.set_threshold(GARBAGE_AFTER)
    try:
        make_ready()
        with StopFlag(raises=True).installed():
            return _run(argv)
    except YawidError as error:
        return _explained(error)
    except Interrupted as stopped:
        _say("interrupted: there is nothing of it to keep")
        return stopped.exit_code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader of our stdout has gone; nothing more can be said there.
        mute(sys.stdout)
        return 6
    except OSError as error:
        # Whoever opens a file says himself what is wrong with it.
        mute(sys.stdout)
        return _explained(SinkError(f"{error.filename or 'stdout'}: {error.strerror or error}"))


def _run(argv: Sequence[str] | None) -> int:
    try:
        arguments = _parser().parse_args(argv)
        code: int = arguments.run(arguments)
    finally:
        bring_out()
    return code
