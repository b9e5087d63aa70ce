"""Vibration and noise above half the grid's rate: the error without a filter, and with ``--band``.

A plant of eq. 23 with wn * Ts = 0.25, whose rudder switches at any time, is measured at 50 or
200 Hz and sampled at 10 or 20 Hz: unfiltered, through a band-pass on the grid alone, and with a
low-pass before the grid as well, as ``--band`` does. The table has the mean error of wn in per
cent, ELS / RML.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.signal import cont2discrete, lfilter

from bench.table import head, line, options_of
from yawid.blocks import Floats, Held, SampleBlock
from yawid.channels.align import Aligner
from yawid.channels.conditioning import Conditioner, finer_by
from yawid.channels.series import Piece, Readings, Series
from yawid.channels.yaw_reader import ROW
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank
from yawid.physics.modes import modes

SECONDS, STEP_S = 120.0, 1e-3
OMEGA_TS, ZETA, LEAD_S = 0.25, 0.2, 0.8
SHARE = 0.1
"""Root mean square of the disturbance over that of the yaw rate."""
BAND = (0.004, 0.25)
"""Corner frequencies over the rate of the grid: a tenth and six times the natural frequency."""
WAYS = {"none": "no filter", "grid": "on the grid alone", "band": "`--band`"}
RATES = ((50.0, 10.0), (200.0, 20.0))
"""Rates of the messages and of the grid in Hz."""
TONE = 0.83
"""Frequency of the vibration over the rate of the grid."""
DISTURBANCES = ("nothing", "tone", "white noise")


def flight(wn: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return rudder and yaw rate (n,) at each millisecond.

    The rudder switches a quarter of a period after the last switch, on average.
    """
    n = round(SECONDS / STEP_S)
    waits = rng.uniform(0.2, 1.8, n // 50) * (0.5 * np.pi / wn)
    at = np.searchsorted(np.cumsum(waits), np.arange(n) * STEP_S)
    u = rng.choice([-0.3, 0.0, 0.3], len(waits) + 1)[at]
    numerator, denominator, _ = cont2discrete(
        ([LEAD_S * wn**2, wn**2], [1.0, 2.0 * ZETA * wn, wn**2]), STEP_S
    )
    y: Floats = lfilter(np.ravel(numerator), denominator, u)
    return u, y


def disturbed(y: Floats, t: Floats, kind: str, rate_hz: float, rng: np.random.Generator) -> Floats:
    """Return the yaw rate y (n,) with a vibration above half the grid's rate, or with noise."""
    phase = rng.uniform(0.0, 2.0 * np.pi)
    added: dict[str, Floats] = {
        "nothing": np.zeros(len(y)),
        "tone": np.sqrt(2.0) * np.sin(2.0 * np.pi * TONE * rate_hz * t + phase),
        "white noise": rng.standard_normal(len(y)),
    }
    return y + SHARE * float(y.std()) * added[kind]


def samples(u: Floats, y: Floats, raw_hz: float, rate_hz: float, way: str) -> SampleBlock:
    """Return the samples on the grid from the yaw rate (n,) and the rudder (n,) 3 ms later."""
    n, sample_time_s = len(y), 1.0 / rate_hz
    t_us = np.rint(np.arange(n) * 1e6 / raw_hz).astype(np.int64)
    columns = np.full((n, len(ROW)), np.nan)
    columns[:, ROW.index("r")] = y
    order, none = np.arange(n), np.zeros(1, np.int64)
    yaw = Series(2 * order, t_us, t_us, columns)
    surface = Series(2 * order + 1, t_us, t_us + 3000, np.column_stack([u, np.full(n, np.nan)]))
    count = finer_by(sample_time_s, 1e6 / raw_hz) if way == "band" else 1
    aligner = Aligner(sample_time_s / count, (10e6 / rate_hz, 10e6 / rate_hz))
    band = None if way == "none" else (BAND[0] * rate_hz, BAND[1] * rate_hz)
    block = aligner.feed_piece(Piece(True, Held.NONE, 0, yaw, surface, Readings(none, none)))
    assert block is not None
    found = Conditioner(RunConfig(band=band), sample_time_s, count).feed_samples(block)
    assert found is not None
    return found


def errors(raw_hz: float, rate_hz: float, kind: str, way: str, seed: int) -> list[list[float]]:
    """Return the errors of ELS and RML in one run: wn in per cent, and zeta."""
    rng, wn = np.random.default_rng(seed), OMEGA_TS * rate_hz
    u, y = flight(wn, rng)
    step = round(1.0 / raw_hz / STEP_S)
    raw_u, raw_y = u[3::step], y[::step][: len(u[3::step])]
    raw_y = disturbed(raw_y, np.arange(len(raw_y)) / raw_hz, kind, rate_hz, rng)
    config = RunConfig(forgetting=1.0)
    bank = Bank(config, 1.0 / rate_hz)
    bank.run(samples(raw_u, raw_y, raw_hz, rate_hz, way))
    found = []
    for method in ("els", "rml"):
        mode = modes(bank.last[method], config.armax_orders(), 1.0 / rate_hz).dutch_roll[-1]
        found.append([100.0 * (float(mode[0]) / wn - 1.0), float(mode[2]) - ZETA])
    return found


def cell(found: Floats) -> str:
    """Return the cell of a table: the mean error of wn, given errors (runs, methods, 2)."""
    lost = int(np.isnan(found).any(axis=(1, 2)).sum())
    means = " / ".join(f"{mean:+.2f}" for mean in np.nanmean(found[:, :, 0], axis=0))
    return means + (f", {lost} without an oscillation" if lost else "")


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table: a column for each pair of rates and each disturbance."""
    runs = options_of("aliasing", __doc__, arguments, runs=20).runs
    columns = [(*rates, kind) for rates in RATES for kind in DISTURBANCES]
    yield from head("", (f"{raw:g} to {grid:g} Hz, {kind}" for raw, grid, kind in columns))
    for way, name in WAYS.items():
        found = [[errors(*column, way, seed) for seed in range(runs)] for column in columns]
        yield line(name, *(cell(np.array(each)) for each in found))
