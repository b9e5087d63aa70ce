"""The manoeuvres that the report draws: their samples, and the answering model fitted again.

The file holds the sigma of theta but not its covariance, which every band needs; the fit gives it.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Bools, Floats, Ints, SampleBlock
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.estimation.fit import simulate
from yawid.estimation.methods import METHODS
from yawid.estimation.record_fit import fit_record
from yawid.report.model_data import Judged, Model
from yawid.results.narrow import Narrow, narrowed
from yawid.results.reasons import KINDS

MOST_DRAWN: Final = 4
"""The largest number of manoeuvres with a picture: nobody looks at a hundred pictures."""
_AWAY_NS: Final = 2_000_000_000


@dataclass(frozen=True, slots=True)
class Drawn:
    """A manoeuvre, its final model, and the samples that the model was fitted to."""

    found: Manoeuvre
    model: Model
    judged: Judged


def to_draw(manoeuvres: Sequence[Manoeuvre], used: Container[int]) -> list[Manoeuvre]:
    """Return the manoeuvres to draw, the best first.

    Those ``used`` for the flight come first, then those with fewer fatal reasons and with reasons
    further down the table of reasons. Among equals the higher simulated fit comes first, or the
    lower number where a manoeuvre is not usable.
    """
    ranks = {id_: rank for rank, id_ in enumerate(KINDS)}

    def worth(each: Manoeuvre) -> tuple[bool, tuple[int, ...], float]:
        fit = None if each.answer is None else each.answer.fit.simulation_pct
        told = each.n if fit is None or not each.verdict.usable else -fit
        fatal = [ranks.get(reason.id, 0) for reason in each.verdict.fatal]
        against = (len(fatal), *(-rank for rank in fatal))
        return each.n not in used, against, told

    return sorted((each for each in manoeuvres if each.answer is not None), key=worth)[:MOST_DRAWN]


class Rows:
    """The samples of one manoeuvre, taken from the blocks of a run."""

    def __init__(self, found: Manoeuvre) -> None:
        self.found = found
        self._parts: list[tuple[Ints | Floats, ...]] = []
        try:
            begin = datetime.fromisoformat(found.date or "").timestamp()
        except ValueError:  # a record without a date, or a file that somebody has changed
            begin = np.nan
        self._from_ns = begin * 1e9 - _AWAY_NS
        self._to_ns = (begin + found.duration_s) * 1e9 + _AWAY_NS

    def add(self, samples: SampleBlock) -> None:
        """Take the manoeuvre's samples from a block; another boot may have the same seconds."""
        t = samples.boot_us / 1e6
        # A tolerance of a thousandth of a sample, since the summary's seconds are rounded.
        near = 1e-3 * samples.sample_time_s
        rows: Bools = (t >= self.found.from_s - near) & (t <= self.found.to_s + near)
        if np.isfinite(self._from_ns):
            rows &= (samples.unix_ns >= self._from_ns) & (samples.unix_ns <= self._to_ns)
        if rows.any():
            names = ("u", "y", "turn_rate", "aileron")
            self._parts.append((t[rows], *(getattr(samples, name)[rows] for name in names)))

    def drawn(self, config: RunConfig, sample_time_s: float) -> Drawn | None:
        """Fit the manoeuvre by the method that answered it; return None where that fails."""
        answer = self.found.answer
        if answer is None or not self._parts:
            return None
        t, u, y, turn, aileron = (np.concatenate(c) for c in zip(*self._parts, strict=True))
        orders = answer.orders.na, answer.orders.nb, answer.orders.nc, answer.orders.nk
        fits = replace(config, inputs=tuple(self.found.inputs), memory=None, forgetting=1.0)
        u = u[:, : len(self.found.inputs)]
        if u.shape[1] < len(self.found.inputs):
            u = np.column_stack([u, aileron])
        if self.found.turn_removed and config.turn == "keep":
            y = y - turn
        tried = self.found.answering_try
        if tried is not None and tried.band_hz is not None:
            low_hz, high_hz = tried.band_hz
            every = round(answer.sample_time_s / sample_time_s)
            u, y = narrowed(u, y, sample_time_s, Narrow((low_hz, high_hz), every))
            t, sample_time_s = t[::every][: len(y)], every * sample_time_s
        try:
            fit = replace(fits, orders=orders).estimator(config.method, sample_time_s)
        except ConfigError:
            return None
        good = np.isfinite(y) & np.isfinite(u).all(axis=1)
        u, y = np.where(good[:, None], u, np.nan), np.where(good, y, np.nan)
        fitted = fit_record(fit, u, y, method=answer.method)
        if not np.isfinite(fitted.covariance).all() or not np.isfinite(fitted.theta).all():
            return None
        theta, same = fitted.theta, fitted.theta.tolist() == list(answer.theta.values())
        if METHODS[answer.method].runs_free:
            simulated = fitted.y_hat
        else:
            simulated = simulate(theta, fit.orders, fit.bias, u, y)
        model = Model(theta, fitted.covariance, fit.orders, sample_time_s, same)
        return Drawn(self.found, model, Judged(t, u, y, fitted.y_hat, simulated, y - fitted.y_hat))
