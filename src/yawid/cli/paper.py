"""The commands that need no log: ``step`` (paper eq. 4-16) and ``simulate`` (eq. 17-23)."""

from pathlib import Path
from typing import Annotated, Any, Literal

from yawid.cli.options import AsJson, Force, command, said
from yawid.sinks.door import print_json, print_line

SETTLING = ("settling_2pct_s", "settling_5pct_s")
_PLANT = "yaw (eq. 22-23), lateral (eq. 21) or rigid-body (eq. 17-18)"
_INPUT = "step, impulse, doublet, 3211, prbs, sweep or multisine (default: 3211)"
_FORM = "its form (default: first or second order by the fit, yaw where neither holds)"
_COLUMNS = "columns t and y, and u if known; or t, r, rudder; - reads what simulate prints"


@command(
    "FILE.csv",
    "yawid step response.csv --u0 0.1\nyawid simulate yaw --input step --out - | yawid step -",
)
def step(
    file: Annotated[Path, said("FILE.csv", _COLUMNS)],
    *,
    model: Annotated[Literal["first", "second", "yaw"] | None, said("", _FORM)] = None,
    u0: Annotated[
        float | None, said("A", "height of the step (default: by column u, else 1)")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Fit the paper's models to a step response."""
    from yawid.runs.step import step_report

    words, report = step_report(file, model, u0)
    if as_json:
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


@command(
    "PLANT --out FILE",
    "yawid simulate lateral --input 3211 --noise 0.002 --out flight.tlog\n"
    "yawid simulate yaw --input step --out - | yawid step -",
)
def simulate(
    plant: Annotated[Literal["yaw", "lateral", "rigid-body"], said("PLANT", _PLANT)],
    *,
    out: Annotated[Path, said("FILE", "csv, tlog, mcap; -: csv to stdout")],
    input: Annotated[Any, said("KIND", _INPUT)] = "3211",
    amplitude: Annotated[float, said("RAD", "of the rudder (default: 0.05)")] = 0.05,
    seconds: Annotated[float, said("N", "length (default: 120)")] = 120.0,
    rate: Annotated[float, said("HZ", "samples (default: 50)")] = 50.0,
    noise: Annotated[float, said("RAD/S", "of the yaw rate, white (default: 0)")] = 0.0,
    force: Force = False,
) -> int:
    """Fly a reference plant of the paper to a file."""
    from yawid.runs.simulate import simulate_to_file

    numbers = {"amplitude": amplitude, "seconds": seconds, "rate_hz": rate, "noise_std": noise}
    simulate_to_file(plant, input, out, **numbers, force=force)
    if str(out) != "-":
        print_line(str(out))
    return 0
