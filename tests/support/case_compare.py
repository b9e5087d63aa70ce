"""How a replay is compared with its references, the results of an earlier replay.

``expected.csv`` holds one row for each second and the last one, ``expected.json`` the summary.
Counts, times and status are compared exactly. Values are compared by a tolerance for each column,
relative to the larger of the value and the column's root mean square; NaN equals NaN.
"""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.sinks.base import Done, Event, Grid, RunRows, Sink

EXACT = ("k", "t", "held", "status")
VALUE_TOLERANCE = 1e-6
SPREAD_TOLERANCE = 1e-3
"""Tolerance of sigmas: small differences in a covariance's factors show in them first."""
TOTAL_TOLERANCE = 1e-2
"""Tolerance of total sigmas: they contain differences of fits, each of which may end at slightly
different values."""
BARE = (".bare.", ".lateral.")
BARE_SHARE = 0.5
BARE_SPREAD = 0.1
"""The bare airframe's values agree within this part of their sigma, its sigmas within this share.
Its fit ends where it gains nothing more, which another machine's BLAS decides: with the kernels of
two processors the 14 numbers of sitl_fbwa_50hz differ by up to .14 sigma, their sigmas by 3.6 %;
with its sums in another order L_p of the second manoeuvre is .42 sigma away."""
TOTALS = (".wn_std", ".zeta_std", ".std")
MOST_SAID = 300
"""The largest number of characters of a value that a message shows."""
NOT_COMPARED = frozenset({"log", "files", "text", "next", "correlations"})
"""Keys that are not compared: paths on the disk and the words of a verdict are not results, and the
bare airframe's correlations, many of them near 0, follow from its fit, whose sigmas are compared.
"""


def tolerance_of(column: str, tolerances: Mapping[str, float]) -> float:
    """Return a column's relative tolerance; zero means that values must be equal."""
    if column in tolerances:
        return tolerances[column]
    name = column.rpartition(".")[2]
    if name in EXACT:
        return 0.0
    return SPREAD_TOLERANCE if name.endswith("_std") else VALUE_TOLERANCE


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A column that differs: its name ("" for a whole table), by how many tolerances, a message."""

    column: str
    excess: float
    text: str


def compare_tables(
    columns: list[str],
    expected: Floats,
    actual_columns: list[str],
    actual: Floats,
    tolerances: Mapping[str, float],
) -> list[Mismatch]:
    """Return the columns that differ, worst first; the tables are (n, m) and (n', m').

    Raises:
        ConfigError: a tolerance is given for a column that does not exist.
    """
    if unused := sorted(set(tolerances) - set(columns)):
        raise ConfigError(f"a tolerance names a column that is not there: {', '.join(unused)}")
    if columns != actual_columns:
        return [Mismatch("", math.inf, f"columns: expected {columns}, got {actual_columns}")]
    if expected.shape != actual.shape:
        text = f"rows: expected {len(expected)}, got {len(actual)}"
        return [Mismatch("", math.inf, text)]
    found = [
        _compare_column(column, expected[:, i], actual[:, i], tolerances, expected[:, :2])
        for i, column in enumerate(columns)
    ]
    return sorted((m for m in found if m is not None), key=lambda m: -m.excess)


def _compare_column(
    column: str, expected: Floats, actual: Floats, tolerances: Mapping[str, float], k_and_t: Floats
) -> Mismatch | None:
    tolerance = tolerance_of(column, tolerances)
    finite = expected[np.isfinite(expected)]
    scale = float(np.sqrt(np.mean(finite**2))) if len(finite) else 0.0
    allowed = tolerance * np.maximum(np.abs(np.nan_to_num(expected)), scale)
    same = (np.isnan(expected) & np.isnan(actual)) | (np.abs(actual - expected) <= allowed)
    if same.all():
        return None
    bad = np.flatnonzero(~same)
    first = bad[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.abs(actual - expected)[bad] / allowed[bad]
    worst = float(np.max(np.nan_to_num(excess, nan=np.inf)))
    text = (
        f"{column}: {len(bad)} of {len(same)} rows differ, by up to {worst:.3g} tolerances; first "
        f"at k={k_and_t[first, 0]:.0f} t={k_and_t[first, 1]:.3f}: "
        f"expected {expected[first]:.9g}, got {actual[first]:.9g}"
    )
    return Mismatch(column, worst, text)


def split_tolerances(
    tolerances: Mapping[str, float], columns: Sequence[str], reference: object
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the tolerances of columns, and those of the summary's keys and all keys below them.

    Raises:
        ConfigError: a tolerance is given for a column or key that does not exist.
    """
    by_column = {name: value for name, value in tolerances.items() if name in columns}
    by_key = {name: value for name, value in tolerances.items() if name not in columns}
    leaves = [name for name, *_ in _side_by_side(reference, reference)]
    unused = [name for name in sorted(by_key) if not any(_below(leaf, name) for leaf in leaves)]
    if unused:
        raise ConfigError(
            f"a tolerance names a column or key that is not there: {', '.join(unused)}"
        )
    return by_column, by_key


