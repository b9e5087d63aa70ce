"""Expected and actual curves in one picture, for a person to see how a case differs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from yawid.blocks import Floats
from yawid.runs.regress.compare import Mismatch

ALWAYS = ("wn", "zeta")
WORST = 2
"""How many of the columns that differ most are drawn below wn and zeta."""
UNITS = {"wn": "wn, rad/s", "zeta": "zeta", "t": "vehicle time, s"}


def draw(
    path: Path,
    title: str,
    columns: list[str],
    expected: Floats,
    actual: Floats,
    mismatches: Sequence[Mismatch],
) -> None:
    """Write an SVG: wn, zeta and the columns that differ most, expected and actual over time.

    Both tables have the columns named, (n, m) and (n', m). The same tables give the same bytes.
    """
    named = [m.column for m in mismatches if m.column in columns and m.column not in ALWAYS]
    shown = [name for name in (*ALWAYS, *named[:WORST]) if name in columns]
    t = columns.index("t")
    with mpl.rc_context({"svg.hashsalt": "yawid", "font.size": 9}):
        figure = Figure(figsize=(8.0, 1.0 + 1.7 * len(shown)), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axis, name in zip(axes, shown, strict=True):
            i = columns.index(name)
            _curves(axis, expected[:, [t, i]], actual[:, [t, i]])
            axis.set_ylabel(UNITS.get(name, name))
        axes[0].set_title(f"{title}: expected and actual")
        axes[0].legend(loc="upper right", ncols=2, frameon=False)
        axes[-1].set_xlabel(UNITS["t"])
        figure.savefig(path, metadata={"Date": None})


def _curves(axis: Any, expected: Floats, actual: Floats) -> None:
    """Draw both curves, the reference broad and pale; the axis spans most of their values."""
    axis.plot(*expected.T, color="#b0b0b0", linewidth=4.0, label="expected")
    axis.plot(*actual.T, color="#c03000", linewidth=1.2, label="actual")
    values = np.concatenate([expected[:, 1], actual[:, 1]])
    values = values[np.isfinite(values)]
    if len(values):
        # The first seconds of an estimate may have any value, which would flatten all the rest.
        low, high = np.percentile(values, [2.0, 98.0])
        margin = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
        axis.set_ylim(low - margin, high + margin)
    axis.grid(alpha=0.3)
