"""The figures of estimates against the truth, in one form for all benches that fly.

z is (estimate - truth) / sqrt(sigma^2 + sigma of the truth^2). Estimates that count are the usable
ones; of ELS and RML they are all that have a number, and their sigma is that of noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from checks.judge import METHODS, Row

from bench.frame import Floats, known, rms, within

FAR = 3.5
MOST_Z, IN_2_PCT, LEAST_ROW = 1.3, 94.0, 20
"""Limits of the root mean square of z and of the share of z within 2, and the answers that a
condition needs for them to be criteria."""
COLUMNS = (
    "count", "answered %", "wn off %, median", "wn mean", "wn RMS", "zeta mean", "zeta RMS",
    "z wn, zeta", "in 2 sigma %", f"beyond {FAR:g}",
)  # fmt: skip
"""Of the errors of wn in % and of zeta: median size, mean, root mean square; then the root mean
square of z, the share of z within 2 (wn, zeta), and how many of both are beyond FAR."""
KEYS = {"wn": ("wn_error_pct", "wn_z"), "zeta": ("zeta_error", "zeta_z")} | {
    f"{name} of the mean": (error, f"{name}_z_mean")
    for name, error in (("wn", "wn_error_pct"), ("zeta", "zeta_error"))
}
"""The columns with error and z of a number; any other number has its own name in them."""
DRAWS, SEED = 500, 0
Figure = Callable[[Floats], float]
"""A figure of errors (n, 3)."""
FIGURES: dict[str, Figure] = {
    "median": lambda x: known(np.median, np.abs(x[:, 1])),
    "mean": lambda x: known(np.mean, x[:, 1]),
    "size of the mean": lambda x: abs(known(np.mean, x[:, 1])),
    "RMS": lambda x: rms(x[:, 1]),
    "z": lambda x: rms(x[:, 2]),
    "in 2 sigma %": lambda x: within(x[:, 2]),
    "beyond": lambda x: float(np.sum(np.abs(x[:, 2]) > FAR)),
}


def of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind of estimate."""
    return [row for row in rows if row["kind"] == kind]


def estimates(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind that have an estimate and a truth, and are usable if judged."""
    return [row for row in of_kind(rows, kind)
            if (row["usable"] or kind in METHODS) and row["wn_error_pct"] is not None]  # fmt: skip


def errors(rows: Sequence[Row], name: str) -> Floats:
    """Return flight, error and z (n, 3) of a number, of the rows that have it."""
    keys = ("number", *KEYS.get(name, (f"{name}_error_pct", f"{name}_z")))
    found = [[row[key] for key in keys] for row in rows if keys[1] in row]
    return np.array(found, float).reshape(-1, 3)


def cells(rows: Sequence[Row], kind: str, end: str = "") -> list[str]:
    """Return the cells of COLUMNS of one kind of estimate; a flight's mean has the ``end``."""
    some = estimates(rows, kind)
    wn, zeta = (errors(some, name + end) for name in ("wn", "zeta"))
    answered = 100.0 * len(some) / max(len(of_kind(rows, kind)), 1)
    median, mean, size = (FIGURES[name](wn) for name in ("median", "mean", "RMS"))
    mean_zeta, size_zeta = (FIGURES[name](zeta) for name in ("mean", "RMS"))
    z, inside, far = (
        [FIGURES[name](of) for of in (wn, zeta)] for name in ("z", "in 2 sigma %", "beyond")
    )
    off = f"{median:.2f}", f"{mean:+.2f}", f"{size:.2f}", f"{mean_zeta:+.4f}", f"{size_zeta:.4f}"
    both = f"{z[0]:.2f} {z[1]:.2f}", f"{inside[0]:.0f} {inside[1]:.0f}", f"{sum(far):.0f}"
    return [str(len(some)), f"{answered:.0f}", *off, *both]


class Criterion(NamedTuple):
    """A criterion: a figure and its own error, and the limit that it has to keep."""

    what: str
    value: float
    error: float
    limit: float

    @property
    def excess(self) -> float:
        """By how much the figure misses its limit beyond its own error, if positive.

        The limit of a share is the least value, not the largest.
        """
        return (self.value - self.limit) * (-1.0 if "%" in self.what else 1.0) - self.error

    def __str__(self) -> str:
        return f"{self.what}: {self.value:.3g} ± {self.error:.2g}, limit {self.limit:g}"


def criterion(what: str, figure: str, of: Floats, limit: float) -> Criterion:
    """Return the criterion that a figure of errors (n, 3) keeps a limit.

    Its own error is its standard deviation over DRAWS draws of the flights.
    """
    rng, value = np.random.default_rng(SEED), FIGURES[figure]
    flights = [np.flatnonzero(of[:, 0] == number) for number in np.unique(of[:, 0])]
    found = [
        value(of[np.concatenate([flights[i] for i in each])])
        for each in (rng.integers(len(flights), size=(DRAWS, len(flights))) if flights else ())
    ]
    error = float(np.std(found)) if found else np.nan
    return Criterion(f"{what}: {figure}", value(of), error, limit)


def missed(found: Iterable[Criterion]) -> str | None:
    """Return the criteria that are not met, in words; None if all are."""
    bad = [str(each) for each in found if not each.excess <= 0.0]
    return f"not met: {'; '.join(bad)}" if bad else None
