"""``yawid trend``: every vehicle's wn/V, zeta and K/V over its flights, and what has changed.

The false-alarm rate holds for the whole data set and for all tests of it, one after every day
flown: among data sets in which nothing changed, a fraction FALSE_ALARMS ever reports a change in
any history (Bonferroni over the histories tested). A change that a season may explain is not
reported as one before there are two years of flights. Outliers and vehicles that stand out are
reported at the same rate for a single test; they do not count as changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np

from yawid.answers.part import Part, named, says
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Value
from yawid.errors import ConfigError
from yawid.quantities.table import QUANTITIES
from yawid.trend.changes import Change, Fitted, fit_fleets
from yawid.trend.days import YEAR_US, alike, date
from yawid.trend.history import Flights, History, measured_otherwise, mixed, read_flights
from yawid.trend.levels import Level, Yearly, compare, level_of, slope_of
from yawid.trend.moderated import two_sided

FALSE_ALARMS: Final = 0.01
"""Rate of false alarms of a whole data set."""
LEAST_COMPARED: Final = 5
"""Least number of vehicles for comparing each with the others."""
LEAST_SPAN_YEARS: Final = 1.0 / 12.0
"""Least time from the first flight to the last for a slope per year: a few days do not show one."""


class Changed(Part, frozen=True, kw_only=True):
    """A change: a ``step`` between two days or a ``slope`` over several; flights count from 1.

    ``p`` is the probability that any history of an unchanged data set shows a change as clear as
    this in any test. For a possible season it is the probability if there were no seasons.
    """

    kind: Annotated[str, says("step or slope", enum=["step", "slope"])]
    from_flight: Annotated[int, says("the last flight before it, from 1")]
    to_flight: Annotated[int, says("the first flight after it")]
    from_date: Annotated[str, says("of that flight")]
    to_date: Annotated[str, says("of that flight")]
    before: Annotated[float, says("level before it", "as unit")]
    after: Annotated[float, says("level after it", "as unit")]
    difference: Annotated[float, says("after minus before", "as unit")]
    std: Annotated[
        float, says("sigma of the difference, in its unit", "as the quantity it belongs to")
    ]
    sigmas: Annotated[float, says("in sigmas", "1")]
    percent: Annotated[float | None, says("the difference in percent of the level before", "%")] = (
        None
    )
    p: Annotated[
        float,
        says("probability of as much by chance in any history and at any look, one each day", "1"),
    ]
    measured_otherwise: Annotated[list[str], says("what else changed with it: that may be why")]


class Outlier(Part, frozen=True, kw_only=True):
    """A flight far off the others; its distance is in sigmas (its own sigma and tau together)."""

    flight: Annotated[int, says("number of the flight, from 1")]
    date: Annotated[str, says("UTC time of the flight, ISO 8601")]
    log_sha256: Annotated[str | None, says("of its log")] = None
    boot: int | None = None
    value: Annotated[float, says("what it says", "as the quantity it belongs to")]
    sigmas: Annotated[float, says("in sigmas", "1")]
    p: Annotated[float, says("probability of as much by chance anywhere in what was tested", "1")]


class Beside(Part, frozen=True, kw_only=True):
    """A vehicle compared with all of its type and loop: their median, its distance in sigmas."""

    vehicles: Annotated[int, says("how many there are")]
    median: Annotated[float, says("of all of them", "as unit")]
    sigmas: Annotated[float, says("in sigmas", "1")]
    p: Annotated[float, says("probability of as much by chance anywhere in what was tested", "1")]
    stands_out: Annotated[bool, says("whether it is further off than chance explains")]


class Followed(Part, frozen=True, kw_only=True):
    """One number of one vehicle over its flights; ``now`` is its level after the last change.

    ``between_std`` is the scatter of the flights that their own sigmas do not explain. ``tested``
    is whether there were enough days to look for a change. ``may_be_season`` is a clear change that
    a season may explain, as there are fewer than two years of flights to show one.
    """

    vehicle: Annotated[str, says("as the data set names it")]
    loop: Annotated[
        str,
        says(
            "whose number it is: each loop is a history of its own, and so is the bare airframe",
            enum=["airframe", "with_roll_loop", "unknown", "bare", "ordinary"],
        ),
    ]
    quantity: Annotated[str, says("which number: a column of the data set's flights")]
    unit: Annotated[str, says("of the number")]
    flights: Annotated[int, says("flights of this history")]
    days: Annotated[int, says("days flown: flights of one day count as one")]
    first_date: Annotated[str, says("of its first flight")]
    last_date: Annotated[str, says("of its last flight")]
    now: Annotated[Value, says("its level after the last change", "of the parameter")]
    between_std: Annotated[
        float | None, says("tau, by how much flights scatter beyond their own sigmas", "as unit")
    ] = None
    slope_per_year: Annotated[
        Value | None, says("absent where the flights cover less than a month")
    ] = None
    slope_per_flight: Annotated[Value | None, says("from one flight to the next")] = None
    tested: Annotated[bool, says("whether there were enough days to look for a change")]
    change: Annotated[Changed | None, says("the change found, absent where there is none")] = None
    may_be_season: Annotated[
        Changed | None,
        says("a clear change that may be a season, until two years show which: no alarm"),
    ] = None
    season: Annotated[
        Yearly | None, says("what returns every year; absent where fewer than two years show it")
    ] = None
    outliers: Annotated[list[Outlier], says("flights far off the others")]
    beside: Annotated[
        Beside | None, says("this vehicle next to the others of its type and loop")
    ] = None


class Trend(Part, frozen=True, kw_only=True):
    """The trends of all vehicles in a data set; ``judged`` is how many of ``followed`` were tested.

    ``warnings`` name the ids under which several aircraft seem to fly.
    """

    dataset: Annotated[str, says("absolute path of the data set")]
    changed: Annotated[bool, says("whether anything changed; the exit code is then 7")]
    judged: Annotated[
        int, says("histories of those followed that were tested; none: the exit code is 5")
    ]
    warnings: Annotated[list[Reason], says("ids under which several aircraft seem to fly")]
    false_alarm_rate: Annotated[
        float, says("of all data sets or pairs of runs in which nothing changed", "1")
    ]
    histories_tested: Annotated[int, says("histories with enough days to look for a change")]
    numbers_tested: Annotated[int, says("numbers of flights looked at for outliers")]
    flights: Annotated[int, says("flights looked at")]
    left_out: Annotated[
        dict[str, int],
        says(
            "number of flights left out, by reason",
            **named(
                **{
                    "not usable": "",
                    "without a date": "",
                    "without a number and its sigma": "of an answer",
                }
            ),
        ),
    ]
    followed: Annotated[list[Followed], says("each number of each vehicle over its flights")]


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
    tested = sum(fit.change is not None for fit in fits)
    numbers = sum(len(history.flights) for history in histories)
    changes = [
        fit.change if fit.change is not None and fit.change.p * tested <= FALSE_ALARMS else None
        for fit in fits
    ]
    tracks = [history.track for history in histories]
    levels = [level_of(*each) for each in zip(tracks, fits, changes, strict=True)]
    compared = _compared(histories, levels)
    return [
        Studied(history, fit, level, change, _followed(flights, history, fit, level, change, beside,
                                                   tested, numbers))
        for history, fit, level, change, beside in zip(
            histories, fits, levels, changes, compared, strict=True
        )
    ]  # fmt: skip


def _fits(histories: Sequence[History]) -> list[Fitted]:
    """Return the fit of each history; those of one loop and quantity share their scatter."""
    fleets = alike(range(len(histories)), lambda i: (histories[i].loop, histories[i].quantity))
    found: dict[int, Fitted] = {}
    numbers = [[histories[i].track for i in rows] for rows in fleets]
    for rows, fits in zip(fleets, fit_fleets(numbers), strict=True):
        found |= zip(rows, fits, strict=True)
    return [found[i] for i in range(len(histories))]


def _compared(histories: Sequence[History], levels: Sequence[Level]) -> list[Beside | None]:
    """Compare the levels of vehicles of one type and loop; None where they are too few."""

    def kind(i: int) -> tuple[int | None, str, str]:
        return histories[i].vehicle_type, histories[i].loop, histories[i].quantity

    found: list[Beside | None] = [None] * len(histories)
    for rows in alike(range(len(histories)), kind):
        if (count := len(rows)) >= LEAST_COMPARED:
            value = np.array([levels[i].value for i in rows])
            median, away = compare(value, np.array([levels[i].std for i in rows]))
            for i, z in zip(rows, away.tolist(), strict=True):
                p = min(1.0, two_sided(z, count - 1.0) * len(histories))
                found[i] = Beside(
                    vehicles=count, median=median, sigmas=z, p=p, stands_out=p <= FALSE_ALARMS
                )
    return found


def _followed(
    flights: Flights,
    history: History,
    fit: Fitted,
    level: Level,
    change: Change | None,
    beside: Beside | None,
    tested: int,
    numbers: int,
) -> Followed:
    """Return the results of a history among ``tested`` histories with ``numbers`` in all."""
    dates, n, clear = history.track.dates, len(history.flights), fit.change
    if clear is not None and clear.p_if_no_season * tested > FALSE_ALARMS:
        clear = None
    years = (dates - dates[0]) / YEAR_US
    is_long = years[-1] >= LEAST_SPAN_YEARS
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
        slope_per_year=slope_of(years, fit, level.kept) if is_long else None,
        slope_per_flight=slope_of(np.arange(n, dtype=float), fit, level.kept),
        tested=fit.change is not None,
        change=None
        if change is None
        else _changed(flights, history, fit, change, change.p, tested),
        may_be_season=None
        if change is not None or clear is None
        else _changed(flights, history, fit, clear, clear.p_if_no_season, tested),
        season=level.season,
        outliers=_outliers(flights, history, fit, level, numbers),
        beside=beside,
    )


def _changed(
    flights: Flights, history: History, fit: Fitted, change: Change, p: float, tested: int
) -> Changed:
    difference = change.after - change.before
    dates = history.track.dates
    days = fit.days.day
    first = int(np.searchsorted(days, change.first, side="right")) - 1
    last = int(np.searchsorted(days, change.last))
    return Changed(
        kind="step" if change.last == change.first + 1 else "slope",
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
        p=min(1.0, p * tested),
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
