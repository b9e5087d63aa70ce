"""A command of the command line: a function, whose parameters are its arguments and options.

An option of a run is declared once, on its field of :class:`yawid.config.run.RunConfig`: its words,
its group and its bounds. Here it becomes an option of the command line, too.
"""

import argparse
import inspect
import re
import textwrap
from collections.abc import Callable, Container, Mapping, Sequence
from functools import partial
from operator import getitem
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, NoReturn, get_args, get_origin

from yawid.config.fields import one_of, typed
from yawid.config.run import (
    AIRCRAFT,
    ANSWER,
    COLUMNS,
    SAMPLES,
    STREAM,
    RunConfig,
    option_name,
    settings_declared,
)
from yawid.config.settings import COMMAND_LINE, check_settings, overruled, read_toml
from yawid.errors import ConfigError, did_you_mean
from yawid.sinks.door import plain

if TYPE_CHECKING:
    from yawid.sources.open_log import ReadOptions

NEVER = {"--help", "--help-all", "--config"}
"""What no settings file has."""
ALL = "all"
"""The value of sysid that only ``yawid live`` reads, and not the configuration of a run."""
RUN_OPTIONS = {SAMPLES, AIRCRAFT, ANSWER, STREAM, COLUMNS}
"""The groups of a run's options."""
WRITTEN = "what is written"


class Declared(NamedTuple):
    """A command: the function that runs it and returns the exit code, its usage, its examples.

    ``groups`` are those of the run's options that it takes.
    """

    run: Callable[..., int]
    arguments: str
    examples: str
    groups: Container[str]


def command(
    arguments: str, examples: str, groups: Container[str] = ()
) -> Callable[[Callable[..., int]], Declared]:
    """Make a command of a function: see :class:`Declared`.

    Its parameters that have :func:`said` become arguments, those after ``*`` options. One without,
    ``arguments``, takes all that was parsed, for what the options of a run are made to.
    """
    return lambda run: Declared(run, arguments, examples, groups)


def said(shown: str, words: str, *names: str, **more: Any) -> tuple[Any, ...]:
    """Return what the help says of a parameter: the form of its value and its words.

    An option may have other ``names`` than the parameter's. ``more`` is that of argparse, the title
    of a ``group``, or that it is ``rare``.

    The kind of a parameter decides what a value may be: a list takes several, a bool none, a
    literal one of its texts, and a text or a number may have bounds. Where ``shown`` has suffixes
    the name of a file to be written has one of them.
    """
    return shown, words, names, more


Force = Annotated[bool, said("", "overwrite a file that exists")]
AsJson = Annotated[bool, said("", "print one JSON object", "--json")]


