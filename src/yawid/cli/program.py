"""The commands about the program itself: ``yawid explain``, ``schema`` and ``completion``.

shtab writes the scripts of ``completion``. What is offered for an argument follows from its own
metavar: ``a|b`` are values, ``OUT.csv`` is the name of a file with that suffix.
"""

import argparse
import json
import re
from typing import Annotated, Any, Final, Literal

from yawid.cli.explain import explained, listed, parts_of
from yawid.cli.options import command, path_of, said
from yawid.config.fields import one_of
from yawid.sinks.door import print_text
from yawid.sources.formats import FORMATS
from yawid.system.stores import place_of

PRINTING = (
    "replay", "live", "inspect", "orders", "step", "damper", "export", "trend", "diff",
    "fleet",
)  # fmt: skip
"""The commands whose output has a schema."""
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


@command("[WORD]", "yawid explain not_excited\nyawid explain --band\nyawid explain Dutch roll")
def explain(
    arguments: argparse.Namespace,
    word: Annotated[list[str], said("WORD", "the word (default: list them)", nargs="*")],
) -> int:
    """Print what the manual and the tables of the code say of a word."""
    parts, asked = parts_of(arguments.every()), " ".join(word)
    print_text(explained(parts, asked) if asked else listed(parts))
    return 0


@command("[COMMAND]", "yawid schema replay\nyawid schema | jq '.[\"x-exit-codes\"]'")
def schema(
    command: Annotated[
        str | None,
        one_of(*PRINTING),
        said("COMMAND", f"only of one command: {', '.join(PRINTING)} (default: all)", nargs="?"),
    ] = None,
) -> int:
    """Print the JSON Schema of what a command prints."""
    from yawid.cli.json_schema import document

    print_text(json.dumps(document(command), indent=1, ensure_ascii=False) + "\n")
    return 0


@command(
    "bash|zsh",
    'eval "$(yawid completion bash)"      in ~/.bashrc\n'
    "yawid completion zsh > _yawid        in a folder of $fpath",
)
def completion(
    arguments: argparse.Namespace,
    shell: Annotated[Literal["bash", "zsh"], said("", "the shell in which to complete")],
) -> int:
    """Print the script that completes a command line."""
    import shtab

    whole = argparse.ArgumentParser(prog="yawid")
    commands = whole.add_subparsers()
    for name, parser in arguments.every().items():
        for action in parser.arguments:
            if (offered := _files(action)) is not None:
                action.complete = offered  # shtab's mark
            elif action.metavar is not None:
                action.choices = _values(str(action.metavar)) or None
            if shell == "zsh" and action.nargs is None and action.option_strings:
                # zsh's mark of an option whose value may follow "=" or stand in the next word
                action.option_strings = [f"{each}=" for each in action.option_strings]
        what = str(parser.description)
        commands.add_parser(name, help=what, parents=[parser], add_help=False)
    print_text(shtab.complete(whole, shell) + (_EQUALS if shell == "bash" else "\n"))
    return 0


def _values(metavar: str) -> list[str]:
    """Return the values that a metavar names."""
    if "|" not in metavar and metavar not in _VALUES:
        return []
    found = [_VALUES.get(each, (each,)) for each in metavar.split("|")]
    return [value for values in found for value in values if value == value.lower()]


def _files(action: argparse.Action) -> Any:
    """Return what offers an argument's files, as shtab has it; None: it takes no file."""
    import shtab

    metavar = str(action.metavar)
    if getattr(action.type, "func", action.type) not in (path_of, place_of) and metavar != "PATH":
        return None
    if metavar in _FOLDERS:
        return shtab.DIRECTORY
    suffixes = re.findall(r"\.(\w+)", metavar)
    if metavar in _LOGS:
        suffixes = [*(each.name for each in FORMATS), "part"]
    elif action.dest == "config":
        suffixes = ["toml"]
    names = [f"*.{form}" for each in suffixes for form in (each, each.upper())]
    return shtab.glob(*names) if names else shtab.FILE
