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
from typing import TYPE_CHECKING, Final, TextIO, TypeVar

from yawid.cli.damper import add_damper
from yawid.cli.explain import add_explain
from yawid.cli.finished_run import add_export, add_report, add_view
from yawid.cli.fleet import add_fleet
from yawid.cli.live import add_live
from yawid.cli.options import (
    Command,
    add_outputs,
    add_run_options,
    outputs_of,
    read_options_of,
    read_words,
    settings_of,
)
from yawid.cli.paper import add_simulate, add_step
from yawid.cli.program import add_completion, add_schema
from yawid.cli.standard_streams import bring_out, hush, make_ready
from yawid.cli.trend import add_diff, add_trend
from yawid.errors import (
    UNFORESEEN,
    ConfigError,
    SinkError,
    UnwrittenError,
    YawidError,
    did_you_mean,
    without_viewer,
)
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.door import DEBUG, mute, print_answer, print_line, print_text, say, show_traceback
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
QUESTION = "How does this aircraft's yaw answer its rudder, right now?"
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


def add_replay(command: Command) -> None:
    """Give the command its arguments and options."""
    command.shape(
        "LOG...",
        "yawid replay flight.tlog --report\nyawid replay flight.tlog --rerun save\n"
        "yawid replay day/*.BIN --out answers --json > answers.jsonl",
        _replay,
    )
    kinds = f"{recorded()}, or {RUN.said}"
    command.option("logs", nargs="+", metavar="LOG", type=place_of, help=kinds)
    add_outputs(command)
    text = "write a report next to each answer; on a terminal, open one log's in the browser"
    command.flag("--report", text, group="what is written")
    add_run_options(command)


def add_inspect(command: Command) -> None:
    """Give the command its arguments and options."""
    command.shape(
        "LOG",
        "yawid inspect flight.tlog\nyawid inspect flight.tlog --card | lp\n"
        "yawid inspect flight.BIN --json --from 300 --to 420",
        _inspect,
    )
    command.option("log", metavar="LOG", type=Path, help=recorded())
    command.flag("--card", "print what to fly next instead: a card on one page")
    command.flag("--json", "print one JSON object")
    add_run_options(command)


def add_orders(command: Command) -> None:
    """Give the command its arguments and options: those of the estimators mean nothing here."""
    from yawid.config.run import STREAM

    examples = "yawid orders flight.tlog\nyawid orders flight.tlog --from 300 --to 420"
    command.shape("LOG", examples, _orders)
    command.option("log", metavar="LOG", type=Path, help=recorded())
    command.flag("--json", "print one JSON object")
    add_run_options(command, without={STREAM})


GROUPS: Final[dict[str, dict[str, tuple[str, Callable[[Command], None]]]]] = {
    "a flight": {
        "replay": ("estimate from recorded flights", add_replay),
        "live": ("estimate from a live link, passively", add_live),
        "inspect": ("say what a log can answer, and by which command", add_inspect),
        "orders": ("compare orders and delays on a log", add_orders),
    },
    "a finished run": {
        "view": ("show a finished run in Rerun", add_view),
        "report": ("write a report of a finished run: one HTML file", add_report),
        "damper": ("say which gain of the yaw damper gives which damping", add_damper),
        "export": ("write samples, manoeuvres, modes or a model for others", add_export),
    },
    "many flights": {
        "fleet": ("replay thousands of logs into one data set", add_fleet),
        "trend": ("what changed over a fleet's flights", add_trend),
        "diff": ("what changed between runs or data sets", add_diff),
    },
    "the paper's plants and step responses": {
        "simulate": ("fly a reference plant of the paper to a file", add_simulate),
        "step": ("fit the paper's models to a step response (eq. 4-16, 23)", add_step),
    },
    "the program itself": {
        "explain": ("explain a reason, option, quantity, exit code or term", add_explain),
        "schema": ("print the JSON Schema of what --json prints", add_schema),
        "completion": ("print what a shell needs to complete yawid's options", add_completion),
    },
}
"""The commands by what the user has: what each does, and what gives it its options."""
COMMANDS: Final = {name: rows[name] for rows in GROUPS.values() for name in rows}
REPLACED_BY: Final = {
    "fly": "yawid replay LOG --report answers a log and opens the page",
    "regress": "pytest tests/test_replay_logs.py checks cases; yawid diff A B compares two runs",
    "recover": "yawid replay reads what is left of a .tlog.part, .mcap.part or damaged MCAP",
}
"""What does the work of a command that is gone, where no other has a name like it."""