class Command(argparse.ArgumentParser):
    """The parser of one command; an error is one line, with the command that lists the options."""

    def __init__(self, name: str, what: str, declared: Declared, *, is_short: bool = False) -> None:
        """Make the parser of a command; of one that ``is_short`` help has the usual options."""
        super().__init__(
            prog=f"yawid {name}",
            usage=" ".join(filter(None, (f"yawid {name}", declared.arguments, "[options]"))),
            description=what[0].upper() + what[1:] + ".",
            epilog="examples:\n" + textwrap.indent(declared.examples, "  "),
            formatter_class=partial(argparse.RawDescriptionHelpFormatter, max_help_position=32),
            add_help=False,
        )
        self.options: dict[str, argparse.Action] = {}
        """Each option by each of its names."""
        self.arguments: list[argparse.Action] = []
        """The options and the arguments without a name."""
        self._groups: dict[str, Any] = {}
        self._is_short, self._rare = is_short, 0
        self.place = ""
        """Where the words stand that are read, if not on the command line."""
        for names in (("-h", "--help"), ("--help-all",)):
            self._add(
                *names, action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS
            )
        parameters = inspect.signature(declared.run).parameters
        for parameter in parameters.values():
            if get_origin(parameter.annotation) is Annotated:
                self._parameter(parameter)
        if declared.groups:
            self._run_options(declared.groups)
        self.set_defaults(
            run=lambda found: declared.run(
                **{each: getattr(found, each, found) for each in parameters}
            )
        )

    def _parameter(self, parameter: inspect.Parameter) -> None:
        """Add the argument or option of a command's parameter."""
        *bounds, (shown, words, names, more) = parameter.annotation.__metadata__
        of, default = parameter.annotation.__origin__, parameter.default
        is_option = parameter.kind is parameter.KEYWORD_ONLY
        kind = next((each for each in get_args(of) if each is not NoneType), of)
        if values := [each for each in get_args(of) + get_args(kind) if isinstance(each, str)]:
            kind, bounds = str, [one_of(*values)]
        shown = shown or "|".join(values) or parameter.name.upper()
        settings = {"help": words} | more
        if kind is Path:
            read = partial(path_of, ends=re.findall(r"\.\w+", shown) * is_option)
        else:
            read = partial(_typed, getitem(Annotated, (kind, *bounds)) if bounds else kind)
        if kind is bool:
            settings |= {"action": "store_true"}
        else:
            settings = {"type": read, "metavar": shown} | settings
        if default == ():
            settings |= {"action": "append", "default": []}
        elif default is not parameter.empty:
            settings |= {"default": default}
        if is_option:
            settings |= {"dest": parameter.name, "required": default is parameter.empty}
            names = names or (f"--{parameter.name.replace('_', '-')}",)
        self._add(*(names or [parameter.name]), **settings)

    def _run_options(self, groups: Container[str]) -> None:
        """Add the options of a run in these groups, and those of reading its log."""
        self.set_defaults(settings={})
        text = "options from a TOML file, by their names"
        self._add("--config", type=path_of, metavar="FILE", help=text)
        for field, of in settings_declared():
            if of.group in groups:
                names = [f"--{each}" for each in (option_name(field.name), *of.aliases)]
                settings: dict[str, Any] = {"metavar": of.shown, "help": of.words}
                settings |= {"dest": field.name, "group": of.group, "rare": not of.usual}
                self._add(*names, **settings)
        text = "read only frames signed by this key (default: any)"
        self._add("--signing-key-file", type=path_of, metavar="FILE", help=text, rare=True)

    def _add(self, *names: str, group: str = "", rare: bool = False, **settings: Any) -> None:
        if group and group not in self._groups:
            self._groups[group] = self.add_argument_group(group)
        if rare and self._is_short:
            self._rare, settings["help"] = self._rare + 1, argparse.SUPPRESS
        action: argparse.Action = self._groups.get(group, self).add_argument(*names, **settings)
        self.arguments.append(action)
        self.options |= dict.fromkeys(action.option_strings, action)

    def help(self) -> str:
        """Return the page of help."""
        more = f"\n\n{self.prog} --help-all shows {self._rare} more options.\n"
        return self.format_help().rstrip() + (more if self._rare else "\n")

    def error(self, message: str) -> NoReturn:
        """Write the line to stderr and exit with 2."""
        end = "" if message.endswith("?") else ";"
        self.exit(
            2, f"yawid: {plain(self.place + message)}{end} {self.prog} --help lists the options\n"
        )


def path_of(text: str, ends: Sequence[str] = ()) -> Path:
    """Return a text as a path; a URL is refused: Path would make ``s3://x`` a folder ``s3:``."""
    if "://" in text:
        raise argparse.ArgumentTypeError(
            f"{text!r} is a URL, but a path on this machine is needed: copy the file to or from "
            "the store with the store's own tool (replay, fleet, trend and diff take URLs)"
        )
    if ends and Path(text).suffix.lower() not in ends:
        raise argparse.ArgumentTypeError(f"must end with {' or '.join(ends)}, got {text!r}")
    return Path(text)


def _typed(kind: Any, text: str) -> Any:
    try:
        return typed(text, kind, "it", is_text=True)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("it ")) from None


