"""A manoeuvre's samples out of a run's rows, and what a model with known poles makes of them.

They are those of the fit, and so are the responses (:mod:`yawid.manoeuvre.responses`). Initial
states, one for each pole and each run without a gap, and the bias are solved by least squares.
"""

from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Final

import numpy as np
from scipy import signal

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Bools, Floats, SampleBlock, runs_of
from yawid.config.run import RunConfig
from yawid.manoeuvre.responses import Blocks, Record, averaged, inputs_and_rate
from yawid.models.answered import Answered
from yawid.physics.modes import Complexes

_AWAY_NS: Final = 2_000_000_000
SEGMENTS: Final = 4
"""Segments without overlap into which a manoeuvre is cut for its coherence."""


def samples_of(found: Manoeuvre, samples: SampleBlock) -> SampleBlock:
    """Return a manoeuvre's samples, out of those of a run."""
    t, near = samples.boot_us / 1e6, 1e-3 * samples.sample_time_s  # its seconds are rounded
    rows: Bools = (t >= found.from_s - near) & (t <= found.to_s + near)
    if found.date is not None:  # another boot may have the same seconds
        begin_ns = datetime.fromisoformat(found.date).timestamp() * 1e9
        away_ns = np.abs(samples.unix_ns - begin_ns - 0.5e9 * found.duration_s)
        rows &= away_ns <= 0.5e9 * found.duration_s + _AWAY_NS
    return samples.select(rows)


@dataclass(frozen=True, slots=True)
class Flown:
    """A manoeuvre and its samples (n,), as the fit took them: NaN in ``u`` and ``y`` is a gap.

    ``t`` is in s since boot, ``u`` (n, inputs) the mean of each input over its sample, and ``held``
    (n, inputs) what acts like it when it is held. ``y`` is the yaw rate in rad/s, less
    ``turn_rate`` where the manoeuvre says so, and ``simulated`` that of its model, empty without
    one.
    """

    found: Manoeuvre
    sample_time_s: float
    t: Floats
    u: Floats
    held: Floats
    y: Floats
    turn_rate: Floats
    simulated: Floats = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(cls, found: Manoeuvre, samples: SampleBlock, config: RunConfig) -> "Flown | None":
        """Return a manoeuvre's samples, out of those of a run; None where it has none."""
        samples, measured = samples_of(found, samples), config.rudder_is == "measured"
        if not len(samples):
            return None
        if config.output == "yaw":
            samples = averaged(samples, measured=measured)
        turned = found.turn_removed and config.turn == "keep"
        u, held, y = inputs_and_rate(samples, found.inputs, measured=measured, turn_removed=turned)
        t, turn_rate = samples.boot_us / 1e6, samples.turn_rate
        return cls(found, samples.sample_time_s, t, u, held, y, turn_rate)

    @property
    def known(self) -> Bools:
        """The samples (n,) that are no gap."""
        return np.asarray(np.isfinite(self.y))

    @property
    def longest(self) -> slice:
        """The rows of the longest stretch without a gap."""
        runs = runs_of(self.known).tolist()
        return slice(*max(runs, key=lambda run: run[1] - run[0], default=(0, 0)))

    def with_model(self, model: Answered) -> "Flown":
        """Return it with the yaw rate of a model; NaN in a gap."""
        forced, free = self._responses(model.upper)
        found = np.full(len(self.y), np.nan)
        answer = forced @ model.x[model.order :]
        rest = np.linalg.lstsq(free, self.y[self.known] - answer)[0]
        found[self.known] = answer + free @ rest
        return replace(self, simulated=found)

    def coherence(self, w: Floats) -> Floats:
        """Return the squared coherence (k,) of y and simulated at ``w`` (k,); NaN if too short."""
        y, simulated = self.y[self.longest], self.simulated[self.longest]
        if len(y) < 8 * SEGMENTS or not np.ptp(simulated) > 0.0:
            return np.full(len(w), np.nan)
        rate = 2.0 * np.pi / self.sample_time_s
        at, found = signal.coherence(simulated, y, rate, nperseg=len(y) // SEGMENTS)
        return np.asarray(np.interp(w, at[1:], found[1:], left=np.nan, right=np.nan))

    def explained_by_rudder(self, poles: Complexes, y: Floats) -> Floats:
        """Return the residues with which the rudder explains another output y (n,) best.

        Of ``poles`` (m,), one of each pair, they are numbers as :class:`Answered` has them.
        """
        forced, free = self._responses(poles)
        n = forced.shape[1] // len(self.found.inputs)
        y = y[self.known]
        known = np.isfinite(y)
        found = np.linalg.lstsq(np.column_stack([forced[:, :n], free])[known], y[known])[0]
        return np.asarray(found[:n], np.float64)

    def _responses(self, poles: Complexes) -> tuple[Floats, Floats]:
        """Return columns (k,) for each input's residues' numbers, and for each free part.

        Their rows are the k samples that are no gap.
        """
        record = Record.of(self.sample_time_s, self.held, self.y)
        found = Blocks(record, 1, least=1).responses(poles)
        units = [
            (2.0, 2.0j) if pole.imag > 0.0 else (1.0,) for pole in poles
        ]  # 2 Re(R x) of a pair

        def columns(i: int) -> Floats:
            every = np.stack(
                [(own * x[i]).real for x, of in zip(found, units, strict=True) for own in of],
                axis=2,
            )
            return np.asarray(every.reshape(len(every), every.shape[1] * every.shape[2]))

        bias = np.ones(np.count_nonzero(self.known))
        return columns(0), np.column_stack([columns(2), bias])
