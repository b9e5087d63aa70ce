"""The data of the report: the rows of a run, and the models of its best manoeuvres."""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Floats, Noted, SampleBlock, runs_of
from yawid.models.answered import Answered
from yawid.models.flown import Flown
from yawid.models.identify import Recorded, model_of_answer
from yawid.models.linear import LinearModel
from yawid.sinks.base import Grid
from yawid.sinks.mcap.reader import McapRun

TRACK_POINTS = 600
MOST_DRAWN: Final = 4
"""The largest number of manoeuvres with a picture: a hundred pictures would hide the best."""


@dataclass(frozen=True, slots=True)
class Events:
    """Events in the samples: spans ``held`` (n, 2) and instants (n,), in s since boot."""

    held: Floats
    mode_changes: Floats
    manoeuvres: Sequence[Manoeuvre]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A manoeuvre that is drawn: its answer's model, and its samples with what that makes of it."""

    answered: Answered
    model: LinearModel

    @property
    def found(self) -> Manoeuvre:
        """The manoeuvre."""
        return self.answered.found

    @property
    def measured(self) -> Flown:
        """Its samples."""
        assert self.model.measured is not None  # gather() had them
        return self.model.measured

    @property
    def wn_rad_s(self) -> float:
        """The natural frequency of the answer."""
        return float(self.answered.x[0])


@dataclass(frozen=True, slots=True)
class ReportData:
    """The data drawn of one run; ``drawn`` has the best manoeuvre first.

    ``track`` (n, 5) has the first method's estimates, thinned to 600 rows at most: s since boot, wn
    in rad/s, its sigma, zeta, its sigma. They are NaN where time goes back, after a reboot.
    """

    grid: Grid
    samples: SampleBlock
    track: Floats
    events: Events
    drawn: tuple[Drawn, ...]


def gather(run: McapRun) -> ReportData | None:
    """Return the data to draw of a run, None where it has no rows.

    Raises:
        SourceError: the file is damaged.
    """
    if run.grid is None or not run.rows:
        return None
    kept = [(rows.samples, rows.modes.dutch_roll) for rows in run.blocks()]
    samples, found = SampleBlock.joined([each for each, _ in kept]), run.summary.manoeuvres or ()
    modes = np.concatenate([each for _, each in kept])
    track = np.column_stack([samples.boot_us / 1e6, modes])[:: -(-run.rows // TRACK_POINTS)]
    track[1:][np.diff(track[:, 0]) < 0.0, 1:] = np.nan
    recorded = Recorded(run.summary, run.config, run.grid.sample_time_s, [samples], {})
    drawn = []
    for flown in recorded.flown(to_draw(found, run.summary.used)):
        answered = Answered.of(flown.found)
        drawn.append(Drawn(answered, model_of_answer(recorded, answered, flown)))
    return ReportData(run.grid, samples, track, _events(samples, found), tuple(drawn))


def _events(samples: SampleBlock, found: Sequence[Manoeuvre]) -> Events:
    t, spans = samples.boot_us / 1e6, runs_of(samples.held != 0)
    changed = samples.noted & Noted.MODE_CHANGED.value != 0
    changes = t[changed & ~np.concatenate([[False], changed[:-1]])]
    ends = t[spans[:, 1] - 1] + samples.sample_time_s
    return Events(np.column_stack([t[spans[:, 0]], ends]), changes, found)


def to_draw(manoeuvres: Sequence[Manoeuvre], used: Container[int]) -> list[Manoeuvre]:
    """Return the manoeuvres to draw, the best first.

    Those ``used`` for the flight come first, then other usable ones, those of a higher simulated
    fit first; then refused ones by their standing.
    """

    def worth(each: Manoeuvre) -> tuple[bool, tuple[float, ...]]:
        answer = each.answer if each.verdict.usable else None
        fit = None if answer is None else answer.fit.simulation_pct
        return each.n not in used, each.standing if fit is None else (0, -fit)

    known = (each for each in manoeuvres if each.answer and each.answer.response)
    return sorted(known, key=worth)[:MOST_DRAWN]
