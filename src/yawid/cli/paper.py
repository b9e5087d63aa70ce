"""The commands that need no log: ``step`` (paper eq. 4-16) and ``simulate`` (eq. 17-23)."""

import argparse
from pathlib import Path

from yawid.cli.options import Command, choice
from yawid.sinks.door import print_json, print_line

PLANTS = ("yaw", "lateral", "rigid-body")
NUMBERS = (
    ("--amplitude", 0.05, "RAD", "of the rudder (default: 0.05)"),
    ("--seconds", 120.0, "N", "length (default: 120)"),
    ("--rate", 50.0, "HZ", "samples (default: 50)"),
    ("--noise", 0.0, "RAD/S", "of the yaw rate, white (default: 0)"),
)
"""The numbers of a simulation: option, default, unit and help."""
SETTLING = ("settling_2pct_s", "settling_5pct_s")


def add_step(command: Command) -> None:
    """Give the command its arguments and options."""
    command.shape(
        "FILE.csv",
        "yawid step response.csv --u0 0.1\nyawid simulate yaw --input step --out - | yawid step -",
        _step,
    )
    text = "columns t and y, and u if known; or t, r, rudder; - reads what simulate prints"
    command.option("file", type=Path, metavar="FILE.csv", help=text)
    text = "its form (default: first or second order by the fit, yaw where neither holds)"
    command.option("--model", **choice("first", "second", "yaw"), help=text)
    text = "height of the step (default: by column u, else 1)"
    command.option("--u0", type=float, metavar="A", help=text)
    command.flag("--json", "print one JSON object")


def add_simulate(command: Command) -> None:
    """Give the command its arguments and options."""
    command.shape(
        "PLANT --out FILE",
        "yawid simulate lateral --input 3211 --noise 0.002 --out flight.tlog\n"
        "yawid simulate yaw --input step --out - | yawid step -",
        _simulate,
    )
    text = "yaw (eq. 22-23), lateral (eq. 21) or rigid-body (eq. 17-18)"
    command.option("plant", **choice(*PLANTS) | {"metavar": "PLANT"}, help=text)
    text = "csv, tlog, mcap; -: csv to stdout"
    command.option("--out", type=Path, required=True, metavar="FILE", help=text)
    text = "step, impulse, doublet, 3211, prbs, sweep or multisine (default: 3211)"
    command.option("--input", default="3211", metavar="KIND", help=text)
    for name, default, metavar, text in NUMBERS:
        command.option(name, type=type(default), default=default, metavar=metavar, help=text)
    command.flag("--force", "overwrite a file that exists")


def _step(arguments: argparse.Namespace) -> int:
    from yawid.runs.step import step_report

    words, report = step_report(arguments.file, arguments.model, arguments.u0)
    if arguments.json:
        print_json(report.to_json())
        return 0
    print_line(words)
    formula = report.formula or {}
    if formula:
        print_line(f"  {'':<16} {'by the fit':<24} by the paper's formulas")
    for name, number in (report.parameters | {n: getattr(report, n) for n in SETTLING}).items():
        fitted, read = f"{number.value:.6g} ± {number.std:.2g}", formula.get(name)
        print_line(f"  {name:<16} {fitted:<24} {'' if read is None else f'{read:.6g}'}".rstrip())
    return 0


def _simulate(arguments: argparse.Namespace) -> int:
    from yawid.runs.simulate import simulate_to_file

    simulate_to_file(
        arguments.plant,
        arguments.input,
        arguments.out,
        amplitude=arguments.amplitude,
        seconds=arguments.seconds,
        rate_hz=arguments.rate,
        noise_std=arguments.noise,
        force=arguments.force,
    )
    if str(arguments.out) != "-":
        print_line(str(arguments.out))
    return 0
