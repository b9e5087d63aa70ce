"""A manoeuvre's samples out of a run's rows, and its answering model fitted again.

A run's file holds the sigma of theta but not its covariance, which every band needs; the fit from
the same samples gives it, and shows that the file can be replayed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, Final, NamedTuple

import numpy as np
from msgspec.structs import astuple

from yawid.answers.model_parts import Fit
from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Bools, Floats, SampleBlock
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.estimation.fit import fit_percent, simulate
from yawid.estimation.grids import Narrow, as_held, narrowed
from yawid.estimation.methods import METHODS
from yawid.estimation.record_fit import FittedModel, fit_record
from yawid.models.fitted import Judged, Model

_AWAY_NS: Final = 2_000_000_000


class Columns(NamedTuple):
    """The samples (n,) of a manoeuvre by SampleBlock's names; t in s since boot, u (n, inputs)."""

    t_s: Floats
    u: Floats
    y: Floats
    turn_rate: Floats
    aileron: Floats
    rudder_moves: Floats


@dataclass(frozen=True, slots=True)
class Drawn:
    """A manoeuvre, its final model, and the samples that the model was fitted to.

    ``turn_rate`` (n,) is the turn rate in rad/s that bank and airspeed imply. ``fit`` says how well
    the model fits; of other orders than the manoeuvre's own, nothing is known of held-back samples.
    """

    found: Manoeuvre
    model: Model
    judged: Judged
    turn_rate: Floats
    fit: Fit


class Rows:
    """The samples of one manoeuvre, taken from the blocks of a run."""

    def __init__(self, found: Manoeuvre) -> None:
        self.found = found
        self._parts: list[Columns] = []
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
            others = (getattr(samples, name)[rows] for name in Columns._fields[1:])
            self._parts.append(Columns(t[rows], *others))

    def columns(self) -> Columns | None:
        """Return the samples, or None where the run has none."""
        if not self._parts:
            return None
        return Columns(*(np.concatenate(each) for each in zip(*self._parts, strict=True)))

    def drawn(
        self,
        config: RunConfig,
        sample_time_s: float,
        orders: Sequence[int] | None = None,
        turn: float = 0.0,
    ) -> Drawn | None:
        """Fit the manoeuvre by the method that answered it, with its own or other orders.

        The output is less ``turn`` times the turn rate, or as it was for 0. Return None where the
        fit fails or the manoeuvre has no answer.
        """
        answer, columns = self.found.answer, self.columns()
        if answer is None or columns is None:
            return None
        t, u, y, turn_rate, aileron, moves = columns
        own = astuple(answer.orders)
        asked: dict[str, Any] = {"orders": tuple(orders or own), "inputs": tuple(self.found.inputs)}
        u = u[:, : len(self.found.inputs)]
        if u.shape[1] < len(self.found.inputs):
            u = np.column_stack([u, aileron])
        if turn:
            y = y - turn * turn_rate
        elif self.found.turn_removed and config.turn == "keep":
            y = y - turn_rate
        tried = self.found.answering_try
        if tried is not None and tried.band_hz is not None:
            low_hz, high_hz = tried.band_hz
            every = round(answer.sample_time_s / sample_time_s)
            u, y = narrowed(u, y, sample_time_s, Narrow((low_hz, high_hz), every))
            t, turn_rate = t[::every][: len(y)], turn_rate[::every][: len(y)]
            sample_time_s, moves = every * sample_time_s, np.zeros(len(y))
        try:
            fitting = replace(config, **asked, memory=None, forgetting=1.0)
            fit = fitting.estimator(config.method, sample_time_s)
        except ConfigError:
            return None
        good = np.isfinite(y) & np.isfinite(u).all(axis=1)
        u, y = np.where(good[:, None], u, np.nan), np.where(good, y, np.nan)
        held = as_held(u, moves == 1.0)
        fitted: FittedModel = fit_record(fit, held, y, method=answer.method)
        if not np.isfinite(fitted.covariance).all() or not np.isfinite(fitted.theta).all():
            return None
        theta, same = fitted.theta, fitted.theta.tolist() == list(answer.theta.values())
        if METHODS[answer.method].runs_free:
            simulated = fitted.y_hat
        else:
            simulated = simulate(theta, fit.orders, fit.bias, held, y)
        model = Model(theta, fitted.covariance, fit.orders, sample_time_s, same)
        judged = Judged(t, u, y, fitted.y_hat, simulated, y - fitted.y_hat)
        how_well = answer.fit
        if asked["orders"] != own or turn:
            one_step, free = fit_percent(y, fitted.y_hat), fit_percent(y, simulated)
            how_well = Fit(one_step, free, whiteness_p=fitted.whiteness_p)
        return Drawn(self.found, model, judged, turn_rate, how_well)
