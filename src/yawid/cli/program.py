"""The commands about the program itself: ``yawid schema`` and ``completion``.

shtab writes the scripts of ``completion``. What is offered for an argument follows from its own
metavar: ``a|b`` are values, ``OUT.csv`` is the name of a file with that suffix.
"""

import argparse
import json
import re
from typing import Any, Final

from yawid.cli.options import Command, choice, path_of
from yawid.sinks.door import print_text
from yawid.sources.formats import FORMATS
from yawid.system.stores import place_of

PRINTING = (
    "replay", "live", "inspect", "orders", "step", "damper", "export", "trend", "diff",
    "fleet",
)  # fmt: skip
"""The commands whose output has a schema."""
SHELLS: Final = ("bash", "zsh")
_LOGS: Final = ("LOG", "RUN|LOG", "PATH", "A", "B")
_FOLDERS: Final = ("DIR", "DATASET")
_VALUES: Final = {"rudder[,aileron]": ("rudder", "rudder,aileron")}
"""Values that stand in a metavar under another name."""
_EQUALS: Final = """
_yawid_equals() {  # bash has --method=els as three words; shtab's function knows two
  local each words=()
  for each in "${COMP_WORDS[@]:0:COMP_CWORD+1}"; do [[ $each == = ]] || words+=("$each"); done
  [[ ${COMP_WORDS[COMP_CWORD]} == = ]] && words+=("")
  local COMP_WORDS=("${words[@]}") COMP_CWORD=$((${#words[@]} - 1))
  _shtab_yawid
}
complete -o bashdefault -F _yawid_equals yawid
"""


def add_schema(command: Command) -> None:
    """Give the command its argument."""
    examples = "yawid schema replay\nyawid schema | jq '.[\"x-exit-codes\"]'"
    command.shape("[COMMAND]", examples, _schema)
    text = f"only of one command: {', '.join(PRINTING)} (default: all)"
    command.option("command", nargs="?", **choice(*PRINTING) | {"metavar": "COMMAND"}, help=text)


def _schema(arguments: argparse.Namespace) -> int:
    from yawid.cli.json_schema import document

    schema = document(arguments.command)
    print_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n")
    return 0


def add_completion(command: Command) -> None:
    """Give the command its argument."""
    command.shape(
        "bash|zsh",
        'eval "$(yawid completion bash)"      in ~/.bashrc\n'
        "yawid completion zsh > _yawid        in a folder of $fpath",
        _completion,
    )
    command.option("shell", **choice(*SHELLS), help="the shell in which to complete")


def _completion(arguments: argparse.Namespace) -> int:
    import shtab

    functions = set()
    whole = argparse.ArgumentParser(prog="yawid")
    commands = whole.add_subparsers()
    for name, command in arguments.every().items():
        for action in command.arguments:
            if (offered := _files(action, shtab.FILE, shtab.DIRECTORY)) is not None:
                action.complete = offered  # shtab's mark
                if arguments.shell == "bash" and offered["bash"].startswith("_yawid_file"):
                    functions.add(_of_suffixes(offered["bash"]))
            elif action.metavar is not None:
                action.choices = _values(str(action.metavar)) or None
            if arguments.shell == "zsh" and action.nargs is None and action.option_strings:
                # zsh's mark of an option whose value may follow "=" or stand in the next word
                action.option_strings = [f"{each}=" for each in action.option_strings]
        what = str(command.description)
        commands.add_parser(name, help=what, parents=[command], add_help=False)
    preamble = "".join(sorted(functions))
    end = _EQUALS if arguments.shell == "bash" else "\n"
    print_text(shtab.complete(whole, arguments.shell, preamble=preamble) + end)
    return 0


def _values(metavar: str) -> list[str]:
    """Return the values that a metavar names."""
    if "|" not in metavar and metavar not in _VALUES:
        return []
    found = [_VALUES.get(each, (each,)) for each in metavar.split("|")]
    return [value for values in found for value in values if value == value.lower()]


def _files(action: argparse.Action, any_file: Any, folder: Any) -> Any:
    """Return what offers an argument's files by shell, as shtab has it; None: it takes no file."""
    metavar = str(action.metavar)
    if getattr(action.type, "func", action.type) not in (path_of, place_of) and metavar != "PATH":
        return None
    if metavar in _FOLDERS:
        return folder
    suffixes = re.findall(r"\.(\w+)", metavar)
    if metavar in _LOGS:
        suffixes = [*(each.name for each in FORMATS), "part"]
    elif action.dest == "config":
        suffixes = ["toml"]
    if not suffixes:
        return any_file
    return {
        "bash": "_yawid_file_" + "_".join(suffixes),
        "zsh": f"_files -g '*.(#i)({'|'.join(suffixes)})(-.)'",
    }


def _of_suffixes(name: str) -> str:
    """Return bash's function of this name, which offers folders and files with its suffixes."""
    suffixes = name.removeprefix("_yawid_file_").split("_")
    both = " ".join(f"{each} {each.upper()}" for each in suffixes)
    return (
        f'{name}() {{\n  local each\n  compgen -d -- "$1"\n'
        f'  for each in {both}; do compgen -f -X "!*.$each" -- "$1"; done\n}}\n'
    )
