"""The data of the panels that are derived from blocks, and not their values themselves.

These are the lanes of states, the z plane, the Dutch roll of the methods other than the primary
one, and the whiteness of residuals. Rows are chosen by the grid's index, and the state kept between
blocks does not depend on them: the picture is the same however the stream was cut into blocks.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import EstimateBlock, Floats, Held, Ints, Noted, SampleBlock, Status, words
from yawid.physics.modes import modes, orders_of, poles_of
from yawid.sinks.base import Grid
from yawid.sinks.palette import BAD, CARE, GOOD, NEUTRAL

PLANE_S = 2.0
OTHERS_S = 0.5
WHITENESS_S = 20.0
WINDOW_S = 60.0
LAGS = 20
USED = "used"
_STATUS = {
    Status.WARMING_UP: CARE,
    Status.TRACKING: GOOD,
    Status.HELD: NEUTRAL,
    Status.DIVERGED: BAD,
}
_NOTED = {
    Noted.SATURATED: "rudder at its stop",
    Noted.AIRSPEED_CHANGED: "airspeed changed",
    Noted.NOT_EXCITED: "not excited",
}


@dataclass(frozen=True, slots=True)
class Change:
    """A change of state: from ``row`` of the block on, a lane is in ``state``."""

    lane: str
    row: int
    state: str
    colour: str


@dataclass(frozen=True, slots=True)
class Plane:
    """Poles (n, na) and zeros (n, nb - 1) of the first input, at ``rows`` (n,) of the block."""

    rows: Ints
    poles: NDArray[np.complex128]
    zeros: NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Rolls:
    """Dutch rolls (n, 2), wn in rad/s and zeta, at ``rows`` (n,) of the block."""

    rows: Ints
    dutch_roll: Floats


@dataclass(frozen=True, slots=True)
class Whiteness:
    """The autocorrelation (LAGS,) of the newest residuals at a row, from lag 1, and its 2 sigma."""

    row: int
    correlation: Floats
    bound: float


class Marks:
    """The derivation of these panels' data for one run, block after block."""

    def __init__(self, grid: Grid) -> None:
        self._mode_name = grid.mode_name
        self._orders = orders_of(grid.parameters)
        self._na, [self._nb] = self._orders.na, self._orders.nb
        self._sample_time_s = grid.sample_time_s
        self._rolls_step = max(1, round(OTHERS_S / grid.sample_time_s))
        self._plane_step = max(1, round(PLANE_S / grid.sample_time_s))
        self._white_step = max(1, round(WHITENESS_S / grid.sample_time_s))
        self._window = max(4 * LAGS, round(WINDOW_S / grid.sample_time_s))
        self._residuals = np.empty(0)
        self._states: dict[str, str] = {}

    def changes(self, samples: SampleBlock, estimate: EstimateBlock) -> Iterator[Change]:
        """Yield the changes of every lane within the block; the run's first row is always one."""
        # An unknown mode is NaN, which is never equal to itself.
        modes = np.nan_to_num(samples.mode, nan=-1.0)
        codes = np.column_stack([samples.held, estimate.status, samples.noted, modes])
        for row in [0, *(np.flatnonzero((codes[1:] != codes[:-1]).any(axis=1)) + 1).tolist()]:
            held, status, noted = (int(code) for code in codes[row, :3])
            text = _sample_text(held, noted)
            noted_colour = GOOD if text == USED else CARE
            now = {
                "estimator": (words(Status(status)), _STATUS[Status(status)]),
                "samples": (text, NEUTRAL if held else noted_colour),
                "flight_mode": (self._mode_name(samples.mode[row]), NEUTRAL),
            }
            for lane, (state, colour) in now.items():
                if self._states.get(lane) != state:
                    self._states[lane] = state
                    yield Change(lane, row, state, colour)

    def plane(self, samples: SampleBlock, estimate: EstimateBlock) -> Plane:
        """Return poles and zeros every ``PLANE_S``; NaN where there is none."""
        live = estimate.status != Status.WARMING_UP
        rows = np.flatnonzero((samples.k % self._plane_step == 0) & live)
        theta = estimate.theta[rows]
        b = theta[:, self._na : self._na + self._nb]
        with np.errstate(divide="ignore", invalid="ignore"):
            monic = b[:, 1:] / b[:, :1]
        poles, zeros = (poles_of(each, 1.0).z for each in (theta[:, : self._na], monic))
        return Plane(rows, poles, zeros)

    def rolls(
        self, samples: SampleBlock, estimate: EstimateBlock, known: NDArray[np.bool_]
    ) -> Rolls:
        """Return the Dutch roll of a method other than the primary one, every ``OTHERS_S``.

        Its sigma is not computed. Therefore it is given where the primary method's Dutch roll is
        ``known`` (n,), else it is NaN, which leaves a gap in the line.
        """
        live = estimate.status != Status.WARMING_UP
        rows = np.flatnonzero((samples.k % self._rolls_step == 0) & live)
        there = EstimateBlock(estimate.without_covariance[rows], estimate.p)
        found = modes(there, self._orders, self._sample_time_s).dutch_roll[:, ::2]
        return Rolls(rows, np.where(known[rows, None], found, np.nan))

    def whiteness(self, samples: SampleBlock, estimate: EstimateBlock) -> list[Whiteness]:
        """Return the autocorrelation of the residuals of ``WINDOW_S``, every ``WHITENESS_S``."""
        before = len(self._residuals)
        residuals = np.concatenate([self._residuals, estimate.residual])
        due = np.flatnonzero(samples.k % self._white_step == 0).tolist()
        found = [self._white(residuals[: before + row + 1], row) for row in due]
        self._residuals = residuals[-self._window :].copy()
        return [white for white in found if white is not None]

    def _white(self, residuals: Floats, row: int) -> Whiteness | None:
        newest = residuals[-self._window :]
        newest = newest[np.isfinite(newest)]
        if len(newest) < 4 * LAGS:
            return None
        centred = newest - newest.mean()
        power = float(centred @ centred)
        if not power > 0.0:
            return None
        n = len(centred)
        products = [float(centred[lag:] @ centred[: n - lag]) for lag in range(1, LAGS + 1)]
        return Whiteness(row, np.array(products) / power, 2.0 / math.sqrt(n))


def _sample_text(held: int, noted: int) -> str:
    if held:
        return f"held: {', '.join(words(flag) for flag in Held if held & flag)}"
    return ", ".join([USED, *(text for flag, text in _NOTED.items() if noted & flag)])
