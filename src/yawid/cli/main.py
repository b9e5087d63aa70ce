"""The entry of the command line: it runs a command and turns errors into one line and a code.

Exit codes: 0 good, 2 usage or configuration, 3 no vehicle, rudder or yaw, 4 rate too low for an
answer, 5 not excited or not identifiable, 6 input or output failed, 7 something changed (trend,
diff), 70 something unforeseen, 130 and 143 interrupted by SIGINT and SIGTERM.
Results go to stdout, everything else to stderr. Large modules are imported only when needed.
"""

import argparse
import gc
import sys
import webbrowser
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, TypeVar

from yawid.cli.config_file import parsed
from yawid.cli.damper import add_damper
from yawid.cli.explain import add_explain
from yawid.cli.finished_run import add_finished_run
from yawid.cli.fleet import add_fleet
from yawid.cli.live import add_live
from yawid.cli.options import (
    Commands,
    HelpPage,
    OneLineParser,
    add_command,
    add_estimator_options,
    add_log_options,
    add_outputs,
    add_signing,
    outputs_of,
    read_options_of,
    settings_of,
)
from yawid.cli.paper import add_commands
from yawid.cli.program import add_completion, add_schema
from yawid.cli.standard_streams import bring_out, hush, make_ready
from yawid.cli.trend import add_trend
from yawid.errors import UNFORESEEN, SinkError, UnwrittenError, YawidError, without_viewer
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.door import DEBUG, mute, print_answer, print_line, say, show_traceback
from yawid.sources.formats import RUN, recorded
from yawid.system.stores import Place, place_of
from yawid.version import __version__

if TYPE_CHECKING:
    from yawid.answers.inspection import Inspection
    from yawid.answers.run_summary import RunSummary

_Page = TypeVar("_Page", "RunSummary", "Inspection")
INTERRUPTED = 130
MOST_SAID = 300
"""The most characters of an unforeseen error's text that are printed: it may hold an array."""
OVERVIEW = {
    "a flight": ("replay", "live", "inspect", "orders"),
    "a finished run": ("view", "report", "damper", "export"),
    "many flights": ("fleet", "trend", "diff"),
    "the paper's plants and step responses": ("simulate", "step"),
    "the program itself": ("explain", "schema", "completion"),
}
"""The commands by what the user has, as ``yawid --help`` lists them."""
TRIED = {"--orders", "--method", "--also", "--engine", "--memory", "--forgetting", "--servo-tau"}
TRIED |= {"--manoeuvres"}
"""Options of an estimator that have no meaning for the comparison of orders."""
EXAMPLES = """\
examples:
  yawid inspect flight.tlog     what a log can answer, and the command to run
  yawid replay flight.tlog      wn and zeta of each manoeuvre and of the flight
  yawid replay flight.tlog --report    the same, and a page that is opened
  yawid live udpin:127.0.0.1:14560
  yawid simulate yaw --input step --out - | yawid step -

yawid COMMAND --help lists a command's options; yawid completion bash|zsh lets
the Tab key complete them. Exit codes: 0 good, 2 usage,
3 no vehicle, rudder or yaw, 4 rate too low, 5 not excited or not identifiable,
6 input or output failed, 7 something changed, 70 a fault of yawid itself
(YAWID_DEBUG=1 shows where).
"""
GARBAGE_AFTER = 50_000
"""The number of allocations after which Python looks for garbage. With its default of 700 a short
replay would search the imported modules a hundred times, which takes a thirtieth of its CPU."""


class _Overview(HelpPage):
    """The page of help that lists the commands in groups."""

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        lines = {each.dest: super(_Overview, self)._format_action(each)
                 for each in self._iter_indented_subactions(action)}  # fmt: skip
        return "\n".join(
            f"{title}:\n" + "".join(lines.get(name, "") for name in names)
            for title, names in OVERVIEW.items()
        )


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="yawid",
        usage="yawid COMMAND ...",
        description="How does this aircraft's yaw answer its rudder, right now?",
        epilog=EXAMPLES,
        formatter_class=_Overview,
    )
    parser.add_argument("--version", action="version", version=f"yawid {__version__}")
    commands = parser.add_subparsers(
        required=True, metavar="COMMAND", title=argparse.SUPPRESS, prog="yawid"
    )
    _add_replay(commands)
    add_live(commands)
    _add_looks(commands)
    add_commands(commands)
    add_finished_run(commands)
    add_damper(commands)
    add_fleet(commands)
    add_trend(commands)
    add_explain(commands, parser)
    add_schema(commands)
    add_completion(commands, parser)
    return parser


def _add_replay(commands: Commands) -> None:
    examples = """\
yawid replay flight.tlog --report
yawid replay flight.tlog --rerun save
yawid replay day/*.BIN --out answers --json > answers.jsonl"""
    replay = add_command(commands, "replay", "LOG...", "estimate from recorded flights", examples)
    kinds = f"{recorded()}, or {RUN.said}"
    replay.add_argument("logs", nargs="+", metavar="LOG", type=place_of, help=kinds)
    text = "write a report next to each answer; on a terminal, open one log's in the browser"
    replay.add_argument("--report", action="store_true", help=text)
    add_outputs(replay)
    add_log_options(replay)
    replay.set_defaults(run=_replay)


