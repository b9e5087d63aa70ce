"""``yawid trend``: every vehicle's wn/V, zeta and K/V over its flights, and what has changed.

The false-alarm rate holds for the whole data set and for all tests of it, one after every day
flown: among data sets in which nothing changed, a fraction FALSE_ALARMS ever reports a change in
any history (Bonferroni over the histories tested). A change that a season may explain is not
reported as one before there are two years of flights. Outliers and vehicles that stand out are
reported at the same rate for a single test; they do not count as changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from yawid.answers.part import Part
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Value
from yawid.errors import ConfigError
from yawid.quantities.table import QUANTITIES
from yawid.trend.changes import Change, Fitted, fit_fleets, profile
from yawid.trend.days import YEAR_US
from yawid.trend.history import Flights, History, measured_otherwise, mixed, read_flights
from yawid.trend.levels import Compared, Level, compare, level_of, slope_of
from yawid.trend.moderated import two_sided

FALSE_ALARMS: Final = 0.01
"""Rate of false alarms of a whole data set."""
A_YEAR: Final = 40.0
"""A year, counted from 1970, whose calendar turns a fraction of a year into a date."""
LEAST_SPAN_YEARS: Final = 1.0 / 12.0
"""Least time from the first flight to the last for a slope per year: a few days do not show one."""


class Changed(Part, frozen=True, kw_only=True):
    """A change: a ``step`` between two days or a ``slope`` over several; flights count from 1.

    ``p`` is the probability that any history of an unchanged data set shows a change as clear as
    this in any test. For a possible season it is the probability if there were no seasons.
    """

    kind: str
    from_flight: int
    to_flight: int
    from_date: str
    to_date: str
    before: float
    after: float
    difference: float
    std: float
    sigmas: float
    percent: float | None = None
    p: float
    measured_otherwise: list[str]


class Outlier(Part, frozen=True, kw_only=True):
    """A flight far off the others; its distance is in sigmas (its own sigma and tau together)."""

    flight: int
    date: str
    log_sha256: str | None = None
    boot: int | None = None
    value: float
    sigmas: float
    p: float


class Yearly(Part, frozen=True, kw_only=True):
    """A season: the amplitude by which a number swings, and the day of the year of its peak."""

    amplitude: Value
    peak: str


class Beside(Part, frozen=True, kw_only=True):
    """A vehicle compared with all of its type and loop: their median, its distance in sigmas."""

    vehicles: int
    median: float
    sigmas: float
    p: float
    stands_out: bool


class Followed(Part, frozen=True, kw_only=True):
    """One number of one vehicle over its flights; ``now`` is its level after the last change.

    ``between_std`` is the scatter of the flights that their own sigmas do not explain. ``tested``
    is whether there were enough days to look for a change. ``may_be_season`` is a clear change that
    a season may explain, as there are fewer than two years of flights to show one.
    """

    vehicle: str
    loop: str
    quantity: str
    unit: str
    flights: int
    days: int
    first_date: str
    last_date: str
    now: Value
    between_std: float | None = None
    slope_per_year: Value | None = None
    slope_per_flight: Value | None = None
    tested: bool
    change: Changed | None = None
    may_be_season: Changed | None = None
    season: Yearly | None = None
    outliers: list[Outlier]
    beside: Beside | None = None


class Trend(Part, frozen=True, kw_only=True):
    """The trends of all vehicles in a data set; ``judged`` is how many of ``followed`` were tested.

    ``warnings`` name the ids under which several aircraft seem to fly.
    """

    dataset: str
    changed: bool
    judged: int
    warnings: list[Reason]
    false_alarm_rate: float
    histories_tested: int
    numbers_tested: int
    flights: int
    left_out: dict[str, int]
    followed: list[Followed]


@dataclass(frozen=True, slots=True)
class Studied:
    """A history with all results, for tables and pictures."""

    history: History
    fitted: Fitted
    level: Level
    change: Change | None
    followed: Followed


def trend(folder: Path, vehicle: str | None = None) -> tuple[Trend, list[Studied]]:
    """Return the trends of a data set, or only those of ``vehicle``, judged among all the same.

    Raises:
        SourceError: there is no data set, or it cannot be read.
        ConfigError: the data set has no such vehicle.
    """
    flights = read_flights(folder)
    studied = study(flights)
    if vehicle is not None:
        names = list(dict.fromkeys(each.history.vehicle for each in studied))
        if vehicle not in names:
            some = f"{', '.join(names[:8])}{', …' if len(names) > 8 else ''}" or "none"
            raise ConfigError(f"--vehicle {vehicle}: not in {folder}, which has {some}")
    shown = [each for each in studied if vehicle in (None, each.history.vehicle)]
    report = Trend(
        dataset=str(folder.absolute()),
        changed=any(each.change is not None for each in shown),
        judged=sum(each.followed.tested for each in shown),
        warnings=list(mixed(flights)),
        false_alarm_rate=FALSE_ALARMS,
        histories_tested=sum(each.followed.tested for each in studied),
        numbers_tested=sum(len(each.history.flights) for each in studied),
        flights=len({(row["log_sha256"], row["sysid"], row["boot"]) for row in flights.rows}),
        left_out={why: count for why, count in flights.left_out.items() if count},
        followed=[each.followed for each in shown],
    )
    return report, shown


def study(flights: Flights) -> list[Studied]:
    """Return each history with its results, judged among all histories."""
    histories = flights.histories
    fits = _fits(histories)
    among = _Among(
        histories=sum(fit.change is not None for fit in fits),
        numbers=sum(len(history.flights) for history in histories),
    )
    levels, changes = [], []
    for history, fit in zip(histories, fits, strict=True):
        is_change = fit.change is not None and fit.change.p * among.histories <= FALSE_ALARMS
        change = fit.change if is_change else None
        shape = None if change is None else profile(len(fit.days.value), change)
        changes.append(change)
        levels.append(level_of(history.track, fit, shape))
    compared = _compared(histories, levels)
    return [
        Studied(history, fit, level, change, _followed(flights, history, fit, level, change, beside,
                                                   among))
        for history, fit, level, change, beside in zip(
            histories, fits, levels, changes, compared, strict=True
        )
    ]  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Among:
    """How many histories are tested for a change, and how many numbers are tested as outliers."""

    histories: int
    numbers: int


def _fits(histories: Sequence[History]) -> list[Fitted]:
    """Return the fit of each history; those of one loop and quantity share their scatter."""
    alike: dict[tuple[str, str], list[int]] = {}
    for i, history in enumerate(histories):
        alike.setdefault((history.loop, history.quantity), []).append(i)
    found: dict[int, Fitted] = {}
    numbers = [[histories[i].track for i in rows] for rows in alike.values()]
    for rows, fits in zip(alike.values(), fit_fleets(numbers), strict=True):
        found |= zip(rows, fits, strict=True)
    return [found[i] for i in range(len(histories))]


def _compared(histories: Sequence[History], levels: Sequence[Level]) -> list[Beside | None]:
    """Compare the levels of vehicles of one type and loop."""
    alike: dict[tuple[object, ...], list[int]] = {}
    for i, history in enumerate(histories):
        alike.setdefault((history.vehicle_type, history.loop, history.quantity), []).append(i)
    found: list[Beside | None] = [None] * len(histories)
    for rows in alike.values():
        value = np.array([levels[i].value for i in rows])
        std = np.array([levels[i].std for i in rows])
        for i, beside in zip(rows, compare(value, std), strict=True):
            found[i] = None if beside is None else _among_others(beside, len(rows), len(histories))
    return found


def _among_others(found: Compared, vehicles: int, tested: int) -> Beside:
    p = min(1.0, found.p * tested)
    return Beside(
        vehicles=vehicles, median=found.median, sigmas=found.z, p=p, stands_out=p <= FALSE_ALARMS
    )


def _followed(
    flights: Flights,
    history: History,
    fit: Fitted,
    level: Level,
    change: Change | None,
    beside: Beside | None,
    among: _Among,
) -> Followed:
    dates, n = history.track.dates, len(history.flights)
    clear = fit.change if fit.change is not None and _is_clear(fit.change, among) else None
    years = (dates - dates[0]) / YEAR_US
    by_year = None
    if years[-1] >= LEAST_SPAN_YEARS:
        by_year = slope_of(years, fit, level.kept)
    by_flight = slope_of(np.arange(n, dtype=float), fit, level.kept)
    return Followed(
        vehicle=history.vehicle,
        loop=history.loop,
        quantity=history.quantity,
        unit=QUANTITIES[history.quantity].unit_for(),
        flights=n,
        days=len(fit.days.value),
        first_date=date(dates[0]),
        last_date=date(dates[-1]),
        now=Value(value=level.value, std=level.std),
        between_std=level.tau,
        slope_per_year=_value(by_year),
        slope_per_flight=_value(by_flight),
        tested=fit.change is not None,
        change=None if change is None else _changed(flights, history, fit, change, change.p, among),
        may_be_season=None
        if change is not None or clear is None
        else _changed(flights, history, fit, clear, clear.p_if_no_season, among),
        season=_yearly(level),
        outliers=_outliers(flights, history, fit, level, among.numbers),
        beside=beside,
    )


def _value(found: tuple[float, float] | None) -> Value | None:
    return None if found is None else Value(value=found[0], std=found[1])


def _is_clear(change: Change, among: _Among) -> bool:
    """Return whether something changed, even if a season may explain it."""
    return change.p_if_no_season * among.histories <= FALSE_ALARMS


def _yearly(level: Level) -> Yearly | None:
    season = level.season
    if season is None:
        return None
    day = date(round((A_YEAR + season.peak) * YEAR_US))[5:10]
    return Yearly(amplitude=Value(value=season.amplitude, std=season.std), peak=day)


def _changed(
    flights: Flights, history: History, fit: Fitted, change: Change, p: float, among: _Among
) -> Changed:
    difference = change.after - change.before
    dates = history.track.dates
    first, last = int(fit.days.last[change.first]), int(fit.days.first[change.last])
    return Changed(
        kind="step" if change.is_step else "slope",
        from_flight=first + 1,
        to_flight=last + 1,
        from_date=date(dates[first]),
        to_date=date(dates[last]),
        before=change.before,
        after=change.after,
        difference=difference,
        std=change.std,
        sigmas=change.t,
        percent=100.0 * difference / abs(change.before) if change.before else None,
        p=min(1.0, p * among.histories),
        measured_otherwise=measured_otherwise(flights, history, first, last),
    )


def _outliers(
    flights: Flights, history: History, fit: Fitted, level: Level, numbers: int
) -> list[Outlier]:
    found = []
    for i, z in enumerate(level.z):
        p = min(1.0, numbers * two_sided(z, fit.dof)) if fit.dof > 0 else 1.0
        if p <= FALSE_ALARMS:
            row = flights.rows[history.flights[i]]
            outlier = Outlier(
                flight=i + 1, date=date(history.track.dates[i]), log_sha256=row["log_sha256"],
                boot=row["boot"], value=float(history.track.value[i]), sigmas=float(z), p=p,
            )  # fmt: skip
            found.append(outlier)
    return found


def date(us: int) -> str:
    """Return a time in us since 1970 as ISO 8601 in UTC."""
    return datetime.fromtimestamp(int(us) / 1e6, UTC).isoformat(timespec="seconds")
