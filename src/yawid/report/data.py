"""The data of the report: the rows of a run, and the models of its best manoeuvres."""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Final

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import (
    Floats,
    Held,
    Ints,
    ModesBlock,
    Noted,
    SampleBlock,
    runs_of,
    words,
)
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
class Track:
    """The first method's estimates over time, thinned to 600 rows at most.

    t (n,) in s since boot, dutch_roll (n, 4): wn in rad/s, its sigma, zeta, its sigma.
    """

    t: Floats
    dutch_roll: Floats


@dataclass(frozen=True, slots=True)
class Events:
    """Events in the samples: spans ``held`` (n, 2) and instants (n,), in s since boot.

    ``counts`` is the number of samples held for each reason, ``notes`` of those with each note.
    """

    held: Floats
    mode_changes: Floats
    counts: dict[str, int]
    notes: dict[str, int]
    manoeuvres: Sequence[Manoeuvre]


@dataclass(frozen=True, slots=True)
class Whole:
    """Every sample of the run: t (n,) in s since boot, rudder and output (n,), NaN where held."""

    t: Floats
    rudder: Floats
    y: Floats


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
    """The data drawn of one run; ``drawn`` has the best manoeuvre first."""

    track: Track
    events: Events
    whole: Whole
    drawn: tuple[Drawn, ...]


def gather(run: McapRun) -> ReportData | None:
    """Return the data to draw of a run, None where it has no rows.

    Raises:
        SourceError: the file is damaged.
    """
    if run.grid is None or not run.rows:
        return None
    gatherer = _Gatherer(run, run.grid)
    for block in run.blocks():
        gatherer.add(block.samples, block.modes)
    return gatherer.result()


class _Gatherer:
    def __init__(self, run: McapRun, grid: Grid) -> None:
        self._run, self._grid = run, grid
        self._stride = -(-run.rows // TRACK_POINTS)
        self._rows = 0
        self._thin: list[tuple[Floats, ...]] = []
        self._blocks: list[SampleBlock] = []
        self._found = run.summary.manoeuvres or ()

    def add(self, samples: SampleBlock, modes: ModesBlock) -> None:
        thin = slice(-self._rows % self._stride, None, self._stride)
        self._thin.append((samples.boot_us[thin] / 1e6, modes.dutch_roll[thin].copy()))
        self._blocks.append(samples)
        self._rows += len(samples)

    def result(self) -> ReportData:
        run, samples = self._run, SampleBlock.joined(self._blocks)
        boot_s = samples.boot_us / 1e6
        recorded = Recorded(run.summary, run.config, self._grid.sample_time_s, [samples], {})
        drawn = []
        for flown in recorded.flown(to_draw(self._found, run.summary.used)):
            answered = Answered.of(flown.found)
            drawn.append(Drawn(answered, model_of_answer(recorded, answered, flown)))
        return ReportData(
            _track(*_joined(self._thin)),
            self._events(boot_s, samples.held, samples.noted),
            Whole(boot_s, samples.u[:, 0], samples.y),
            tuple(drawn),
        )

    def _events(self, t: Floats, held: Ints, noted: Ints) -> Events:
        spans, step_s = runs_of(held != 0), self._grid.sample_time_s
        changed = noted & Noted.MODE_CHANGED.value != 0
        changes = t[changed & ~np.concatenate([[False], changed[:-1]])]
        return Events(
            np.column_stack([t[spans[:, 0]], t[spans[:, 1] - 1] + step_s]),
            changes,
            _counts(held, Held),
            _counts(noted, Noted),
            self._found,
        )


def _track(t: Floats, dutch_roll: Floats) -> Track:
    """Return a track whose lines have a gap where time goes back, after a reboot."""
    back = np.diff(t, prepend=t[:1]) < 0.0
    return Track(t, np.where(back[:, None], np.nan, dutch_roll))


def _joined(parts: list[tuple[Any, ...]]) -> list[Any]:
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def _counts(codes: Ints, flags: type[IntFlag]) -> dict[str, int]:
    """Return the number of samples with each flag, by its words; flags without any are left out."""
    counts = {words(flag): int(np.sum(codes & flag.value != 0)) for flag in flags}
    return {name: count for name, count in counts.items() if count}


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
