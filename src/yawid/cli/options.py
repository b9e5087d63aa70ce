"""The options that several commands share, and the objects that are made from them."""

import argparse
import sys
import textwrap
from collections.abc import Callable, Container, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

from yawid.config.names import ELS, RECURSIVE, RML
from yawid.errors import ConfigError, did_you_mean
from yawid.sinks.door import plain, print_text

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

    from yawid.runs.outputs import Outputs
    from yawid.sources.open_log import ReadOptions

DEFAULT_OUT = "yawid-out"
REPLACED_BY = {
    "fly": "yawid replay LOG --report answers a log and opens the page",
    "regress": "pytest tests/test_replay_logs.py checks cases; yawid diff A B compares two runs",
    "recover": "yawid replay reads what is left of a .tlog.part, .mcap.part or damaged MCAP",
}
"""What does the work of a command that is gone, where no other has a name like it."""


class HelpPage(argparse.RawDescriptionHelpFormatter):
    """A page of help in groups, with examples at its end."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=32)

    def add_argument(self, action: argparse.Action) -> None:
        """Add an option to the page, except --help, which the reader has found."""
        if not isinstance(action, argparse._HelpAction):
            super().add_argument(action)


def _path(text: str) -> Path:
    """Return a text as a path; a URL is refused: Path would make ``s3://x`` a folder ``s3:``."""
    if "://" in text:
        raise argparse.ArgumentTypeError(
            f"{text!r} is a URL, but a path on this machine is needed: copy the file to or from "
            "the store with the store's own tool (replay, fleet and diff read URLs)"
        )
    return Path(text)


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports an error in one line, with the command that lists the options."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.register("type", Path, _path)  # for every command: subparsers have this class too

    def _print_message(self, message: str, file: "SupportsWrite[str] | None" = None) -> None:
        """Write help; argparse itself would ignore that stdout is full or closed."""
        if file is sys.stdout:
            print_text(message)
        else:
            super()._print_message(message, file)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the value of an argument; where a number is needed, say so."""
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            if action.type not in (float, int):
                raise
            needed = "a number" if action.type is float else "a whole number"
            said = f"must be {needed}, got {arg_string!r}"
            raise argparse.ArgumentError(action, said) from error

    def error(self, message: str) -> NoReturn:
        """Write the line to stderr and exit with 2."""
        lists = "commands" if self.prog == "yawid" else "options"
        end = "" if message.endswith("?") else ";"
        self.exit(2, f"yawid: {plain(message)}{end} {self.prog} --help lists the {lists}\n")

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Refuse a value that is not a choice, with the one it is most like."""
        if action.choices is not None and value not in action.choices:
            names = [str(each) for each in action.choices]
            one_of = f"must be one of {', '.join(names)}, got {value!r}"
            is_command = isinstance(action, argparse._SubParsersAction)
            others = ("--help", "--version") if is_command else ()
            near = did_you_mean(str(value), [*names, *others])
            said = f"there is no command {value!r}" if is_command else one_of
            if is_command and value in REPLACED_BY:
                near = f": {REPLACED_BY[str(value)]}"
            raise argparse.ArgumentError(None if is_command else action, said + near)


def _sysid(text: str) -> int | str:
    try:
        return text if text == "all" else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be 1 to 255 (live: or all), got {text!r}") from None


