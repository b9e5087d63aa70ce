"""A manoeuvre's samples out of a run's rows, and what a model with known poles makes of them.

They are those of the fit, and so are the responses (:mod:`yawid.physics.responses`). Initial
states, one for each pole and each run without a gap, and the bias are solved by least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Final

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Bools, Floats, SampleBlock, runs_of
from yawid.config.run import RunConfig
from yawid.models.answered import Answered
from yawid.physics.frequency_response import frequency_response
from yawid.physics.modes import Complexes
from yawid.physics.responses import Blocks, Record, averaged, inputs_and_rate

_AWAY_NS: Final = 2_000_000_000
SEGMENTS: Final = 4
"""Segments without overlap into which a manoeuvre is cut for its coherence."""


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
        poles, residues = model.halves()
        forced, free = self._responses(poles)
        twice = np.where(poles.imag > 0.0, 2.0, 1.0)
        answer = np.einsum("nim,im->n", forced, residues * twice).real
        found = np.full(len(self.y), np.nan)
        rest = np.linalg.lstsq(free, self.y[self.known] - answer)[0]
        found[self.known] = answer + free @ rest
        return replace(self, simulated=found)

    def coherence(self, w: Floats) -> Floats:
        """Return the squared coherence (k,) of y and simulated at ``w`` (k,); NaN if too short."""
        y, simulated = self.y[self.longest], self.simulated[self.longest]
        if len(y) < 8 * SEGMENTS or not np.ptp(simulated) > 0.0:
            return np.full(len(w), np.nan)
        length_s = len(y) // SEGMENTS * self.sample_time_s
        found = frequency_response(simulated, y, self.sample_time_s, length_s)
        at = 2.0 * np.pi * found.frequency_hz
        return np.interp(w, at, found.coherence, left=np.nan, right=np.nan)

    def explained_by_rudder(self, poles: Complexes, y: Floats) -> Complexes:
        """Return the residues (m,) with which the rudder explains another output y (n,) best."""
        forced, free = self._responses(poles)
        x, pairs = forced[:, 0], poles.imag > 0.0
        parts = np.concatenate([x.real * np.where(pairs, 2.0, 1.0), -2.0 * x.imag[:, pairs]], 1)
        y = y[self.known]
        known = np.isfinite(y)
        found = np.linalg.lstsq(np.column_stack([parts, free])[known], y[known])[0]
        residues: Complexes = found[: len(poles)].astype(complex)
        residues[pairs] += 1j * found[len(poles) : parts.shape[1]]
        return residues

    def _responses(self, poles: Complexes) -> tuple[Complexes, Floats]:
        """Return the forced responses (k, inputs, m), and a column (k,) for each free part.

        Their rows are the k samples that are no gap.
        """
        record = Record.of(self.sample_time_s, self.held, self.y)
        found = Blocks(record, 1, least=1).responses(poles)
        free = [r.free.real for r in found]
        free += [r.free.imag for r, p in zip(found, poles, strict=True) if p.imag > 0.0]
        bias = np.ones(np.count_nonzero(self.known))
        return np.stack([r.forced for r in found], axis=2), np.column_stack([*free, bias])


class Rows:
    """The samples of one manoeuvre, taken from the blocks of a run."""

    def __init__(self, found: Manoeuvre) -> None:
        self.found = found
        self._parts: list[SampleBlock] = []
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
            self._parts.append(samples.select(rows))

    def flown(self, config: RunConfig) -> Flown | None:
        """Return the samples; None where the run has none."""
        if not self._parts:
            return None
        samples, found = SampleBlock.joined(self._parts), self.found
        if config.output == "yaw":
            samples = averaged(samples, measured=config.rudder_is == "measured")
        u, held, y = inputs_and_rate(
            samples,
            found.inputs,
            measured=config.rudder_is == "measured",
            turn_removed=found.turn_removed and config.turn == "keep",
        )
        t, turn_rate = samples.boot_us / 1e6, samples.turn_rate
        return Flown(found, samples.sample_time_s, t, u, held, y, turn_rate)


def flown_in(rows: Sequence[Rows], config: RunConfig) -> list[Flown]:
    """Return the manoeuvres that have samples."""
    return [flown for each in rows if (flown := each.flown(config)) is not None]
