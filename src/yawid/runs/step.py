"""``yawid step``: the paper's models fitted to a measured step response (eq. 4-16, 23)."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from yawid.answers.reports import StepReport
from yawid.blocks import Floats
from yawid.errors import ConfigError, NotIdentifiable, SourceError
from yawid.sources.records.tables import CsvTable


def step_report(file: Path, model: str | None, u0: float | None) -> tuple[str, StepReport]:
    """Return the model of the step response in a file: ``model``, or the one that fits best.

    The first of both is its name in words.

    ``u0`` is the height of the step. Where it is None it is read from the column u, as is the
    time of the step; without such a column they are 1 and 0 s.

    Raises:
        NotIdentifiable: no model fits.
        SourceError: the file cannot be read.
    """
    from yawid.offline.step_response import FORMS, fit_step

    t, y, u0, step_time = read_step(file, u0)
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


def read_step(path: Path, u0: float | None = None) -> tuple[Floats, Floats, float, float]:
    """Return t (n,) in s, y (n,), and the step's height and time in s, of a CSV file (-: stdin).

    It has the columns t and y, and u where it was recorded. Its time, and its height if that is not
    given, are taken from u; without u they are 0 s and 1. The columns r and rudder of a flight
    record count as y and u. An empty y is NaN.

    Raises:
        SourceError: the file cannot be read or is not text.
        ConfigError: a column t or y is missing, a value is not a number, or u is not one step.
    """
    try:
        t, y, *more = _columns(path)
    except SourceError as error:
        if isinstance(error.__cause__, OSError | UnicodeError):
            raise
        raise ConfigError(str(error)) from error
    height, time_s = 1.0, 0.0
    if more:
        changes = np.flatnonzero(np.diff(more[0], prepend=0.0))
        if len(changes) != 1:
            raise ConfigError(
                f"{path}: column u changes {len(changes)} times, and a step is one change from 0: "
                "cut the record before the next one, or leave u out and give --u0"
            )
        height, time_s = float(more[0][changes[0]]), float(t[changes[0]])
    return t, y, height if u0 is None else u0, time_s


def _columns(path: Path) -> list[Floats]:
    """Return t (n,), y (n,) and, where it was recorded, u (n,)."""
    with TemporaryDirectory() as folder:
        if str(path) == "-":
            path = Path(folder, "stdin")
            path.write_bytes(sys.stdin.buffer.read())
        table = CsvTable(path)
        names = [name.strip().lower() for name in table.names]
        roles = ("t",), ("y", "r"), ("u", "rudder")
        columns = [next((each for each in role if each in names), "") for role in roles]
        if any(names.count(each) != 1 for each in columns[:2]):
            raise ConfigError(f"{path}: the header must name one column t and one y: {names}")
        places = [names.index(each) for each in columns if each]
        table.load(places)
        return [table.numbers(place) for place in places]
