"""The words of a command line, and those of ``--config FILE``, which the command line overrules.

One file may serve several commands: options that the present command does not have are ignored.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from yawid.cli.options import Command
from yawid.errors import ConfigError, did_you_mean

NEVER = {"--help", "--help-all", "--config"}
ALL = "all"
"""The value of sysid that only ``yawid live`` reads, and not the configuration of a run."""


def read_words(
    command: Command, words: Sequence[str], every: Callable[[], Mapping[str, Command]]
) -> argparse.Namespace:
    """Return the arguments, including those from the TOML file that ``--config`` names.

    ``settings`` of the result holds the file's settings of the run, by the configuration's fields.
    ``every`` returns all commands: what this one does not have may belong to another.

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
    settings, defaults = {}, {}
    for raw, value in read_toml(file).items():
        name = raw.replace("_", "-")
        action = command.options.get(f"--{name}")
        if name in of_run and (name, value) != ("sysid", ALL):
            settings[raw] = value
        elif action is not None and f"--{name}" not in NEVER:
            if not (isinstance(action.default, list) and getattr(arguments, action.dest)):
                defaults[action.dest] = _as_written(action, name, value, file)
        elif f"--{name}" in NEVER or not any(f"--{name}" in e.options for e in every().values()):
            settings[raw] = value  # which is refused below
    command.set_defaults(**defaults)
    arguments = command.parse_args(words)
    arguments.settings = check_settings(settings, str(file))
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


def _as_written(action: argparse.Action, name: str, value: Any, file: Path) -> Any:
    """Return a value from the file in the form of the command line, for argparse to read.

    Raises:
        ConfigError: the value has the wrong type.
    """
    if isinstance(action.default, list):
        texts = [value] if isinstance(value, str) else value
        if isinstance(texts, list) and all(isinstance(each, str) for each in texts):
            return texts
        wanted = "a text or a list of texts"
    elif action.nargs == 0:
        if isinstance(value, bool):
            return value
        wanted = "true or false"
    else:
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            return str(value)
        wanted = "a text or a number"
    raise ConfigError(f"{file}: {name} must be {wanted}, got {value!r}")
