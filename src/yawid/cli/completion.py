"""The command line of ``yawid completion``: what a shell has to know to complete by the Tab key."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from yawid.cli.options import add_command
from yawid.sinks.door import tell_whole

SHELLS = ("bash", "zsh")


def add_completion(commands: Any, whole: argparse.ArgumentParser) -> None:
    """Add the command to those of the whole parser, which is what it prints."""
    completion = add_command(
        commands, "completion", "bash|zsh", "print what a shell needs to complete yawid's options",
        'eval "$(yawid completion bash)"      in ~/.bashrc\n'
        "yawid completion zsh > _yawid        in a folder of $fpath",
    )  # fmt: skip
    completion.add_argument("shell", choices=SHELLS, help="the shell that is to complete")
    completion.set_defaults(run=partial(_completion, whole))


def _completion(whole: argparse.ArgumentParser, arguments: argparse.Namespace) -> int:
    import shtab

    _complete_paths(whole, shtab.FILE)
    tell_whole(shtab.complete(whole, arguments.shell) + "\n")
    return 0


def _complete_paths(parser: argparse.ArgumentParser, complete: Any) -> None:
    """Tell shtab which arguments are files: those that become a Path."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _complete_paths(command, complete)
        elif action.type is Path:
            action.complete = complete  # type: ignore[attr-defined] # shtab's own mark on an action
