"""The command ``yawid regress``: compare cases, update their references, or make a new case."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yawid.cli.options import Commands, add_command, add_estimator_options, given_options
from yawid.errors import ConfigError
from yawid.runs.stop import Interrupted
from yawid.sinks.door import print_json, print_line, say

if TYPE_CHECKING:
    from yawid.runs.regress.check import Outcome

MOST_LINES = 20


def add_regress(commands: Commands) -> None:
    """Add the command to the parser."""
    regress = add_command(
        commands, "regress", "[CASE...]", "replay cases against their references",
        'yawid regress --junit result.xml\nyawid regress --update --why "new gyro" c172p_3211\n'
        "yawid regress --new flight.tlog --name mine --rate 10   (the case's own options)",
    )  # fmt: skip
    regress.add_argument(
        "cases", nargs="*", metavar="CASE", help="folder or name of a case (default: all)"
    )
    regress.add_argument("--folder", type=Path, default=Path("replay_logs"), metavar="DIR",
                         help="folder of the cases (default: replay_logs)")  # fmt: skip
    regress.add_argument(
        "--workers", type=int, metavar="N", help="processes (default: 1; large logs: one a core)"
    )
    regress.add_argument("--json", action="store_true", help="print one JSON object")
    regress.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML too")
    regress.add_argument("--update", action="store_true", help="write the references again")
    regress.add_argument("--why", metavar="TEXT", help="the reason, recorded with the update")
    regress.add_argument("--new", type=Path, metavar="LOG", help="make a case from a log")
    regress.add_argument("--name", metavar="CASE", help="the new case's name")
    add_estimator_options(regress)
    regress.set_defaults(run=_regress)


def _regress(arguments: argparse.Namespace) -> int:
    """Compare, update or make a case; return the exit code."""
    settings = arguments.settings | given_options(arguments)  # unchanged, for the case's file
    _check(arguments, settings)
    if arguments.new is not None:
        return _new(arguments, settings)
    if arguments.update:
        from yawid.runs.regress.update import update

        try:
            update(arguments.folder, arguments.cases, arguments.why, print_line)
        except Interrupted as stopped:
            return stopped.exit_code  # cases updated before keep their new references
        return 0
    return _compare(arguments)


def _check(arguments: argparse.Namespace, settings: Mapping[str, Any]) -> None:
    if arguments.update != (arguments.why is not None):
        raise ConfigError("--update and --why belong together: a new reference needs a reason")
    if (arguments.new is None) != (arguments.name is None):
        raise ConfigError("--new and --name belong together: a log and the name of its case")
    if arguments.new is not None and (arguments.update or arguments.cases):
        raise ConfigError(
            "--new only makes a case: write its references afterwards by --update --why"
        )
    if arguments.new is None and settings:
        given = ", ".join(f"--{name}" for name in settings)
        raise ConfigError(
            f"{given}: a case has options of its own, in its case.toml; give them only with --new"
        )
    if arguments.workers is not None and arguments.workers < 1:
        raise ConfigError(f"--workers must be at least 1, got {arguments.workers}")
    if (arguments.new is not None or arguments.update) and (arguments.json or arguments.junit):
        raise ConfigError(
            "--json and --junit report a comparison: leave them out with --new and --update"
        )


def _new(arguments: argparse.Namespace, settings: Mapping[str, Any]) -> int:
    from yawid.runs.regress.new_case import new_case

    case = new_case(arguments.new, arguments.name, arguments.folder, settings)
    print_line(f"made  {case.folder}: {case.log.stat().st_size} bytes, floor {case.floor}")
    print_line("write into its case.toml whose log it is; then")
    print_line(f'yawid regress --update --why "first reference" {case.folder}')
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    from yawid.runs.regress.case import find_cases
    from yawid.runs.regress.check import (
        Outcome,
        as_json,
        check_junit,
        exit_code,
        regress,
        write_junit,
    )

    if arguments.junit is not None:
        check_junit(arguments.junit)
    cases = find_cases(arguments.folder, arguments.cases)
    outcomes: list[Outcome] = []
    try:
        for outcome in regress(cases, arguments.workers):
            outcomes.append(outcome)
            if not arguments.json:
                _print_outcome(outcome)
    except Interrupted as stopped:
        unreached = cases[len(outcomes) :]
        say(f"not reached: {', '.join(case.name for case in unreached)}")
        code, why = stopped.exit_code, ("interrupted: not compared",)
        outcomes += [Outcome(case.name, case.folder.absolute(), code, why) for case in unreached]
    if arguments.json:
        print_json(as_json(outcomes))
    if arguments.junit is not None:
        write_junit(arguments.junit, outcomes)
    return exit_code(outcomes)


def _print_outcome(outcome: "Outcome") -> None:
    print_line(f"{'ok' if outcome.ok else 'FAILED':>6}  {outcome.name}")
    for line in outcome.wrong[:MOST_LINES]:
        print_line(f"        {line}")
    if len(outcome.wrong) > MOST_LINES:
        print_line(f"        and {len(outcome.wrong) - MOST_LINES} more: --json lists them all")
    for what, path in outcome.files.items():
        print_line(f"        {what}: {path}")
    if outcome.code == 1:
        print_line("        if the change is meant:")
        print_line(f'        yawid regress --update --why "..." {outcome.folder}')
