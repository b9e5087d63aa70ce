"""The entry of the command line: it runs a command and turns errors into one line and a code.

Exit codes: 0 good, 2 usage or configuration, 3 no vehicle, rudder or yaw, 4 rate too low for an
answer, 5 not excited or not identifiable, 6 input or output failed, 7 something changed (trend,
diff), 70 something unforeseen, 130 and 143 interrupted by SIGINT and SIGTERM.
Results go to stdout, everything else to stderr. Large modules are imported only when needed.
"""

import argparse
import gc
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Final

from yawid.cli.standard_streams import bring_out, make_ready
from yawid.errors import (
    UNFORESEEN,
    ConfigError,
    SinkError,
    YawidError,
    did_you_mean,
    without_viewer,
)
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.door import DEBUG, mute, print_text, say, show_traceback
from yawid.version import __version__

if TYPE_CHECKING:
    from yawid.cli.options import Command

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


GROUPS: Final[dict[str, tuple[str, dict[str, str]]]] = {
    "flight": ("a flight", {
        "replay": "estimate from recorded flights",
        "live": "estimate from a live link, passively",
        "inspect": "say what a log can answer, and by which command",
        "orders": "compare orders and delays on a log",
    }),
    "finished_run": ("a finished run", {
        "view": "show a finished run in Rerun",
        "report": "write a report of a finished run: one HTML file",
        "damper": "say which gain of the yaw damper gives which damping",
        "export": "write samples, manoeuvres, modes or a model for others",
    }),
    "fleet": ("many flights", {
        "fleet": "replay thousands of logs into one data set",
        "trend": "what changed over a fleet's flights",
        "diff": "what changed between runs or data sets",
        "serve": "a page in the browser to drop logs on, of this machine alone",
    }),
    "paper": ("the paper's plants and step responses", {
        "simulate": "fly a reference plant of the paper to a file",
        "step": "fit the paper's models to a step response (eq. 4-16, 23)",
    }),
    "program": ("the program itself", {
        "explain": "explain a reason, option, quantity, exit code or term",
        "schema": "print the JSON Schema of what --json prints",
        "completion": "print what a shell needs to complete yawid's options",
    }),
}  # fmt: skip
"""By module, the commands in it: what the user has for them, and what each does."""
COMMANDS: Final = {
    name: (module, rows[name]) for module, (_, rows) in GROUPS.items() for name in rows
}
"""The module and the words of each command; a module is loaded when one of its commands is."""
REPLACED_BY: Final = {
    "fly": "yawid replay LOG --report answers a log and opens the page",
    "regress": "pytest tests/test_replay_logs.py checks cases; yawid diff A B compares two runs",
    "recover": "yawid replay reads what is left of a .tlog.part, .mcap.part or damaged MCAP",
}
"""What does the work of a command that is gone, where no other has a name like it."""


def command_of(name: str, *, is_short: bool = False) -> "Command":
    """Return the parser of a command; the others' options are not made."""
    from yawid.cli.options import Command

    module, what = COMMANDS[name]
    declared = getattr(import_module(f"yawid.cli.{module}"), name)
    command = Command(name, what, declared, is_short=is_short)
    command.set_defaults(every=every)
    return command


def every() -> "dict[str, Command]":
    """Return the parser of each command."""
    return {name: command_of(name) for name in COMMANDS}


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """Return the arguments of a command line; ``run`` of them does what it asks for.

    Raises:
        ConfigError: there is no such command, or a settings file is wrong.
        SystemExit: a word of the command is wrong.
    """
    name = words[0] if words else ""
    if name in COMMANDS:
        from yawid.cli.options import read_words

        return read_words(command_of(name), words[1:], every)
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


def page_of(words: Sequence[str]) -> str | None:
    """Return the page of help, or the version, that a command line asks for, if it does."""
    asked = {"-h", "--help", "--help-all"} & {*words}
    if asked and words[0] in COMMANDS:
        return command_of(words[0], is_short="--help-all" not in asked).help()
    if asked & {*words[:1]}:
        return overview()
    return f"yawid {__version__}\n" if words[:1] == ["--version"] else None


def overview() -> str:
    """Return the page of help that lists the commands in groups."""
    lines = ["usage: yawid COMMAND ...", "", QUESTION]
    for title, rows in GROUPS.values():
        lines += ["", f"{title}:", *(f"    {name:<12}{what}" for name, what in rows.items())]
    return "\n".join([*lines, "", EXAMPLES])


def code_of(act: Callable[[], int]) -> int:
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
            return code_of(partial(_run, argv))
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
        words = sys.argv[1:] if argv is None else argv
        if (page := page_of(words)) is not None:
            print_text(page)
            return 0
        arguments = parsed(words)
        import logging  # help needs nothing of it

        # Only yawid writes lines to stderr: matplotlib logs that it made a folder for its cache.
        logging.getLogger("matplotlib").setLevel(logging.ERROR)
        code: int = arguments.run(arguments)
    finally:
        bring_out()
    return code
