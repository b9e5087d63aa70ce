"""What a fit sees of a manoeuvre, and the exact responses of poles over blocks of its samples.

Fit, pictures and models take the same samples of it, in this way.

A pole p answers an input u by x' = p x + u. Over one sample of Ts seconds

    x(k+1) = E x(k) + (E - 1) / p u(k),   E = exp(p Ts)

without error, at every rate, for an input that is held over each sample; ``as_held`` makes such a
one of an input that moves within its samples. A block of q samples has the mean of x over its
instants, so that measurement and model are averaged alike and a fit does not depend on the rate:
with L = E^q and the input of the block's samples in a row, U,

    x(K+1) = L x(K) + U d,   mean(K) = a x(K) + U b,   a = (1 + E + ... + E^(q-1)) / q

Each response comes with its derivative by p, which is one more filter of the same pole. A gap ends
a run, and each run has an initial state of its own: the free response is a L^K.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from yawid.blocks import Bools, Floats, Ints, SampleBlock, runs_of
from yawid.estimation.all_pole import all_pole
from yawid.estimation.grids import as_held
from yawid.physics.modes import Complexes

LEAST_BLOCKS: Final = 8
"""The least length of a run in blocks: each run has free initial states of its own, three in most
structures, which explain a shorter one whatever the poles are. By counting; on no flights."""


@dataclass(frozen=True, slots=True)
class Record:
    """A manoeuvre on one grid: inputs ``u`` (n, inputs) and outputs ``y`` (n, outputs).

    The outputs are the yaw rate in rad/s and, where there are two, roll in rad. ``u`` is held over
    the sample that follows its instant, as :func:`yawid.estimation.grids.as_held` returns it.
    ``runs`` (runs, 2) are the rows at which each run begins and ends. All have mean 0.
    """

    sample_time_s: float
    u: Floats
    y: Floats
    runs: Ints

    @classmethod
    def of(cls, sample_time_s: float, u: Floats, *outputs: Floats) -> "Record":
        """Return the record of u (n, inputs) and outputs (n,) each; a row with NaN is a gap."""
        y = np.stack(outputs, axis=1)
        good: Bools = np.isfinite(np.concatenate([u, y], axis=1)).all(axis=1)
        rows = max(np.count_nonzero(good), 1)
        u, y = (np.where(good[:, None], x - x[good].sum(axis=0) / rows, 0.0) for x in (u, y))
        return cls(sample_time_s, u, y, runs_of(good))

    @property
    def seconds(self) -> float:
        """The time in s that the runs last together."""
        return float(np.diff(self.runs).sum()) * self.sample_time_s


def inputs_and_rate(
    samples: SampleBlock,
    inputs: Sequence[str],
    *others: Floats,
    measured: bool,
    turn_removed: bool,
) -> tuple[Floats, Floats, Floats]:
    """Return the inputs (n, inputs) as a fit takes them, the same as held, and the yaw rate (n,).

    They are the rudder and, with two ``inputs``, the aileron; what is ``measured`` moves within
    every sample. With ``turn_removed`` the yaw rate is less the turn that the bank makes. A row
    that lacks one of them or of the ``others`` (n,) is a gap: there all three are NaN.
    """
    y = samples.y - samples.turn_rate if turn_removed else samples.y
    u = np.column_stack([samples.u[:, 0], samples.aileron])[:, : len(inputs)]
    good = np.isfinite(np.column_stack([u, y, *others])).all(axis=1)
    u, y = np.where(good[:, None], u, np.nan), np.where(good, y, np.nan)
    return u, as_held(u, (samples.rudder_moves == 1.0) | measured), y


def averaged(samples: SampleBlock, *, measured: bool) -> SampleBlock:
    """Return samples whose y is a mean since the sample before, with all else averaged alike.

    Such a y is the response to means of the inputs, which go on a line from one sample to the next:
    they move within every sample. The first sample after a gap has none.
    """
    moves = (samples.rudder_moves == 1.0) | measured
    u = as_held(np.column_stack([samples.u, samples.aileron]), moves)
    every = np.column_stack([u, samples.roll])
    every[1:] = 0.5 * (every[1:] + every[:-1])
    every[0] = np.nan
    u, aileron, roll = every[:, :-2], every[:, -2], every[:, -1]
    y = np.where(np.isfinite(u[:, 0]), samples.y, np.nan)
    return replace(samples, rudder_moves=np.ones(len(u)), y=y, u=u, aileron=aileron, roll=roll)


class Response(NamedTuple):
    """The responses of 1 / (s - p) over N blocks: to each input (N, inputs), free (N, runs).

    ``forced_slope`` and ``free_slope`` are their derivatives by p.
    """

    forced: Complexes
    forced_slope: Complexes
    free: Complexes
    free_slope: Complexes


class Blocks:
    """A record in blocks of ``q`` samples: outputs ``y`` (N, outputs), ``runs`` (runs, 2) of them.

    Runs of fewer than ``least`` blocks are left out. ``rows`` (N q,) are the samples in blocks.
    """

    def __init__(self, record: Record, q: int, least: int = LEAST_BLOCKS) -> None:
        self.record, self.q = record, q
        self.step_s = q * record.sample_time_s
        counts = [(a, (b - a) // q) for a, b in record.runs.tolist()]
        counts = [(a, n) for a, n in counts if n >= least]
        ends = np.cumsum([0, *(n for _, n in counts)])
        self.runs = np.stack([ends[:-1], ends[1:]], axis=1)
        rows = [np.arange(a, a + n * q) for a, n in counts]
        self.rows = np.concatenate([np.empty(0, np.int64), *rows])
        at = self.rows.reshape(-1, q)
        self.y: Floats = record.y[at].mean(axis=1)
        self.u: Floats = record.u[at].transpose(2, 0, 1)

    def __len__(self) -> int:
        return len(self.y)

    def each(self) -> Iterator[slice]:
        """Yield the blocks of each run."""
        return (slice(a, b) for a, b in self.runs.tolist())

    def weights(self, p: Complexes) -> tuple[Complexes, Complexes]:
        """Return (L, a) and (d, b) of poles p (m,), each followed by its derivatives by p.

        The first are (4, m), the second ones (4, m, q).
        """
        Ts, q, i = self.record.sample_time_s, self.q, np.arange(self.q)
        E, p = np.exp(p * Ts), p[:, None]
        powers = np.exp(p * (i * Ts))
        slopes = i * Ts * powers
        parts = np.stack([powers, slopes])
        # for mean: the powers that an input has had by each row of its block, summed
        summed = np.zeros(parts.shape, complex)
        np.cumsum(parts[:, :, :-1], axis=2, out=summed[:, :, 1:])
        (d, d_slope), (b, b_slope) = parts[:, :, ::-1], summed[:, :, ::-1] / q
        gain = np.expm1(p * Ts) / p
        gain_slope = (Ts * E[:, None] - gain) / p
        wide = [
            d * gain,
            b * gain,
            d_slope * gain + d * gain_slope,
            b_slope * gain + b * gain_slope,
        ]
        L, (a, a_slope) = E**q, parts.mean(axis=2)
        return np.stack([L, a, self.step_s * L, a_slope]), np.stack(wide)

    def responses(self, poles: Complexes) -> list[Response]:
        """Return the responses of each of the poles (m,)."""
        own, wide = self.weights(poles)
        seen = self.u @ wide.reshape(-1, wide.shape[2]).T.copy().view(np.float64)
        moved = seen.view(np.complex128).reshape(*self.u.shape[:2], 4, len(poles))
        return [
            self._response(p, own[:, i], moved[:, :, :, i].T) for i, p in enumerate(poles.tolist())
        ]

    def _response(self, p: complex, own: Complexes, moved: Complexes) -> Response:
        L, a, L_slope, a_slope = own.tolist()
        drive, mean, drive_slope, mean_slope = moved
        x, slope = np.empty_like(mean), np.empty_like(mean)
        free, free_slope = np.zeros((2, len(self), len(self.runs)), complex)
        for run, each in enumerate(self.each()):
            x[each] = _one_pole(L, drive[each])
            slope[each] = _one_pole(L, L_slope * x[each] + drive_slope[each])
            t = np.arange(each.stop - each.start) * self.step_s
            decay = np.exp(p * t)
            free[each, run] = a * decay
            free_slope[each, run] = (a_slope + a * t) * decay
        return Response(a * x + mean, a * slope + a_slope * x + mean_slope, free, free_slope)


def _one_pole(L: complex, drive: Complexes) -> Complexes:
    """Return x (n, m) of x(K+1) = L x(K) + drive(K), from x(0) = 0.

    A complex pole is filtered as a real pair: x(K+1) - 2 Re(L) x(K) + |L|^2 x(K-1) = drive(K) -
    conj(L) drive(K-1).
    """
    late = np.zeros((len(drive) + 1, drive.shape[1]), complex)
    late[2:] = drive[:-1]
    if L.imag == 0.0:
        return all_pole(np.array([-L.real]), late[1:].real).astype(complex)
    late = late[1:] - np.conj(L) * late[:-1]
    pair = np.array([-2.0 * L.real, abs(L) ** 2])
    found = all_pole(pair, np.concatenate([late.real, late.imag], axis=1))
    re, im = np.split(found, 2, axis=1)
    return re + 1j * im


def block_size(record: Record, wn_rad_s: float, per_period: int, least: int) -> int:
    """Return the samples of a block, of which a period has ``per_period`` and the record ``least``.

    Where both cannot be, the record has so many.
    """
    q = min(
        int(2.0 * math.pi / wn_rad_s / record.sample_time_s / per_period),
        int(np.diff(record.runs).sum()) // least,
        int(np.diff(record.runs).max()) // LEAST_BLOCKS,
    )
    return max(1, q)
