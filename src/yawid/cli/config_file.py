"""``--config FILE``: options of any command in a TOML file; the command line overrules them.

One file may serve several commands: options that the present command does not have are ignored.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from yawid.errors import ConfigError, did_you_mean

NEVER = {"help", "version", "config"}
WORDS = {"sysid": "all"}
"""Values of options that only the command reads, and not the configuration of a run."""


def parsed(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the arguments, including those from the TOML file that ``--config`` names.

    ``settings`` of the result holds the file's settings of the run, by the configuration's fields.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or a setting is unknown or not allowed.
    """
    _check_first(parser, sys.argv[1:] if argv is None else argv)
    arguments, unknown = parser.parse_known_args(argv)
    command: argparse.ArgumentParser = arguments.own_parser
    file: Path | None = getattr(arguments, "config", None)
    if unknown and hasattr(arguments, "word"):  # yawid explain --band: it has options for words
        arguments.word += unknown
    elif unknown:
        command.error(_not_known(unknown, command, parser))
    if file is None:
        return arguments
    from yawid.config.run import check_settings, read_toml

    settings, options = _split(read_toml(file), _options_of_all(parser))
    for action in command._actions:
        is_list = isinstance(action, argparse._AppendAction)  # the command line would only add
        if action.dest in options and not (is_list and getattr(arguments, action.dest)):
            command.set_defaults(**{action.dest: _text(action, options[action.dest], file)})
    arguments = parser.parse_args(argv)
    arguments.settings = check_settings(settings, str(file))
    return arguments


def _check_first(whole: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Refuse an option before the command that yawid itself does not have, with what was meant."""
    first = "".join(argv[:1]).partition("=")[0]
    own = whole._option_string_actions
    if not first.startswith("-") or any(each.startswith(first) for each in own):
        return
    near = did_you_mean(first, [each for each in own if each[2:]])
    if any(first in each._option_string_actions for _, each in commands_of(whole)):
        near = f": it stands after the command, yawid COMMAND {first}"
    whole.error(f"there is no option {first}{near}")


def _not_known(
    unknown: Sequence[str], command: argparse.ArgumentParser, whole: argparse.ArgumentParser
) -> str:
    """Return in words which arguments a command does not have, and what they may have meant."""
    options = [each.partition("=")[0] for each in unknown if each.startswith("-")]
    if not options:
        return f"{' '.join(unknown)}: too many arguments, {command.format_usage().strip()}"
    said = []
    for option in options:
        near = did_you_mean(option, [each for each in command._option_string_actions if each[2:]])
        others = [
            name for name, each in commands_of(whole) if option in each._option_string_actions
        ]
        of = f": it belongs to {', '.join(others)}" if others else near
        said.append(f"{command.prog} has no option {option}{of}")
    return "; ".join(said)


def commands_of(whole: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield the commands of the whole parser by name."""
    for action in whole._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def _options_of_all(parser: argparse.ArgumentParser) -> set[str]:
    """Return the names of all options of all commands, except those in ``NEVER``."""
    found: set[str] = set()
    for _, command in commands_of(parser):
        found |= {each.dest for each in command._actions if each.option_strings}
    return found - NEVER


def _split(loaded: dict[str, Any], options: set[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the settings of the run, and the values that are only options of a command."""
    from dataclasses import fields

    from yawid.config.run import RunConfig

    of_run = {field.name.removesuffix("_s") for field in fields(RunConfig)}
    settings, others = {}, {}
    for raw, value in loaded.items():
        name = raw.replace("-", "_")
        is_word = WORDS.get(name) == value
        if is_word or (name in options and name not in of_run):
            others[name] = value
        else:
            settings[raw] = value
    return settings, others


def _text(action: argparse.Action, value: Any, file: Path) -> Any:
    """Return a value from the file in the form of the command line, for argparse to read.

    Raises:
        ConfigError: the value has the wrong type.
    """
    if isinstance(action, argparse._AppendAction):
        if isinstance(value, str):
            return [value]
        if isinstance(value, list) and all(isinstance(each, str) for each in value):
            return value
    elif isinstance(value, bool):
        if action.nargs == 0:
            return value
        if action.const is not None:  # an option whose value may be left out
            return action.const if value else action.default
    elif isinstance(value, str | int | float) and action.nargs != 0:
        return str(value)
    wanted = "true or false" if action.nargs == 0 else "a text or a number"
    if isinstance(action, argparse._AppendAction):
        wanted = "a text or a list of texts"
    raise ConfigError(f"{file}: {action.dest.replace('_', '-')} must be {wanted}, got {value!r}")
