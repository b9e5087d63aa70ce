"""``yawid step``: the paper's models fitted to a measured step response (eq. 4-16, 23)."""

from pathlib import Path

from yawid.answers.reports import StepReport
from yawid.errors import NotIdentifiable

MODELS = {
    "first": "first order (eq. 4)",
    "second": "second order (eq. 7)",
    "yaw": "yaw rate (eq. 23)",
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
    found, refusals = list[StepReport](), []
    fits = {"first": fit_first_order, "second": fit_second_order, "yaw": fit_yaw}
    for name, fit in fits.items():
        # Eq. 23 contains both other forms as special cases: it is used where neither fits.
        if model == name or (model is None and (name != "yaw" or not found)):
            try:
                found.append(fit(t, y, u0, step_time))
            except NotIdentifiable as refusal:
                refusals.append(f"{MODELS[name]}: {refusal}")
    if not found:
        hint = "; for an aircraft that also rolls use a 3-2-1-1 and yawid replay"
        raise NotIdentifiable("; ".join(refusals) + hint)
    return min(found, key=lambda each: each.noise_std)