def numbers(known: Sequence[str], text: str) -> dict[str, float]:
    """Return numbers by name, of a text NAME=VALUE,... with these names."""
    found = {}
    for each in text.split(","):
        name, _, value = each.partition("=")
        if (name := name.strip()) not in known:
            near = did_you_mean(name, known) or f"; known are {', '.join(known)}"
            raise argparse.ArgumentTypeError(f"there is no {name!r}{near}")
        try:
            found[name] = float(value)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{name} must be a number, got {value!r}") from None
    return found


def settings_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the checked settings from the TOML file and the options, which overrule the file.

    The file's settings are in ``arguments.settings``: :func:`read_words` puts them there.

    Raises:
        ConfigError: a setting is unknown or outside its limits, or some do not fit together.
    """
    written = {field.name: getattr(arguments, field.name, None) for field, _ in settings_declared()}
    if written["sysid"] == ALL:  # yawid live has taken it away before
        raise ConfigError(
            "--sysid all is for yawid live: give the number of one vehicle, or leave --sysid out"
        )
    given = {name: text for name, text in written.items() if text is not None}
    settings = overruled(arguments.settings, check_settings(given, COMMAND_LINE))
    RunConfig(**settings)  # errors in it are reported once for the command, not for each log
    return settings


def read_options_of(arguments: argparse.Namespace) -> "ReadOptions":
    """Return how a log is read: with the key by which frames must be signed, if any."""
    from yawid.sources.open_log import ReadOptions

    return ReadOptions.asked(arguments.signing_key_file)


def read_words(
    command: Command, words: Sequence[str], every: Callable[[], Mapping[str, Command]]
) -> argparse.Namespace:
    """Return the arguments, including those from the TOML file that ``--config`` names.

    ``settings`` of the result holds the file's settings of the run, by the configuration's fields.
    One file may serve several commands: of ``every`` command's options it may have those that this
    one does not have. What is said on the command line overrules the file.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or a setting is unknown or not allowed.
    """
    arguments, unknown = command.parse_known_args(words)
    if unknown and hasattr(arguments, "word"):  # yawid explain --band: it has options for words
        arguments.word += unknown
    elif unknown:
        command.error(_not_known(unknown, command, every()))
    file: Path | None = getattr(arguments, "config", None)
    if file is None:
        return arguments
    others = {option for each in every().values() for option in each.options} - NEVER
    others -= {f"--{option_name(field.name)}" for field, _ in settings_declared()}
    settings, of_file = {}, list[str]()
    for raw, value in read_toml(file).items():
        option = f"--{raw.replace('_', '-')}"
        action = command.options.get(option)
        if option not in others and (option, value) != ("--sysid", ALL):
            settings[raw] = value
        elif action and not (isinstance(action.default, list) and getattr(arguments, action.dest)):
            of_file += _as_written(option, value)
    settings = check_settings(settings, str(file))
    command.place = f"{file}: "  # the command line's own words are right
    # An option ends the file's words: true is no value of an option that needs one.
    arguments = command.parse_args([*of_file, f"--config={file}", *words])
    arguments.settings = settings
    return arguments


def _not_known(unknown: Sequence[str], command: Command, every: Mapping[str, Command]) -> str:
    """Return in words which arguments a command does not have, and what they may have meant."""
    options = [each.partition("=")[0] for each in unknown if each.startswith("-")]
    if not options:
        return f"{' '.join(unknown)}: too many arguments, {command.format_usage().strip()}"
    said = []
    for option in options:
        others = ", ".join(name for name, each in every.items() if option in each.options)
        near = did_you_mean(option, [each for each in command.options if each[2:]])
        of = f": it belongs to {others}" if others else near
        said.append(f"{command.prog} has no option {option}{of}")
    return "; ".join(said)


def _as_written(option: str, value: Any) -> list[str]:
    """Return a setting of a file as words of the command line."""
    if isinstance(value, bool):
        return [option] * value
    return [f"{option}={each}" for each in (value if isinstance(value, list) else [value])]
