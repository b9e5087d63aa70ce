"""The data of the report: the rows of a run, and the models of its best manoeuvres."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Final

import numpy as np

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import (
    EstimateBlock,
    Floats,
    Held,
    Ints,
    ModesBlock,
    Noted,
    SampleBlock,
    Status,
    runs_of,
    words,
)
from yawid.models.answered import Answered
from yawid.models.flown import Flown, Rows
from yawid.models.identify import Recorded, model_of_answer
from yawid.models.linear import LinearModel
from yawid.physics.modes import modes as physics_modes
from yawid.sinks.base import Grid
from yawid.sinks.mcap.reader import McapRun

TRACK_POINTS = 600
MOST_DRAWN: Final = 4
"""The largest number of manoeuvres with a picture: a hundred pictures would hide the best."""


@dataclass(frozen=True, slots=True)
class Track:
    """Estimates over time, thinned to 600 rows at most.

    t (n,) in s since boot, theta and theta_std (n, p), dutch_roll (n, 4): wn in rad/s, its sigma,
    zeta, its sigma.
    """

    t: Floats
    theta: Floats
    theta_std: Floats
    dutch_roll: Floats


@dataclass(frozen=True, slots=True)
class Events:
    """Events in the samples: spans ``held`` (n, 2) and instants (n,), in s since boot.

    ``counts`` is the number of samples held for each reason, ``notes`` of those with each note.
    ``delay_s`` (n,) is the longest delay of a sample in each stretch that begins at ``delay_t``.
    """

    held: Floats
    mode_changes: Floats
    counts: dict[str, int]
    notes: dict[str, int]
    delay_t: Floats
    delay_s: Floats
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
    """The data drawn of one run.

    ``tracks`` are by method, that of the modes in the file first; ``drawn`` has the best manoeuvre
    first.
    """

    tracks: dict[str, Track]
    events: Events
    whole: Whole
    drawn: tuple[Drawn, ...]

    @property
    def track(self) -> Track:
        """The first method's track."""
        return next(iter(self.tracks.values()))


def gather(run: McapRun) -> ReportData | None:
    """Return the data to draw of a run, None where it has no rows.

    Raises:
        SourceError: the file is damaged.
    """
    if run.grid is None or not run.rows:
        return None
    gatherer = _Gatherer(run, run.grid)
    for block in run.blocks():
        gatherer.add(block.samples, block.estimates, block.modes)
    return gatherer.result()


class _Gatherer:
    def __init__(self, run: McapRun, grid: Grid) -> None:
        self._run, self._grid = run, grid
        self._stride = -(-run.rows // TRACK_POINTS)
        self._rows = 0
        self._thin: dict[str, list[tuple[Floats, ...]]] = {m: [] for m in grid.methods}
        self._full: list[tuple[Any, ...]] = []
        self._found = run.summary.manoeuvres or ()
        self._manoeuvres = [Rows(each) for each in to_draw(self._found, run.summary.used)]

    def add(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        thin = slice(-self._rows % self._stride, None, self._stride)
        for method, estimate in estimates.items():
            some = EstimateBlock(estimate.rows[thin], estimate.p)
            # The file has the modes of the first method, with their sigmas.
            first = method == self._grid.methods[0]
            dutch_roll = modes.dutch_roll[thin].copy() if first else self._modes(method, some)
            live = (some.status != Status.WARMING_UP)[:, None]
            theta, theta_std = (
                np.where(live, column, np.nan) for column in (some.theta, some.theta_std)
            )
            self._thin[method].append((samples.boot_us[thin] / 1e6, theta, theta_std, dutch_roll))
        delay_s = (samples.received_us - samples.unix_ns / 1e3) / 1e6
        self._full.append(
            (samples.boot_us, samples.held, samples.noted, delay_s, samples.u[:, 0].copy(),
             samples.y.copy())
        )  # fmt: skip
        self._rows += len(samples)
        for each in self._manoeuvres:
            each.add(samples)

    def _modes(self, method: str, estimates: EstimateBlock) -> Floats:
        """Return the Dutch roll (n, 4) of estimates, without sigmas: they need a covariance."""
        config = self._run.config.estimator(method, self._grid.sample_time_s)
        mean_output = self._run.config.output == "yaw"
        found = physics_modes(
            estimates, config.orders, config.sample_time_s, mean_output=mean_output
        )
        return found.dutch_roll

    def result(self) -> ReportData:
        boot_us, held, noted, delay_s, rudder, output = _joined(self._full)
        boot_s, run = boot_us / 1e6, self._run
        recorded = Recorded(run.summary, run.config, self._grid.sample_time_s, (), {})
        drawn = []
        for each in self._manoeuvres:
            if (flown := each.flown(run.config)) is not None:
                answered = Answered.of(each.found)
                drawn.append(Drawn(answered, model_of_answer(recorded, answered, flown)))
        return ReportData(
            {method: _track(*_joined(rows)) for method, rows in self._thin.items()},
            self._events(boot_s, held, noted, delay_s),
            Whole(boot_s, rudder, output),
            tuple(drawn),
        )

    def _events(self, t: Floats, held: Ints, noted: Ints, delay_s: Floats) -> Events:
        spans, step_s = runs_of(held != 0), self._grid.sample_time_s
        changed = noted & Noted.MODE_CHANGED.value != 0
        changes = t[changed & ~np.concatenate([[False], changed[:-1]])]
        # Of each stretch the longest delay is drawn: a stall must not fall between the points.
        starts = np.arange(0, len(t), self._stride)
        return Events(
            np.column_stack([t[spans[:, 0]], t[spans[:, 1] - 1] + step_s]),
            changes,
            _counts(held, Held),
            _counts(noted, Noted),
            t[starts],
            np.maximum.reduceat(delay_s, starts),
            self._found,
        )


def _track(t: Floats, *columns: Floats) -> Track:
    """Return a track whose lines have a gap where time goes back, after a reboot."""
    back = np.diff(t, prepend=t[:1]) < 0.0
    return Track(t, *(np.where(back[:, None], np.nan, column) for column in columns))


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
