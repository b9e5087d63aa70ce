"""The pages of ``yawid trend`` and ``yawid diff``."""

from collections.abc import Iterable, Iterator
from typing import Final

from yawid.answers.damper_report import Decay, FlownGain
from yawid.quantities.table import QUANTITIES
from yawid.quantities.vehicles import AIRFRAME, WITH_ROLL_LOOP
from yawid.sinks.pages import Grid, Note, Part, Said
from yawid.sinks.words import LATIN, Row
from yawid.trend import words
from yawid.trend.diff import CANNOT_TELL, DamperDiff, Diff
from yawid.trend.history import BARE_AIRFRAME, ORDINARY_FLIGHT
from yawid.trend.trend import Trend

MOST_ROWS: Final = 60
"""Most histories without a change that are printed; ``--json`` has all."""
MOST_OUTLIERS: Final = 20
"""Most outliers that are printed; ``--json`` has all."""
LONGEST_NAME: Final = 18
"""The longest name of a vehicle in a table of 80 columns."""


def trend_page(report: Trend) -> Iterator[Part]:
    """Yield a data set's trends: first what changed, then the histories and outliers."""
    yield Note(report.dataset, "bold", wraps=False)
    changed = [each for each in report.followed if each.change is not None]
    if changed:
        yield Row("verdict", f"{len(changed)} CHANGED", "bold red")
    else:
        said = ("steady", "bold green") if report.judged else (
            words.not_tested(report), "bold yellow"
        )  # fmt: skip
        yield Row("verdict", *said)
    for each in report.followed:
        history = f"{each.vehicle} ({each.loop}) {_name(each.quantity)}"
        if each.change is not None:
            yield Said(history, words.change_line(each.change), "red")
            for line in each.change.measured_otherwise:
                yield Said("the measurement changed there too:", line, "yellow")
        elif each.may_be_season is not None:
            yield Said(history, words.season_line(each.may_be_season), "yellow")
    for warning in report.warnings:
        yield Said(f"warning {warning.id}:", warning.text, "yellow")
    yield Note(words.flights_line(report))
    steady = [each for each in report.followed if each.change is None]
    hidden = {id(each) for each in steady[MOST_ROWS:]}
    rows = [each for each in report.followed if id(each) not in hidden]
    whose = [(each.vehicle, each.loop) for each in rows]
    cells = [
        (
            "" if own == before else _named(*own),
            _name(each.quantity),
            str(each.flights),
            words.spread(each.now),
            words.spread(each.slope_per_year),
            "-" if each.between_std is None else f"{each.between_std:.2g}",
            words.result(each),
        )
        for each, own, before in zip(rows, whose, [None, *whose], strict=False)
    ]
    heads = ("vehicle", "", "n", "now", "a year", "between", "result")
    yield Grid(heads, cells, ["" if each.change is None else "red" for each in rows], (0, 1, 6))
    outliers = [(each, one) for each in report.followed for one in each.outliers]
    for each, one in outliers[:MOST_OUTLIERS]:
        yield Said("outlier:", f"{each.vehicle} {_name(each.quantity)} {words.outlier_line(one)}")
    notes = [
        "± is one sigma; now: after the last change; a year: slope of a straight line; "
        "between: scatter of flights beyond their own sigmas" + _units(e.quantity for e in rows),
        *([words.rate_line(report)] if report.judged else []),
    ]
    left = {"histories": len(steady) - MOST_ROWS, "outliers": len(outliers) - MOST_OUTLIERS}
    notes += [f"{count} more {what} are in --json" for what, count in left.items() if count > 0]
    yield Note("; ".join(notes), "dim")


def _name(quantity: str) -> str:
    """Return a quantity's name for the terminal."""
    return words.name_of(quantity, LATIN)


def _units(quantities: Iterable[str]) -> str:
    """Return the units of the numbers in a table, as a note under it."""
    units = {_name(each): QUANTITIES[each].unit_for() for each in quantities}
    return "".join(f"; {name} in {unit}" for name, unit in units.items() if unit)


