"""The commands that need no log: ``step`` (paper eq. 4-16) and ``simulate`` (eq. 17-23)."""

import argparse
from pathlib import Path

from yawid.cli.options import Commands, add_command
from yawid.sinks.door import print_json, print_line

PLANTS = ("yaw", "lateral", "rigid-body")
NUMBERS = (
    ("--amplitude", 0.05, "RAD", "of the rudder (default: 0.05)"),
    ("--unit", 0.7, "S", "its unit of time (default: 0.7)"),
    ("--seconds", 120.0, "N", "length (default: 120)"),
    ("--rate", 50.0, "HZ", "samples (default: 50)"),
    ("--noise", 0.0, "RAD/S", "of the yaw rate, white (default: 0)"),
    ("--seed", 0, "N", "seed of the random signals (default: 0)"),
)
"""The numbers of a simulation: option, default, unit and help."""
SETTLING = ("settling_2pct_s", "settling_5pct_s")


def add_commands(commands: Commands) -> None:
    """Add both commands to the parser."""
    _add_step(commands)
    _add_simulate(commands)


def _add_step(commands: Commands) -> None:
    step = add_command(
        commands, "step", "FILE.csv", "fit the paper's models to a step response (eq. 4-16, 23)",
        "yawid step response.csv --u0 0.1 --step-time 5\n"
        "yawid simulate yaw --input step --out - | yawid step -",
    )  # fmt: skip
    step.add_argument(
        "file", type=Path, metavar="FILE.csv",
        help="columns t and y, and u if known; or t, r, rudder; - reads what simulate prints",
    )  # fmt: skip
    step.add_argument(
        "--model", choices=("first", "second", "yaw"), metavar="first|second|yaw",
        help="its form (default: first or second order by the fit, yaw where neither holds)",
    )  # fmt: skip
    step.add_argument(
        "--u0", type=float, metavar="A", help="height of the step (default: by column u, else 1)"
    )
    step.add_argument(
        "--step-time", type=float, metavar="S", help="its time in s (default: by column u, else 0)"
    )
    step.add_argument("--json", action="store_true", help="print one JSON object")
    step.set_defaults(run=_step)


def _add_simulate(commands: Commands) -> None:
    simulate = add_command(
        commands, "simulate", "PLANT --out FILE", "fly a reference plant of the paper to a file",
        "yawid simulate lateral --input 3211 --noise 0.002 --out flight.tlog\n"
        "yawid simulate yaw --input step --out - | yawid step -",
    )  # fmt: skip
    simulate.add_argument(
        "plant", metavar="PLANT", choices=PLANTS,
        help="yaw (eq. 22-23), lateral (eq. 21) or rigid-body (eq. 17-18)",
    )  # fmt: skip
    simulate.add_argument("--out", type=Path, required=True, metavar="FILE",
                          help="csv, parquet, tlog, mcap; -: csv to stdout")  # fmt: skip
    simulate.add_argument(
        "--input", default="3211", metavar="KIND",
        help="step, impulse, doublet, 3211, prbs, sweep or multisine (default: 3211)",
    )  # fmt: skip
    for option, default, metavar, text in NUMBERS:
        kind = type(default)
        simulate.add_argument(option, type=kind, default=default, metavar=metavar, help=text)
    simulate.add_argument("--force", action="store_true", help="overwrite a file that exists")
    simulate.set_defaults(run=_simulate)


def _step(arguments: argparse.Namespace) -> int:
    from yawid.runs.step import step_report

    asked = arguments.model, arguments.u0, arguments.step_time
    words, report = step_report(arguments.file, *asked)
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
        unit_s=arguments.unit,
        seconds=arguments.seconds,
        rate_hz=arguments.rate,
        noise_std=arguments.noise,
        seed=arguments.seed,
        force=arguments.force,
    )
    if str(arguments.out) != "-":
        print_line(str(arguments.out))
    return 0
