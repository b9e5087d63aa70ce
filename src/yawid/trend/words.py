"""Trends in words, for the terminal and the page."""

from typing import Final

from yawid.answers.run_summary import Value
from yawid.quantities.table import QUANTITIES
from yawid.sinks.words import GREEK, plus_minus
from yawid.trend.best_profile import LEAST_DAYS, LEAST_SIDE
from yawid.trend.changes import SEASON
from yawid.trend.diff import EFFECT
from yawid.trend.history import BY_SYSID, FOLLOWED
from yawid.trend.trend import Changed, Followed, Outlier, Trend


def name_of(quantity: str, names: tuple[str, str] = GREEK) -> str:
    """Return the name of a quantity for people: of a page, or for a terminal that of LATIN."""
    has_symbol = quantity in FOLLOWED or quantity in (EFFECT, "wn_rad_s")
    found = QUANTITIES[quantity].symbol if has_symbol else quantity
    for greek, name in zip(GREEK, names, strict=True):
        found = found.replace(greek, name)
    return found


def spread(value: Value | None) -> str:
    """Return a value with one sigma in words, or ``-`` if there is no value."""
    if value is None or value.value is None:
        return "-"
    return plus_minus(value.value, value.std)


def change_line(change: Changed) -> str:
    """Return in words what changed, when, by how much and how sure that is."""
    verb = "fell" if change.difference < 0.0 else "rose"
    size = "" if change.percent is None else f" by {abs(change.percent):.0f} %"
    when = f"{change.from_date[:10]} and {change.to_date[:10]}"
    how = "from one day to the next" if change.kind == "step" else "slowly"
    numbers = f"{change.from_flight} and {change.to_flight}"
    return (
        f"{verb}{size}, {how}, between {when} (flights {numbers}): {change.before:.4g} to "
        f"{change.after:.4g}, {abs(change.sigmas):.1f} sigma, p {change.p:.1g}"
    )


def season_line(change: Changed) -> str:
    """Return in words what may be a change or a season."""
    return f"{change_line(change)}; a season may do the same: two years of flights show which it is"


def outlier_line(outlier: Outlier) -> str:
    """Return in words which flight is far off, and by how much."""
    return f"{outlier.date[:10]} (flight {outlier.flight}) {outlier.sigmas:+.1f} sigma"


def result(each: Followed) -> str:
    """Return the result for one number of one vehicle in a few words."""
    said = []
    for word, change in (("CHANGED", each.change), ("a season?", each.may_be_season)):
        if change is not None:
            said.append(word if change.percent is None else f"{word} {change.percent:+.0f} %")
    if not each.tested:
        said.append("too few days")
    if each.outliers:
        said.append(f"{len(each.outliers)} outlier{'s' if len(each.outliers) > 1 else ''}")
    if each.beside is not None and each.beside.stands_out:
        said.append(f"{each.beside.sigmas:+.1f} sigma off the others")
    return ", ".join(said) or "steady"


def flights_line(report: Trend) -> str:
    """Return in words how many flights there are, and how many were left out and why."""
    left = ", ".join(f"{count} {why}" for why, count in report.left_out.items())
    text = f"{report.flights} flights" + (f", left out: {left}" if left else "")
    if any(each.vehicle.startswith(BY_SYSID) for each in report.followed):
        text += (
            "; sysid:N is a MAVLink id, used where no serial number is known; several aircraft may "
            "share it"
        )
    return text


def not_tested(report: Trend) -> str:
    """Return in words why nothing was tested."""
    most = max((each.days for each in report.followed), default=0)
    return f"nothing was tested: {LEAST_DAYS} days flown are needed, there are {most}"


def rate_line(report: Trend) -> str:
    """Return in words what was tested, and how often the tests give false alarms."""
    rate = 100.0 * report.false_alarm_rate
    return (
        f"false alarms: {rate:g} % of data sets in which nothing changed, over all "
        f"{report.histories_tested} histories tested and all looks, one after each day flown; "
        f"outliers likewise, over {report.numbers_tested} numbers in one look"
    )


LIMITS: Final = (
    f"A change needs {LEAST_DAYS} days flown, {LEAST_SIDE} of them on each side of its middle: "
    "flights of one day count as one.",
    f"A season may swing a number by {100.0 * SEASON:g} % either way: with less than two years, a "
    "change that is no clearer than that is called a season, and is no alarm. With two years the "
    "season is estimated. A larger season in the first two years is reported as a change.",
    "What all flights of several days have in common (a campaign, a pilot, a load, an airspeed "
    "sensor's calibration) cannot be distinguished from a change of the aircraft.",
    "Vehicles that change together are each judged by themselves.",
    "The rate holds for up to 5 % of outliers; with 10 % it is about twice as high.",
)
"""The limits of ``yawid trend``, as its page lists them."""
