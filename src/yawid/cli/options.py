"""The parser of one command, and the options that several commands share.

An option of a run is declared once, on its field of :class:`yawid.config.run.RunConfig`: its words,
its group and its bounds. Here it becomes an option of the command line.
"""

import argparse
import textwrap
from collections.abc import Callable, Container
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from yawid.errors import ConfigError, did_you_mean
from yawid.sinks.door import plain, print_text

if TYPE_CHECKING:
    from yawid.runs.outputs import Outputs
    from yawid.sources.open_log import ReadOptions

DEFAULT_OUT = "yawid-out"


class _Help(argparse.Action):
    """``--help`` and ``--help-all``: the second shows the rarely used options, too."""

    def __init__(self, option_strings: list[str], dest: str, **others: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, **others)

    def __call__(self, parser: Any, _: Any, __: Any, option_string: str | None = None) -> None:
        parser.show(with_rare=option_string == "--help-all")


class Command(argparse.ArgumentParser):
    """The parser of one command; an error is one line, with the command that lists the options."""

    def __init__(self, name: str, what: str) -> None:
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
        self._rare: list[argparse.Action] = []
        for kind, read in ((Path, _path), (float, _number), (int, _whole)):
            self.register("type", kind, read)
        self.option("-h", "--help", action=_Help, help="show the usual options")
        self.option("--help-all", action=_Help, help="show every option", rare=True)

    def shape(self, arguments: str, examples: str, run: Callable[..., int]) -> None:
        """Say which ``arguments`` it takes, with examples (a line each), and what runs it."""
        self.usage = " ".join(filter(None, (self.prog, arguments, "[options]")))
        self.epilog = "examples:\n" + textwrap.indent(examples, "  ")
        self.set_defaults(run=run)

    def option(
        self, *names: str, group: str = "", rare: bool = False, **settings: Any
    ) -> argparse.Action:
        """Add an option, or an argument, as ``add_argument`` does, to the group of this title."""
        if group and group not in self._groups:
            self._groups[group] = self.add_argument_group(group)
        to = self._groups.get(group, self)
        action: argparse.Action = to.add_argument(*names, **settings)
        self.arguments.append(action)
        self.options |= dict.fromkeys(action.option_strings, action)
        self._rare += [action] * rare
        return action

    def flag(self, name: str, text: str, **where: Any) -> None:
        """Add an option without a value."""
        self.option(name, action="store_true", help=text, **where)

    def show(self, *, with_rare: bool) -> NoReturn:
        """Print the page of help and exit."""
        hidden = [self.options["--help"], self.options["--help-all"]]
        if not with_rare:
            hidden += self._rare
            more = len(self._rare) - 1
            note = f"\n\n{self.prog} --help-all shows {more} more options." if more else ""
            self.epilog = f"{self.epilog}{note}"
        for action in hidden:
            action.help = argparse.SUPPRESS
        print_text(self.format_help())
        self.exit()

    def error(self, message: str) -> NoReturn:
        """Write the line to stderr and exit with 2."""
        end = "" if message.endswith("?") else ";"
        self.exit(2, f"yawid: {plain(message)}{end} {self.prog} --help lists the options\n")


def _page(prog: str) -> argparse.HelpFormatter:
    return argparse.RawDescriptionHelpFormatter(prog, max_help_position=32)


def _path(text: str) -> Path:
    """Return a text as a path; a URL is refused: Path would make ``s3://x`` a folder ``s3:``."""
    if "://" in text:
        raise argparse.ArgumentTypeError(
            f"{text!r} is a URL, but a path on this machine is needed: copy the file to or from "
            "the store with the store's own tool (replay, fleet, trend and diff take URLs)"
        )
    return Path(text)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number, got {text!r}") from None


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a whole number, got {text!r}") from None


def choice(*names: str) -> dict[str, Any]:
    """Return what makes an argument take one of these names, and name the nearest to another."""

    def chosen(text: str) -> str:
        if text not in names:
            near = did_you_mean(text, names)
            raise argparse.ArgumentTypeError(
                f"must be one of {', '.join(names)}, got {text!r}{near}"
            )
        return text

    return {"type": chosen, "metavar": "|".join(names)}


def add_outputs(command: Command) -> None:
    """Add the options of what a command writes."""
    group = "what is written"
    command.option(
        "--out", type=Path, default=Path(DEFAULT_OUT), metavar="DIR", group=group,
        help=f"folder of the files (default: {DEFAULT_OUT})",
    )  # fmt: skip
    command.flag("--force", "overwrite files that exist", group=group)
    command.flag("--json", "print one JSON object per log", group=group)
    command.option(
        "--rerun", default="off", metavar="off|save|spawn|URL", group=group,
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

    The file's settings are in ``arguments.settings``: :mod:`yawid.cli.config_file` puts them there.

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
    """Return where the results are written, in files of this name.

    Raises:
        ConfigError: ``--rerun`` has a value that is not allowed.
    """
    from yawid.runs.outputs import Outputs

    rerun = arguments.rerun
    if rerun not in ("off", "save", "spawn") and not rerun.startswith("rerun+http"):
        raise ConfigError(f"--rerun must be off, save, spawn or rerun+http://..., got {rerun!r}")
    record = not getattr(arguments, "no_record", False)
    return Outputs(arguments.out, name, rerun, arguments.force, record)


def read_options_of(arguments: argparse.Namespace) -> "ReadOptions":
    """Return how a log is read: with the key by which frames must be signed, if any."""
    from yawid.sources.open_log import ReadOptions

    return ReadOptions.asked(arguments.signing_key_file)