def command_of(name: str, *, is_short: bool = False) -> Command:
    """Return the parser of a command; the others' options are not made."""
    what, add = COMMANDS[name]
    command = Command(name, what, is_short=is_short)
    command.set_defaults(every=every)
    add(command)
    return command


def every() -> dict[str, Command]:
    """Return the parser of each command."""
    return {name: command_of(name) for name in COMMANDS}


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """Return the arguments of a command line; ``run`` of them does what it asks for.

    Raises:
        ConfigError: there is no such command, or a settings file is wrong.
        SystemExit: a word of the command is wrong.
    """
    name = words[0] if words else ""
    if name in COMMANDS and (asked := {"-h", "--help", "--help-all"} & {*words}):
        page = command_of(name, is_short="--help-all" not in asked).help()
        return argparse.Namespace(run=partial(_print, page))
    if name in COMMANDS:
        return read_words(command_of(name), words[1:], every)
    if name in ("-h", "--help", "--help-all"):
        return argparse.Namespace(run=partial(_print, overview()))
    if name == "--version":
        return argparse.Namespace(run=partial(_print, f"yawid {__version__}\n"))
    first = name.partition("=")[0]
    near = did_you_mean(name, [*COMMANDS, "--help", "--version"])
    if not name:
        said = "a COMMAND is needed"
    elif name in REPLACED_BY:
        said = f"there is no command {name!r}: {REPLACED_BY[name]}"
    elif any(first in command.options for command in every().values()):
        said = f"there is no option {first}: it stands after the command, yawid COMMAND {first}"
    else:
        what = f"option {name}" if name.startswith("-") else f"command {name!r}"
        said = f"there is no {what}{near}"
    raise ConfigError(f"{said}{'' if said[-1] == '?' else ';'} yawid --help lists the commands")


def _print(text: str, _: argparse.Namespace) -> int:
    print_text(text)
    return 0


def overview() -> str:
    """Return the page of help that lists the commands in groups."""
    lines = ["usage: yawid COMMAND ...", "", QUESTION]
    for title, rows in GROUPS.items():
        lines += ["", f"{title}:", *(f"    {name:<12}{what}" for name, (what, _) in rows.items())]
    return "\n".join([*lines, "", EXAMPLES])


def _replay(arguments: argparse.Namespace) -> int:
    from yawid.runs.outputs import output_names
    from yawid.runs.replay import replay

    settings = settings_of(arguments)
    _compile_behind()
    read_options = read_options_of(arguments)
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
                codes.append(_run_and_print(run, arguments.json, _print_summary, then))
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


def _print_summary(summary: "RunSummary", stream: TextIO) -> None:
    from yawid.sinks.run_page import print_summary  # --json needs nothing of it

    print_summary(summary, stream)


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
    from yawid.sinks.terminal.inspection import print_card, print_inspection

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

    def act() -> int:
        try:
            summary = run()
        except UnwrittenError as error:
            print_answer(error.summary, page, as_json=as_json)
            raise
        print_answer(summary, page, as_json=as_json)
        if then is not None:
            then(summary)
        return summary.exit_code

    return _code_of(act)


def _code_of(act: Callable[[], int]) -> int:
    """Return the exit code of a command, or of one of its runs: errors are a line each."""
    try:
        return act()
    except YawidError as error:
        return _explained(error)
    except (Interrupted, OSError):
        raise
    except Exception as error:  # a fault of yawid: further logs are still run
        return _unforeseen(error)


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
        with StopFlag(raises=True).installed():
            return _code_of(partial(_run, argv))
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


def _run(argv: Sequence[str] | None) -> int:
    make_ready()
    try:
        arguments = parsed(sys.argv[1:] if argv is None else argv)
        code: int = arguments.run(arguments)
    finally:
        bring_out()
    return code
