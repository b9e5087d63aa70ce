"""Parts of a record fitted by themselves, to see whether it is one airframe in all of them.

A fit of a manoeuvre in which flaps moved lies between two airframes, and noise that it takes for
gusts explains the rest, so that its sigma does not show it. So the parts are fitted again from
where the fit ended: the two halves of a manoeuvre, or the manoeuvres of a fit over several. Each
half has half of the yaw motion. A few steps are enough, as every parameter is held loosely: what a
part does not show stays as it was, and does not differ.
"""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from yawid.lateral.criterion import Criterion
from yawid.lateral.fit import Fit, fit
from yawid.lateral.record import Record

HELD = 1.0
"""Sigma in scales by which a parameter of a part is held where the fit of the whole ended. Without
it half a manoeuvre, in which the rudder rests, has no fit."""


def parts_of(found: Fit) -> list[Fit]:
    """Return the fits of the parts; none where one of them has no predictor or does not settle."""
    try:
        fits = [fit(_part(found, record)) for record in _records(found.of.records)]
    except (np.linalg.LinAlgError, ValueError):  # a part without samples or without any motion
        return []
    return fits if all(each.settled for each in fits) else []


def _records(records: Sequence[Record]) -> Iterator[Record]:
    """Yield the records of several manoeuvres, and of a single one both halves."""
    if len(records) > 1:
        yield from records
        return
    [whole] = records
    energy = np.cumsum(whole.y[:, 1] ** 2)
    middle = int(np.searchsorted(energy, 0.5 * energy[-1]))
    for rows in (slice(0, middle), slice(middle, None)):
        of = whole.motion
        columns = {name: getattr(of, name)[rows] for name in ("p", "r", "roll", "pitch", "q")}
        start_s = of.commands_start_s - rows.start * of.sample_time_s
        yield Record(replace(of, commands_start_s=start_s, **columns))


def _part(found: Fit, record: Record) -> Criterion:
    """Return the criterion of a part, that begins where the fit of the whole ended."""
    part = copy.copy(found.of)
    part.records, part.fixed = [record], found.of.theta(found.x[None])[0]
    part.mean = part.fixed[part.free]
    part.spread = np.minimum(part.spread, HELD * part.scale)
    part.count = 3 * int(np.count_nonzero(~record.unused))
    return part