def _add_looks(commands: Commands) -> None:
    """Add the commands that read a log and write no run: inspect and orders."""
    inspect = add_command(
        commands, "inspect", "LOG", "say what a log can answer, and by which command",
        "yawid inspect flight.tlog\nyawid inspect flight.tlog --card | lp\n"
        "yawid inspect flight.BIN --json --from 300 --to 420",
    )  # fmt: skip
    inspect.add_argument(
        "--card", action="store_true", help="print what to fly next instead: a card on one page"
    )
    orders = add_command(
        commands, "orders", "LOG", "compare orders and delays on a log",
        "yawid orders flight.tlog\nyawid orders flight.tlog --from 300 --to 420",
    )  # fmt: skip
    for command, run, without in ((inspect, _inspect, {"--engine"}), (orders, _orders, TRIED)):
        command.add_argument("log", metavar="LOG", type=Path, help=recorded())
        command.add_argument("--json", action="store_true", help="print one JSON object")
        add_signing(command)
        add_estimator_options(command, without)
        add_log_options(command)
        command.set_defaults(run=run)


def _replay(arguments: argparse.Namespace) -> int:
    from yawid.runs.outputs import output_names
    from yawid.runs.replay import replay

    settings = settings_of(arguments)
    _compile_behind()
    read_options = read_options_of(arguments)
    page = partial(_print_summary, verbose=arguments.verbose)
    then = partial(_write_report, arguments) if arguments.report else None
    codes: list[int] = []
    unreached: list[Place] = []
    with StopFlag().installed() as stop:
        for log, name in zip(arguments.logs, output_names(arguments.logs), strict=True):
            if stop.is_set:
                unreached.append(log)
                continue
            outputs = outputs_of(arguments, name)
            run = partial(replay, log, settings, outputs, stop, read_options)
            try:
                codes.append(_run_and_print(run, arguments.json, page, then))
            except Interrupted:
                unreached.append(log)
    if unreached:
        say(f"{stop.name}: not reached: {', '.join(map(str, unreached))}")
    if unreached or (stop.is_set and INTERRUPTED in codes):
        return stop.exit_code  # the verdict's code is that of SIGINT, even after SIGTERM
    return max(codes, default=0)


def _write_report(arguments: argparse.Namespace, summary: "RunSummary") -> None:
    """Write the report of a run; open it in the browser if somebody waits for one log's."""
    from yawid.report.write import write_report
    from yawid.system.processes import has_desktop

    hush("matplotlib")  # it makes a folder for its cache where there is none, and logs that
    page = write_report(Path((summary.files or {})["mcap"]), force=arguments.force)
    (say if arguments.json else print_line)(f"report: {page}")
    if len(arguments.logs) == 1 and sys.stdout.isatty() and has_desktop():
        webbrowser.open(page.as_uri())


def _print_summary(summary: "RunSummary", stream: TextIO, *, verbose: bool) -> None:
    from yawid.sinks.run_page import print_summary

    print_summary(summary, stream, verbose=verbose)


def _compile_behind() -> None:
    """Compile the estimators in another process during the first run, if a person starts it."""
    from yawid.estimation.machine.kept import passed_by
    from yawid.estimation.machine.runner import RUNNER

    if sys.stderr.isatty() and RUNNER.compile_behind():
        say("first run: the estimators are being compiled in the background, once per installation")
        if why := passed_by():
            say(why)


def _orders(arguments: argparse.Namespace) -> int:
    from yawid.runs.choose_orders import orders_report
    from yawid.sinks.run_page import print_orders

    settings, read_options = settings_of(arguments), read_options_of(arguments)
    report = orders_report(arguments.log, settings, read_options)
    print_answer(report, print_orders, as_json=arguments.json)
    return report.verdict.exit_code


def _inspect(arguments: argparse.Namespace) -> int:
    from yawid.runs.inspect_log import inspect
    from yawid.sinks.terminal.card import print_card
    from yawid.sinks.terminal.inspection import print_inspection

    with_card, settings = arguments.card, settings_of(arguments)
    run = partial(inspect, arguments.log, settings, read_options_of(arguments), with_card=with_card)
    return _run_and_print(run, arguments.json, print_card if with_card else print_inspection)


def _run_and_print(
    run: Callable[[], _Page],
    as_json: bool,
    page: Callable[[_Page, TextIO], None],
    then: Callable[[_Page], None] | None = None,
) -> int:
    """Do one run, print its result, and do what comes ``then``; return the run's exit code."""
    try:
        summary = run()
    except UnwrittenError as error:
        print_answer(error.summary, page, as_json=as_json)
        return _explained(error)
    except YawidError as error:
        return _explained(error)
    except (Interrupted, OSError):
        raise
    except Exception as error:  # the logs that follow are still run
        return _unforeseen(error)
    print_answer(summary, page, as_json=as_json)
    if then is not None:
        then(summary)
    return summary.exit_code


def _explained(error: YawidError) -> int:
    say(" ".join(str(error).split()))
    return error.exit_code


def _unforeseen(error: Exception) -> int:
    """Report in one line that a library or yawid itself failed; ``DEBUG`` shows the traceback."""
    if (needed := without_viewer(error)) is not None:
        return _explained(SinkError(needed))
    show_traceback(error)
    what = " ".join(f"{type(error).__name__}: {error}".split())[:MOST_SAID]
    say(f"unforeseen, a fault of yawid: {what}; {DEBUG}=1 shows where: please report it")
    return UNFORESEEN


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
        say("interrupted: there was nothing to save")
        return stopped.exit_code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader of our stdout has closed it: nothing more can be printed there.
        mute(sys.stdout)
        return 6
    except OSError as error:
        # Code that opens a file reports its own errors; this one is of stdout, or unforeseen.
        mute(sys.stdout)
        return _explained(SinkError(f"{error.filename or 'stdout'}: {error.strerror or error}"))
    except Exception as error:  # all other errors are faults of yawid
        return _unforeseen(error)


def _run(argv: Sequence[str] | None) -> int:
    try:
        arguments = parsed(_parser(), argv)
        code: int = arguments.run(arguments)
    finally:
        bring_out()
    return code
