"""``yawid step``: the paper's models fitted to a measured step response (eq. 4-16, 23)."""

from pathlib import Path

from yawid.answers.reports import StepReport
from yawid.errors import NotIdentifiable


def step_report(
    file: Path, model: str | None, u0: float | None, step_time: float | None
) -> tuple[str, StepReport]:
    """Return the model of the step response in a file: ``model``, or the one that fits best.

    The first of both is its name in words.

    ``u0`` is the height of the step and ``step_time`` its time in s. Where one is None it is read
    from the column u, and without such a column is 1 or 0 s.

    Raises:
        NotIdentifiable: no model fits.
        SourceError: the file cannot be read.
    """
    from yawid.offline.step_response import FORMS, fit_step, read_step

    t, y, u0, step_time = read_step(file, u0, step_time)
    found, refusals = list[StepReport](), []
    for name, form in FORMS.items():
        # Eq. 23 contains both other forms as special cases: it is used where neither fits.
        if model == name or (model is None and (name != "yaw" or not found)):
            try:
                found.append(fit_step(name, t, y, u0, step_time))
            except NotIdentifiable as refusal:
                refusals.append(f"{form.words}: {refusal}")
    if not found:
        hint = "; for an aircraft that also rolls use a 3-2-1-1 and yawid replay"
        raise NotIdentifiable("; ".join(refusals) + hint)
    best = min(found, key=lambda each: each.noise_std)
    return FORMS[best.model].words, best