def _named(vehicle: str, loop: str) -> str:
    """Return a vehicle's name with its loop; an empty loop, as of two runs, has none."""
    loops = {AIRFRAME: "", "": "", WITH_ROLL_LOOP: " roll", BARE_AIRFRAME: " bare",
             ORDINARY_FLIGHT: " ordinary"}  # fmt: skip
    name = (vehicle + loops.get(loop, " ?")).strip()
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"


def diff_page(report: Diff) -> Iterator[Part]:
    """Yield what changed between two sides: numbers, verdict, channels, configuration."""
    yield Note(f"A {report.a}", "bold", wraps=False)
    yield Note(f"B {report.b}", "bold", wraps=False)
    unknown = any((each.not_judged or "").startswith(CANNOT_TELL) for each in report.numbers)
    if report.changed:
        yield Row("verdict", "CHANGED", "bold red")
    elif report.judged:
        yield Row("verdict", "no change", "bold green")
    else:
        said = CANNOT_TELL if unknown else "nothing could be compared"
        yield Row("verdict", said, "bold yellow")
    cells = [
        (
            _named(each.vehicle, each.loop),
            _name(each.quantity),
            words.spread(each.a),
            words.spread(each.b),
            f"{each.difference:+.3g}",
            "-" if each.sigmas is None else f"{each.sigmas:+.1f}",
            "CHANGED" if each.changed else _result(each.not_judged),
        )
        for each in report.numbers
    ]
    heads = ("vehicle", "", "A", "B", "B - A", "sigmas", "result")
    styles = ["red" if each.changed else "" for each in report.numbers]
    yield from [Grid(heads, cells, styles, (0, 1, 6))] if cells else []
    if report.damper is not None:
        yield from _damper_parts(report.damper)
    for fact in report.facts:
        style = "red" if fact.changed else "yellow"
        yield Said(f"{fact.what}:", f"{fact.a} in A, {fact.b} in B", style)
    yield from map(Note, report.notes)
    notes = "± is one total sigma"
    if report.judged:
        rate = 100.0 * report.false_alarm_rate
        notes += (
            f"; changed: beyond what both sigmas explain, at {rate:g} % false alarms over all "
            f"{report.judged} numbers judged"
        )
    yield Note(notes + _units(each.quantity for each in report.numbers), "dim")


def _result(not_judged: str | None) -> str:
    if not_judged is None or not_judged.startswith(CANNOT_TELL):
        return not_judged or "agrees"
    return f"not judged: {not_judged}"


def _damper_parts(report: DamperDiff) -> Iterator[Part]:
    said = {None: ("not judged whether it changed", "yellow"), True: ("unchanged", "green")}.get(
        report.unchanged, (f"CHANGED in {', '.join(map(_name, report.differ))}", "red")
    )
    yield Note(f"the aircraft without its yaw damper  {said[0]}", said[1])
    results = {True: "agrees", False: "DIFFERS", None: "-"}
    rows = [
        (
            each.flight,
            f"{each.gain:g}",
            *(_damped(found) for found in (each, each.decay_predicted, each.decay)),
            results[each.agrees],
        )
        for each in report.flown
    ]
    if rows:
        heads = ("", report.parameter, "pair predicted", "decay predicted", "decay flown", "")
        yield Grid(heads, rows, texts=(0, len(heads) - 1))
        yield Note(
            "wn in rad/s / zeta. Pair: the Dutch roll with that gain, predicted from the other "
            "flight. Decay: a damped sine fitted to the free decays, which near a servo's lag is "
            "not the pair: compare the two fits",
            "dim",
        )
    yield from map(Note, report.notes)


def _damped(found: Decay | FlownGain | None) -> str:
    if found is None or found.wn_rad_s is None or found.zeta is None:
        return "-"
    std = "" if found.zeta_std is None else f" ± {found.zeta_std:.2f}"
    return f"{found.wn_rad_s:.3g} / {found.zeta:.2f}{std}"