Commands: TypeAlias = "argparse._SubParsersAction[OneLineParser]"
"""The object to which commands are added: argparse has no public name for it."""
Option = tuple[str, Callable[[str], Any], str, str]
"""An option's name, the function that reads its text, the name of its value, and its help."""
SAMPLES: tuple[Option, ...] = (
    ("--from", float, "S", "first second since boot (default: the log's first)"),
    ("--to", float, "S", "last second since boot (default: the log's last)"),
    ("--airborne", str, "auto|all",
     "all: take every sample as flown; auto: hold those on the ground (default: auto)"),
    ("--boot", int, "N", "only the vehicle's Nth boot in the log, from 1 (default: all)"),
)  # fmt: skip
CHANNELS: tuple[Option, ...] = (
    ("--rudder", str, "CHANNEL", "auto, servo:N, vtail:L,R, control:K or rc:N (default: auto)"),
    ("--aileron", str, "CHANNEL", "the same for the aileron, without vtail (default: auto)"),
    ("--rudder-sign", str, "nose-right|nose-left",
     "where positive rudder turns the nose (default: nose-right)"),
    ("--rudder-max-deg", float, "DEG",
     "rudder at full travel in deg, for gains per rad (default: per half of the travel)"),
    ("--sysid", _sysid, "N",
     "system id of the vehicle, 1 to 255; live: or all (default: the first fixed wing)"),
)  # fmt: skip
MODEL: tuple[Option, ...] = (
    ("--orders", str, "NA,NB,NC,NK",
     "orders, nb and nk for every input (default: 3,3,2,1)"),
    ("--method", str, "|".join(RECURSIVE), f"the stream's estimator (default: {ELS})"),
    ("--also", str, "METHOD|none", f"a second one next to it (default: {RML})"),
    ("--engine", str, "numba|filterpy", "what computes the recursion (default: numba)"),
    ("--memory", float, "SECONDS", "forget with a memory of so many seconds (default: 60)"),
    ("--forgetting", float, "LAMBDA",
     "forgetting factor instead of a memory; 1 forgets nothing (default: from it)"),
    ("--servo-tau", float, "SECONDS", "the servo's lag in s (default: the fastest real pole)"),
    ("--manoeuvres", str, "auto|off", "find manoeuvres, answer each of them (default: auto)"),
    ("--lateral", str, "auto|off",
     "fit the bare airframe to all of the lateral motion (default: off)"),
    ("--servo-lag", float, "SECONDS", "lag of both servos, for --lateral auto (default: unknown)"),
    ("--ordinary", str, "auto|only|off",
     "answer flight without a manoeuvre, too; only: that is the verdict (default: off)"),
    ("--inputs", str, "rudder[,aileron]", "inputs of the model (default: rudder)"),
    ("--output", str, "yaw-rate|yaw", "the model's output (default: yaw-rate)"),
    ("--rate", float, "HZ",
     "rate of the grid (default: 20, or the slower channel's if that is lower)"),
    ("--band", str, "LO,HI", "band-pass rudder and yaw rate alike, in Hz (default: off)"),
    ("--turn", str, "keep|remove", "subtract the turn rate that the bank implies (default: keep)"),
)  # fmt: skip
RECORD: tuple[Option, ...] = (
    ("--columns", str, "NAME=COLUMN,...",
     "names of columns: rudder=delta_r,r=Rate[deg/s] (default: t, rudder, r, ...)"),
    ("--units", str, "rad|deg", "unit of angles and rates that give none (default: none)"),
    ("--rudder-unit", str, "half-travel|rad|deg",
     "unit of a rudder that gives none (default: none)"),
    ("--rudder-is", str, "measured|commanded",
     "straight lines between rows, or held from row to row (default: measured in rad and deg)"),
    ("--least-stroke-deg", float, "DEG",
     "rudder stroke needed, in deg, where its travel is unknown (default: 1)"),
)  # fmt: skip
ALIASES = {"--manoeuvres": ("--maneuvers",)}
"""Other spellings of options."""
ESTIMATOR_OPTIONS = (*SAMPLES, *CHANNELS, *MODEL)
TITLES = {SAMPLES: "which samples", CHANNELS: "the aircraft", MODEL: "the model"}


def add_command(
    commands: Commands, name: str, arguments: str, what: str, examples: str
) -> argparse.ArgumentParser:
    """Add a command: its ``arguments``, what it does in a line, and examples, one in each line."""
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        usage=" ".join(filter(None, ("yawid", name, arguments, "[options]"))),
        help=what,
        description=what[0].upper() + what[1:] + ".",
        epilog="examples:\n" + textwrap.indent(examples, "  "),
        formatter_class=HelpPage,
    )
    command.set_defaults(own_parser=command)
    return command


