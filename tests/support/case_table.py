"""The table in ``expected.csv``: one row for each second of a run, and the last one."""

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import Floats
from yawid.sinks.base import Done, Event, Grid, RunRows, Sink


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
