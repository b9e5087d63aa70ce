"""``yawid step``: the paper's models fitted to a measured step response (eq. 4-16, 23)."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from yawid.answers.reports import StepReport, Told
from yawid.errors import NotIdentifiable

if TYPE_CHECKING:
    from yawid.offline.step_response import FirstOrder, SecondOrder, YawStep

    StepModel = FirstOrder | SecondOrder | YawStep

MODELS = {
    "first": "first order (eq. 4)",
    "second": "second order (eq. 7)",
    "yaw": "yaw rate (eq. 23)",
}
_PARAMETERS = {
    "first": ("K", "T"),
    "second": ("k", "D", "q"),
    "yaw": ("K", "T_theta_s", "omega_beta", "xi_beta"),
}


def step_report(
    file: Path, model: str | None, u0: float | None, step_time: float | None
) -> StepReport:
    """Return the model of the step response in a file: ``model``, or the one that fits best.

    ``u0`` is the height of the step and ``step_time`` its time in s. Where one is None it is read
    from the column u, and without such a column is 1 or 0 s.

    Raises:
        NotIdentifiable: no model fits.
        SourceError: the file cannot be read.
    """
    from yawid.offline.step_response import fit_first_order, fit_second_order, fit_yaw, read_step

    t, y, u0, step_time = read_step(file, u0, step_time)
    found: dict[str, StepModel] = {}
    refusals = []

    def fit(name: str, by: "Callable[..., StepModel]") -> None:
        try:
            found[name] = by(t, y, u0, step_time)
        except NotIdentifiable as refusal:
            refusals.append(f"{MODELS[name]}: {refusal}")

    if model in (None, "first"):
        fit("first", fit_first_order)
    if model in (None, "second"):
        fit("second", fit_second_order)
    if model == "yaw" or (model is None and not found):
        fit("yaw", fit_yaw)  # it contains both others as special cases: used where neither fits
    if not found:
        hint = "; for an aircraft that also rolls use a 3-2-1-1 and yawid replay"
        raise NotIdentifiable("; ".join(refusals) + hint)
    best = min(found, key=lambda name: found[name].noise_std)

    def number(name: str) -> Told:
        value = getattr(found[best], name)
        return Told(value=float(value.value), std=float(value.std))

    return StepReport(
        model=best,
        parameters={name: number(name) for name in _PARAMETERS[best]},
        settling_2pct_s=number("settling_2pct_s"),
        settling_5pct_s=number("settling_5pct_s"),
        noise_std=float(found[best].noise_std),
    )
