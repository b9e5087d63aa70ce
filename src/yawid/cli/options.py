"""The parser of one command, and the options that several commands share.

An option of a run is declared once, on its field of :class:`yawid.config.run.RunConfig`: its words,
its group and its bounds. Here it becomes an option of the command line.
"""

import argparse
import re
import textwrap
from collections.abc import Callable, Container, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, get_args

from yawid.errors import ConfigError, did_you_mean
from yawid.sinks.door import plain

if TYPE_CHECKING:
    from yawid.runs.outputs import Outputs
    from yawid.sources.open_log import ReadOptions

DEFAULT_OUT = "yawid-out"
NEVER = {"--help", "--help-all", "--config"}
"""What no settings file has."""
ALL = "all"
"""The value of sysid that only ``yawid live`` reads, and not the configuration of a run."""


class Command(argparse.ArgumentParser):
    """The parser of one command; an error is one line, with the command that lists the options."""

    def __init__(self, name: str, what: str, *, is_short: bool = False) -> None:
        """Make the parser of a command; of one that ``is_short`` help has the usual options."""
        super().__init__(
            prog=f"yawid {name}",
            description=what[0].upper() + what[1:] + ".",
            formatter_class=_page,
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
            self.option(
                *names, action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS
            )

    def shape(self, arguments: str, examples: str, run: Callable[..., int]) -> None:
        """Say which ``arguments`` it takes, with examples (a line each), and what runs it."""
        self.usage = " ".join(filter(None, (self.prog, arguments, "[options]")))
        self.epilog = "examples:\n" + textwrap.indent(examples, "  ")
        self.set_defaults(run=run)

    def option(
        self, *names: str, group: str = "", rare: bool = False, **settings: Any
    ) -> argparse.Action:
        """Add an option, or an argument, as ``add_argument`` does, to the group of this title.

        Its type may be an annotation with bounds and words, as those of the options of a run. The
        name of a file to be written must end as one that the metavar has.
        """
        if (kind := settings.get("type")) in (int, float) or get_args(kind):
            settings["type"] = partial(_typed, kind)
        elif kind is Path:
            ends = re.findall(r"\.\w+", str(settings.get("metavar")))
            settings["type"] = partial(path_of, ends=ends * names[0].startswith("-"))
        if group and group not in self._groups:
            self._groups[group] = self.add_argument_group(group)
        if rare and self._is_short:
            self._rare, settings["help"] = self._rare + 1, argparse.SUPPRESS
        to = self._groups.get(group, self)
        action: argparse.Action = to.add_argument(*names, **settings)
        self.arguments.append(action)
        self.options |= dict.fromkeys(action.option_strings, action)
        return action

    def flag(self, name: str, text: str, **where: Any) -> None:
        """Add an option without a value."""
        self.option(name, action="store_true", help=text, **where)

    def page(self, metavar: str, text: str) -> None:
        """Add the options of a file that is written."""
        self.option("-o", "--out", type=Path, metavar=metavar, help=text)
        self.flag("--force", "overwrite a file that exists")

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


def _page(prog: str) -> argparse.HelpFormatter:
    return argparse.RawDescriptionHelpFormatter(prog, max_help_position=32)


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
    from yawid.config.fields import typed

    try:
        return typed(text, kind, "it", is_text=True)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("it ")) from None


def choice(*names: str) -> dict[str, Any]:
    """Return what makes an argument take one of these names."""
    from yawid.config.fields import like

    return {
        "type": like("|".join(names), f"be one of {', '.join(names)}"),
        "metavar": "|".join(names),
    }


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


def add_outputs(command: Command) -> None:
    """Add the options of what a command writes."""
    from yawid.config.fields import like

    group = "what is written"
    viewer = like(r"off|save|spawn|rerun\+http.*", "be off, save, spawn or rerun+http://...")
    command.option(
        "--out", type=Path, default=Path(DEFAULT_OUT), metavar="DIR", group=group,
        help=f"folder of the files (default: {DEFAULT_OUT})",
    )  # fmt: skip
    command.flag("--force", "overwrite files that exist", group=group)
    command.flag("--json", "print one JSON object per log", group=group)
    command.option(
        "--rerun", type=viewer, default="off", metavar="off|save|spawn|URL", group=group,
        help="a Rerun recording, or a viewer: rerun+http://HOST:PORT/proxy (default: off)",
    )  # fmt: skip


def add_run_options(command: Command, without: Container[str] = ()) -> None:
    """Add the options of a run, except the groups ``without``, and those of reading its log."""
    from yawid.config.run import option_name, settings_declared

    command.set_defaults(settings={})
    text = "options from a TOML file, by their names"
    command.option("--config", type=Path, metavar="FILE", help=text)
    for field, said in settings_declared():
        if said.group not in without:
            names = [f"--{each}" for each in (option_name(field.name), *said.aliases)]
            command.option(
                *names, metavar=said.shown, help=said.words, group=said.group, rare=not said.usual
            )
    text = "read only frames signed by this key (default: any)"
    command.option("--signing-key-file", type=Path, metavar="FILE", help=text, rare=True)


def settings_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the checked settings from the TOML file and the options, which overrule the file.

    The file's settings are in ``arguments.settings``: :func:`read_words` puts them there.

    Raises:
        ConfigError: a setting is unknown or outside its limits, or some do not fit together.
    """
    from yawid.config.run import RunConfig
    from yawid.config.settings import COMMAND_LINE, check_settings, overruled

    if getattr(arguments, "sysid", None) == "all":  # yawid live has taken it away before
        raise ConfigError(
            "--sysid all is for yawid live: give the number of one vehicle, or leave --sysid out"
        )
    given = check_settings(given_options(arguments), COMMAND_LINE)
    settings = overruled(arguments.settings, given)
    RunConfig(**settings)  # errors in it are reported once for the command, not for each log
    return settings


def given_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given options of a run as they were written, by their names without dashes."""
    from yawid.config.run import option_name, settings_declared

    names = [option_name(field.name) for field, _ in settings_declared()]
    written = {name: getattr(arguments, name.replace("-", "_"), None) for name in names}
    return {name: text for name, text in written.items() if text is not None}


def outputs_of(arguments: argparse.Namespace, name: str) -> "Outputs":
    """Return where the results are written, in files of this name."""
    from yawid.runs.outputs import Outputs

    record = not getattr(arguments, "no_record", False)
    return Outputs(arguments.out, name, arguments.rerun, arguments.force, record)


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
    from yawid.config.run import option_name, settings_declared
    from yawid.config.settings import check_settings, read_toml

    of_run = {option_name(field.name) for field, _ in settings_declared()}
    settings, of_file = {}, list[str]()
    for raw, value in read_toml(file).items():
        name = raw.replace("_", "-")
        action = command.options.get(f"--{name}")
        if name in of_run and (name, value) != ("sysid", ALL):
            settings[raw] = value
        elif f"--{name}" in NEVER or not any(f"--{name}" in e.options for e in every().values()):
            settings[raw] = value  # which is refused below
        elif action and not (isinstance(action.default, list) and getattr(arguments, action.dest)):
            of_file += _as_written(name, value)
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


def _as_written(name: str, value: Any) -> list[str]:
    """Return a setting of a file as words of the command line."""
    if isinstance(value, bool):
        return [f"--{name}"] * value
    return [f"--{name}={each}" for each in (value if isinstance(value, list) else [value])]
