"""The data of the report: the rows of a run, and its final model estimated again.

The file holds the sigma of theta but not its covariance, which every band needs. Estimating again
from the samples gives the covariance, and shows that the file can be replayed.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Final

import numpy as np
from msgspec.structs import astuple

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
from yawid.estimation.bank import Bank
from yawid.estimation.fit import simulate
from yawid.models.fitted import Judged, Model
from yawid.models.refit import Drawn, Rows
from yawid.physics.modes import modes as physics_modes
from yawid.sinks.mcap.reader import McapRun
from yawid.sinks.words import orders_in

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
class ReportData:
    """The data drawn of one run: ``tracks`` by method; ``drawn`` has the best manoeuvre first."""

    method: str
    model: Model
    tracks: dict[str, Track]
    judged: Judged
    events: Events
    whole: Whole
    drawn: tuple[Drawn, ...]

    @property
    def track(self) -> Track:
        """The track of the method that is drawn."""
        return self.tracks[self.method]


def gather(run: McapRun, method: str | None = None) -> ReportData | None:
    """Return the data to draw of a run, None where it has no rows or no finite covariance.

    ``method`` is the estimator to draw; the default is the run's primary one.

    Raises:
        SourceError: the file is damaged.
    """
    if run.grid is None or not run.rows or run.config.bank_methods() != run.grid.methods:
        return None
    if method not in run.grid.methods:
        method = run.grid.methods[0]
    gatherer = _Gatherer(run, method, run.grid.sample_time_s)
    for block in run.blocks():
        gatherer.add(block.samples, block.estimates, block.modes)
    return gatherer.result()


class _Gatherer:
    def __init__(self, run: McapRun, method: str, sample_time_s: float) -> None:
        self.method = method
        self._bank = Bank(run.config, sample_time_s)
        self._stride = -(-run.rows // TRACK_POINTS)
        self._rows = 0
        self._thin: dict[str, list[tuple[Floats, ...]]] = {m: [] for m in self._bank.methods}
        self._full: list[tuple[Any, ...]] = []
        self._last = np.empty(0)
        self._found = run.summary.manoeuvres or ()
        drawn = to_draw(self._found, run.summary.used)
        self._manoeuvres = {each.n: Rows(each) for each in drawn}
        self._orders = {each.n: orders_in(each, run.summary.by_loop) for each in drawn}

    def add(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        again = [self._bank.run(part) for part in samples.epochs()]
        thin = slice(-self._rows % self._stride, None, self._stride)
        for method, estimate in estimates.items():
            dutch_roll = modes.dutch_roll[thin].copy()
            if method != self._bank.methods[0]:  # the file has the modes of the primary method
                rows = np.concatenate([part[method].rows for part in again])[thin]
                dutch_roll = self._modes(method, EstimateBlock(rows, estimate.p))
            live = (estimate.status[thin] != Status.WARMING_UP)[:, None]
            theta, theta_std = (
                np.where(live, column[thin], np.nan)
                for column in (estimate.theta, estimate.theta_std)
            )
            self._thin[method].append((samples.boot_us[thin] / 1e6, theta, theta_std, dutch_roll))
        estimate = estimates[self.method]
        delay_s = (samples.received_us - samples.unix_ns / 1e3) / 1e6
        self._full.append(
            (samples.boot_us, samples.held, samples.noted, estimate.residual.copy(), delay_s,
             samples.u[:, 0].copy(), samples.y.copy())
        )  # fmt: skip
        self._rows += len(samples)
        self._last = estimate.theta[-1].copy()
        for each in self._manoeuvres.values():
            each.add(samples)

    def _modes(self, method: str, estimates: EstimateBlock) -> Floats:
        """Return the Dutch roll (n, 4), with sigmas, of estimates that have their covariance."""
        config = self._bank.estimators[method].config
        mean_output = self._bank.config.output == "yaw"
        return physics_modes(
            estimates, config.orders, config.sample_time_s, mean_output=mean_output
        ).dutch_roll

    def result(self) -> ReportData | None:
        block = self._bank.last[self.method]
        theta, covariance = block.theta[-1], block.covariance
        if covariance is None or not np.isfinite(covariance[-1]).all():
            return None
        config = self._bank.estimators[self.method].config
        same = bool(np.array_equal(theta, self._last))
        model = Model(theta, covariance[-1], config.orders, config.sample_time_s, same)
        boot_us, held, noted, residual, delay_s, rudder, output = _joined(self._full)
        boot_s, history = boot_us / 1e6, self._bank.history()
        n, u, y = len(history.y), history.u, history.y
        simulated = simulate(theta, config.orders, config.bias, u, y)
        y_hat = history.y_hat[self.method]
        again = [
            each.drawn(self._bank.config, model.sample_time_s, astuple(self._orders[n]))
            for n, each in self._manoeuvres.items()
        ]
        return ReportData(
            self.method,
            model,
            {method: _track(*_joined(rows)) for method, rows in self._thin.items()},
            Judged(boot_s[-n:], u, y, y_hat, simulated, residual[-n:]),
            self._events(boot_s, held, noted, delay_s),
            Whole(boot_s, rudder, output),
            tuple(each for each in again if each is not None),
        )

    def _events(self, t: Floats, held: Ints, noted: Ints, delay_s: Floats) -> Events:
        spans, step_s = runs_of(held != 0), self._bank.sample_time_s
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

    def worth(each: Manoeuvre) -> tuple[bool, tuple[float, float]]:
        answer = each.answer if each.verdict.usable else None
        fit = None if answer is None else answer.fit.simulation_pct
        return each.n not in used, each.standing if fit is None else (0, -fit)

    return sorted((each for each in manoeuvres if each.answer is not None), key=worth)[:MOST_DRAWN]