def add_outputs(parser: argparse.ArgumentParser, without: Container[str] = frozenset()) -> None:
    """Add the options of the estimator and of what a command writes, except those ``without``."""
    files = parser.add_argument_group("what is written")
    text = f"folder of the files (default: {DEFAULT_OUT})"
    files.add_argument("--out", type=Path, default=Path(DEFAULT_OUT), metavar="DIR", help=text)
    files.add_argument("--force", action="store_true", help="overwrite files that exist")
    if "--json" not in without:
        files.add_argument("--json", action="store_true", help="print one JSON object per log")
    text = "print the numbers of the stream at its end as well, next to the flight's answer"
    files.add_argument("--verbose", action="store_true", help=text)
    if "--rerun" not in without:
        text = "a Rerun recording, or a viewer: rerun+http://HOST:PORT/proxy (default: off)"
        files.add_argument("--rerun", default="off", metavar="off|save|spawn|URL", help=text)
    add_signing(parser)
    add_estimator_options(parser, without)


def add_signing(parser: argparse.ArgumentParser) -> None:
    """Add the option with the key by which frames must be signed."""
    text = "read only frames signed by this key (default: any)"
    parser.add_argument("--signing-key-file", type=Path, metavar="FILE", help=text)


def add_options(parser: argparse._ActionsContainer, options: Iterable[Option]) -> None:
    """Add options that have a value, none by default."""
    for name, kind, metavar, text in options:
        names = (name, *ALIASES.get(name, ()))
        parser.add_argument(*names, type=kind, metavar=metavar, help=text)


def add_estimator_options(
    parser: argparse.ArgumentParser, without: Container[str] = frozenset()
) -> None:
    """Add the options of the estimation and its channels in groups, except those ``without``."""
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="options from a TOML file, by their names"
    )
    parser.set_defaults(settings={})
    for options, title in TITLES.items():
        group = parser.add_argument_group(title)
        add_options(group, (each for each in options if each[0] not in without))


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the names and units of a record's columns."""
    add_options(parser.add_argument_group("the columns of CSV and Parquet"), RECORD)


def settings_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the checked settings from the TOML file and the options, which overrule the file.

    The file's settings are in ``arguments.settings``: :mod:`yawid.cli.config_file` puts them there.

    Raises:
        ConfigError: a setting is unknown or outside its limits, or some do not fit together.
    """
    from yawid.config.run import COMMAND_LINE, RunConfig, check_settings, overruled

    if getattr(arguments, "sysid", None) == "all":  # yawid live has taken it away before
        raise ConfigError(
            "--sysid all is for yawid live: give the number of one vehicle, or leave --sysid out"
        )
    given = check_settings(given_options(arguments), COMMAND_LINE)
    settings = overruled(arguments.settings, given)
    RunConfig(**settings)  # errors in it are reported once for the command, not for each log
    return settings


def given_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given options of the estimation and of records, by name without leading dashes."""
    return {
        name[2:]: value
        for name, *_ in (*ESTIMATOR_OPTIONS, *RECORD)
        if (value := getattr(arguments, name[2:].replace("-", "_"), None)) is not None
    }


def outputs_of(arguments: argparse.Namespace, name: str) -> "Outputs":
    """Return where the results are written, in files of this name.

    Raises:
        ConfigError: ``--rerun`` has a value that is not allowed.
    """
    from yawid.runs.outputs import Outputs

    rerun = getattr(arguments, "rerun", "off")
    if rerun not in ("off", "save", "spawn") and not rerun.startswith("rerun+http"):
        raise ConfigError(f"--rerun must be off, save, spawn or rerun+http://..., got {rerun!r}")
    record = not getattr(arguments, "no_record", False)
    return Outputs(arguments.out, name, rerun, arguments.force, record)


def read_options_of(arguments: argparse.Namespace) -> "ReadOptions":
    """Return how a log is read: with the key by which frames must be signed, if any."""
    from yawid.sources.open_log import ReadOptions

    return ReadOptions.asked(arguments.signing_key_file)
