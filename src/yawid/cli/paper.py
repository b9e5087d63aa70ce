"""The commands that need no log: ``step`` (paper eq. 4-16) and ``simulate`` (eq. 17-23)."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yawid.cli.options import add_command
from yawid.errors import ConfigError, NotIdentifiable
from yawid.sinks.door import tell, tell_json

if TYPE_CHECKING:
    from collections.abc import Callable

    from yawid.offline.step_response import FirstOrder, SecondOrder, YawStep

    StepModel = FirstOrder | SecondOrder | YawStep

PLANTS = ("yaw", "lateral", "rigid-body")
PARAMETERS = {
    "first": ("K", "T"),
    "second": ("k", "D", "q"),
    "yaw": ("K", "T_theta_s", "omega_beta", "xi_beta"),
}
MODELS = {
    "first": "first order (eq. 4)",
    "second": "second order (eq. 7)",
    "yaw": "yaw rate (eq. 23)",
}
MOST_SAMPLES = 5_000_000
"""A day at 50 Hz, and what fits into the memory of a small machine."""
SETTLING = ("settling_2pct_s", "settling_5pct_s")


def add_commands(commands: Any) -> None:
    """Add both commands to the parser's."""
    _add_step(commands)
    _add_simulate(commands)


def _add_step(commands: Any) -> None:
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
        "--model", choices=tuple(PARAMETERS), metavar="first|second|yaw",
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


def _add_simulate(commands: Any) -> None:
    simulate = add_command(
        commands, "simulate", "PLANT --out FILE", "fly a reference plant of the paper to a file",
        "yawid simulate lateral --input 3211 --noise 0.002 --out flight.tlog\n"
        "yawid simulate yaw --input step --out - | yawid step -",
    )  # fmt: skip
    simulate.add_argument(
        "plant",
        metavar="PLANT",
        choices=PLANTS,
        help="yaw (eq. 22-23), lateral (eq. 21) or rigid-body (eq. 17-18)",
    )
    simulate.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="csv, parquet, tlog, mcap; -: csv to stdout",
    )
    simulate.add_argument(
        "--input", default="3211", metavar="KIND",
        help="step, impulse, doublet, 3211, prbs, sweep or multisine (default: 3211)",
    )  # fmt: skip
    simulate.add_argument(
        "--amplitude", type=float, default=0.05, metavar="RAD", help="of the rudder (default: 0.05)"
    )
    simulate.add_argument(
        "--unit", type=float, default=0.7, metavar="S", help="its unit of time (default: 0.7)"
    )
    simulate.add_argument(
        "--seconds", type=float, default=120.0, metavar="N", help="length (default: 120)"
    )
    simulate.add_argument(
        "--rate", type=float, default=50.0, metavar="HZ", help="samples (default: 50)"
    )
    simulate.add_argument(
        "--noise",
        type=float,
        default=0.0,
        metavar="RAD/S",
        help="of the yaw rate, white (default: 0)",
    )
    simulate.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of what is drawn (default: 0)"
    )
    simulate.add_argument("--force", action="store_true", help="overwrite a file that exists")
    simulate.set_defaults(run=_simulate)


def _step(arguments: argparse.Namespace) -> int:
    from yawid.offline.step_response import (
        fit_first_order,
        fit_second_order,
        fit_yaw,
        read_step,
    )

    t, y, u0, step_time = read_step(arguments.file, arguments.u0, arguments.step_time)
    found: dict[str, StepModel] = {}
    refusals = []

    def fit(model: str, by: "Callable[..., StepModel]") -> None:
        try:
            found[model] = by(t, y, u0, step_time)
        except NotIdentifiable as refusal:
            refusals.append(f"{MODELS[model]}: {refusal}")

    if arguments.model in (None, "first"):
        fit("first", fit_first_order)
    if arguments.model in (None, "second"):
        fit("second", fit_second_order)
    if arguments.model == "yaw" or (arguments.model is None and not found):
        fit("yaw", fit_yaw)  # which holds both as corner cases: asked where neither holds
    if not found:
        hint = "; of an aircraft that also rolls, replay a 3-2-1-1: yawid replay"
        raise NotIdentifiable("; ".join(refusals) + hint)
    model = min(found, key=lambda name: found[name].noise_std)
    _print_step(model, found[model], arguments.json)
    return 0


def _print_step(model: str, fit: "StepModel", as_json: bool) -> None:
    from yawid.results.reports import StepReport, Told

    def told(name: str) -> Told:
        value = getattr(fit, name)
        return Told(value=float(value.value), std=float(value.std))

    report = StepReport(
        model=model,
        parameters={name: told(name) for name in PARAMETERS[model]},
        settling_2pct_s=told("settling_2pct_s"),
        settling_5pct_s=told("settling_5pct_s"),
        noise_std=float(fit.noise_std),
    )
    if as_json:
        tell_json(report.to_json())
        return
    tell(MODELS[model])
    for name, number in (report.parameters | {n: getattr(report, n) for n in SETTLING}).items():
        tell(f"  {name:<16} {number.value:.6g} ± {number.std:.2g}")


def _simulate(arguments: argparse.Namespace) -> int:
    from yawid.plant.excitation import Excitation
    from yawid.runs.simulate import simulate_to_file

    if not 1.0 <= arguments.rate <= 1000.0:
        raise ConfigError(f"--rate must lie in 1 to 1000 Hz, got {arguments.rate!r}")
    if not 1.0 / arguments.rate <= arguments.seconds <= MOST_SAMPLES / arguments.rate:
        least, most = 1.0 / arguments.rate, MOST_SAMPLES / arguments.rate
        raise ConfigError(
            f"--seconds must lie in {least:g} to {most:.0f} at {arguments.rate:g} Hz, "
            f"got {arguments.seconds!r}"
        )
    excitation = Excitation(
        kind=arguments.input,
        amplitude=arguments.amplitude,
        start_s=5.0 if arguments.seconds > 20.0 else 0.0,
        unit_s=arguments.unit,
        seed=arguments.seed,
    )
    simulate_to_file(
        arguments.plant,
        excitation,
        arguments.out,
        seconds=arguments.seconds,
        rate_hz=arguments.rate,
        noise_std=arguments.noise,
        seed=arguments.seed,
        force=arguments.force,
    )
    if str(arguments.out) != "-":
        tell(str(arguments.out))
    return 0