def _side_by_side(
    expected: object, actual: object, where: str = ""
) -> Iterator[tuple[str, object, object]]:
    """Yield (dotted name, expected value, actual value) for all keys of two summaries.

    None stands for a missing key. What both summaries have is followed down to its last key; what
    only one of them has is yielded as a whole.
    """
    if isinstance(expected, dict) and isinstance(actual, dict):
        for key in sorted((expected.keys() | actual.keys()) - NOT_COMPARED):
            name = f"{where}.{key}" if where else key
            yield from _side_by_side(expected.get(key), actual.get(key), name)
    elif isinstance(expected, list) and isinstance(actual, list) and len(expected) == len(actual):
        for i, (a, b) in enumerate(zip(expected, actual, strict=True)):
            yield from _side_by_side(a, b, f"{where}[{i}]")
    else:
        yield where, expected, actual


def compare_summaries(
    expected: object, actual: object, tolerances: Mapping[str, float] | None = None
) -> Iterator[str]:
    """Yield a message for each key that differs; a tolerance holds for all keys below its own."""
    both = list(_side_by_side(expected, actual))
    known = {name: a for name, a, _ in both}
    for name, a, b in both:
        if a is None or b is None:
            yield f"summary.{name}: {'not' if a is None else 'only'} in the reference"
        elif not _same_value(a, b, name, tolerances or {}, _sigma(name, known)):
            yield f"summary.{name}: expected {_short(a)}, got {_short(b)}"


def _short(value: object) -> str:
    """Return the value in a line; a long one is cut, and a list is preceded by its length."""
    said, count = repr(value), f"{len(value)} in " if isinstance(value, list) else ""
    return said if len(said) <= MOST_SAID else f"{count}{said[:MOST_SAID]}…"


def _sigma(where: str, known: Mapping[str, object]) -> float | None:
    """Return the sigma that stands next to a value of the bare airframe, None where none does."""
    if not any(name in where for name in BARE):
        return None
    above, _, name = where.rpartition(".")
    names = (f"{above}.std", f"{above}.{name.split('_')[0]}_std")
    found = (known.get(each) for each in names if each != where)
    return next((each for each in found if isinstance(each, float)), None)


def _same_value(
    expected: object,
    actual: object,
    where: str,
    tolerances: Mapping[str, float],
    sigma: float | None,
) -> bool:
    if not isinstance(expected, float) or not isinstance(actual, int | float):
        return type(expected) is type(actual) and bool(expected == actual)
    named = max((name for name in tolerances if _below(where, name)), key=len, default="")
    if named:
        relative = tolerances[named]
    elif sigma is not None:
        return abs(actual - expected) <= BARE_SHARE * sigma
    elif any(name in where for name in BARE):
        return math.isclose(expected, actual, rel_tol=BARE_SPREAD)
    elif where.endswith("whiteness_p"):
        return math.isclose(expected, actual, abs_tol=SPREAD_TOLERANCE)
    else:
        spread = "_std" in where or where.endswith(".std_noise")
        relative = SPREAD_TOLERANCE if spread else VALUE_TOLERANCE
    if where.endswith(TOTALS) and named != where:
        relative = max(relative, TOTAL_TOLERANCE)
    return math.isclose(expected, actual, rel_tol=relative)


def _below(where: str, name: str) -> bool:
    return where == name or where.startswith((f"{name}.", f"{name}["))


@dataclass(slots=True)
class TableSink(Sink):
    """A sink that keeps one row for each second, and the last one."""

    columns: list[str] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    newest: list[float] = field(default_factory=list)
    _second: int = -1

    def take(self, event: Event) -> None:
        """Keep the first row of each second, and the last one."""
        if isinstance(event, Grid):
            self._start(event)
        elif isinstance(event, RunRows):
            self._write(event)
        elif isinstance(event, Done) and self.newest and self.rows[-1][0] != self.newest[0]:
            self.rows.append(self.newest)

    def _start(self, grid: Grid) -> None:
        self.columns = ["k", "t", "held", *grid.inputs, "yaw_rate"]
        for method in grid.methods:
            per_sample = ("status", "y_hat", "innovation", "residual", "noise_std")
            self.columns += [f"{method}.{name}" for name in per_sample]
            self.columns += [f"{method}.{name}" for name in grid.parameters]
            self.columns += [f"{method}.{name}_std" for name in grid.parameters]
        self.columns += ["wn", "wn_std", "zeta", "zeta_std"]

    def _write(self, rows: RunRows) -> None:
        samples, estimates, modes = rows
        columns: list[Any] = [samples.k, samples.boot_us / 1e6, samples.held, samples.u, samples.y]
        for block in estimates.values():
            columns += [block.status, block.y_hat, block.innovation, block.residual]
            columns += [block.noise_std, block.theta, block.theta_std]
        table = np.column_stack([*columns, modes.dutch_roll]).astype(float)
        seconds = samples.boot_us // 1_000_000
        first = np.diff(seconds, prepend=self._second) != 0
        self.rows += table[first].tolist()
        self._second, self.newest = int(seconds[-1]), table[-1].tolist()


def csv_of(columns: list[str], rows: list[list[float]]) -> bytes:
    """Return a table as CSV text, which ``git diff`` can show."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([f"{value:.9g}" for value in row] for row in rows)
    return text.getvalue().encode()


def read_csv(path: Path) -> tuple[list[str], Floats]:
    """Return the names of the columns and the table (n, m) of a reference.

    Raises:
        OSError, ValueError: the file cannot be read, or is not such a table.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array([[float(value) for value in row] for row in rows]).reshape(
        len(rows), len(header)
    )
