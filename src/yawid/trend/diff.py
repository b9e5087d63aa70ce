"""``yawid diff``: compares two finished runs, two data sets, or a run with a data set.

A number has changed if the total sigmas of both sides do not explain its difference, with the
false-alarm rate FALSE_ALARMS for all numbers judged together. The numbers of a data set are the
levels of its vehicles at their last flight. Their scatter is estimated from the days flown, so the
difference is judged by Student's t with the degrees of freedom of the days and the fleet
(trend/moderated.py). A run that is compared with a data set counts as one more flight of it: it
also scatters by tau, and the flights of its own log are left out of the data set.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from msgspec.structs import replace

from yawid.answers.damper_report import FlownGain
from yawid.answers.heard import PARAMETERS, parameters_in
from yawid.answers.part import Part, says
from yawid.answers.run_summary import Value
from yawid.damper.before_after import BeforeAfter, before_after
from yawid.damper.identified import Facts
from yawid.dataset.summary_rows import flight_rows
from yawid.dataset.values import serial_of
from yawid.sinks.mcap.reader import McapRun, open_answered
from yawid.system.stores import Place, brought
from yawid.trend.changes import scatter
from yawid.trend.days import solve_tau2
from yawid.trend.history import FOLLOWED, NO_LOOP, FlightRow, mixed, read_flights
from yawid.trend.moderated import two_sided
from yawid.trend.trend import FALSE_ALARMS, Studied, study

LEAST_OWN: Final = 3
"""Least number of days flown (or of vehicles) for comparing a run with its own vehicle (or with all
vehicles)."""
ALL: Final = 1e9
"""Degrees of freedom of a sigma that is assumed to be exact."""
SAME_SPEED: Final = 0.02
"""Airspeeds that differ by at most this fraction count as equal."""
CANNOT_TELL: Final = "cannot tell"
EFFECT: Final = "effect_per_V2"
"""The size of the rudder's effect on the Dutch roll over V^2, compared where a damper was flown."""
_RUN_QUANTITIES: Final = {"wn_rad_s": "wn_std"} | FOLLOWED


class Difference(Part, frozen=True, kw_only=True):
    """A number of both sides, and the difference B less A, also in sigmas of the difference.

    ``not_judged`` is why the difference says nothing; it begins with CANNOT_TELL where a side is
    so uncertain that it may be 0, and no change shows: to agree with that would mean nothing.
    """

    vehicle: Annotated[str, says("empty for two runs, which are compared whatever the vehicle")]
    loop: Annotated[
        str,
        says(
            "empty for two runs",
            enum=["airframe", "with_roll_loop", "unknown", "bare", "ordinary", ""],
        ),
    ]
    quantity: Annotated[str, says("which number: a column of the data set's flights")]
    a: Annotated[Value, says("what is compared")]
    b: Annotated[Value, says("with what")]
    difference: Annotated[float, says("B minus A", "as unit")]
    sigmas: Annotated[float | None, says("in sigmas", "1")] = None
    p: Annotated[
        float | None, says("probability of as much by chance anywhere in what was tested", "1")
    ] = None
    changed: Annotated[bool, says("whether the difference is beyond what both sigmas explain")]
    not_judged: Annotated[str | None, says("why the difference says nothing about the vehicle")] = (
        None
    )


class Fact(Part, frozen=True, kw_only=True):
    """Something that differs between A and B; ``changed`` if it is a change of the answer."""

    what: Annotated[str, says("which fact")]
    a: Annotated[str, says("what is compared")]
    b: Annotated[str, says("with what")]
    changed: Annotated[bool, says("whether that is a change of the answer")]


class DamperDiff(Part, frozen=True, kw_only=True):
    """Two flights with a yaw damper: is the aircraft without it unchanged, and what was felt.

    ``unchanged`` is None where nothing of it could be judged, ``differ`` has the numbers that did
    change. ``flown`` has every gain of both flights.
    """

    parameter: Annotated[str, says("the autopilot's parameter of the gain")]
    unchanged: Annotated[
        bool | None,
        says("whether the aircraft without its damper is the same; absent where not judged"),
    ] = None
    differ: Annotated[list[str], says("which of its numbers changed")]
    flown: Annotated[
        list[FlownGain],
        says("every gain of both flights, with what the other flight's model predicts"),
    ]
    notes: Annotated[list[str], says("what could not be predicted or measured, in words")]


class Diff(Part, frozen=True, kw_only=True):
    """What changed from A to B; ``judged`` is how many numbers were judged.

    ``damper`` is there for two runs of which one at least was flown with a yaw damper.
    """

    a: Annotated[str, says("what is compared")]
    b: Annotated[str, says("with what")]
    changed: Annotated[bool, says("whether anything changed; the exit code is then 7")]
    false_alarm_rate: Annotated[
        float, says("of all data sets or pairs of runs in which nothing changed", "1")
    ]
    judged: Annotated[int, says("numbers judged")]
    numbers: Annotated[list[Difference], says("each number that both sides have")]
    facts: Annotated[list[Fact], says("what else differs")]
    notes: Annotated[list[str], says("what could not be compared, in words")]
    damper: Annotated[
        DamperDiff | None,
        says("what two runs say of the yaw dampers flown; absent where none was flown"),
    ] = None


@dataclass(slots=True)
class _Side:
    """One side of the comparison, a run or a data set.

    ``numbers`` and the degrees of freedom ``dof`` of their sigmas are by (vehicle, loop, quantity).
    ``rows`` are a run's answers by loop, the headline first; ``run`` is that of a run.
    """

    path: Place
    numbers: dict[tuple[str, str, str], Value] = field(default_factory=dict)
    dof: dict[tuple[str, str, str], float] = field(default_factory=dict)
    rows: dict[str, FlightRow] = field(default_factory=dict)
    run: McapRun | None = None


def diff(a: Place, b: Place) -> Diff:
    """Return what changed from A to B.

    Raises:
        SourceError: one of them is neither a finished run nor a data set.
    """
    with ExitStack() as stack:
        one, other = (_side(place, stack) for place in (a, b))
        return _compared(one, other)


def _compared(one: _Side, other: _Side) -> Diff:
    if one.run is not None and other.run is not None:
        flown = _before_after(one, other)
        result = _result(one, other, list(_of_runs(one, other)), [])
        return result if flown is None else replace(result, damper=_of_dampers(result, flown))
    notes: list[str] = []
    for run, fleet, name in ((one, other, "B"), (other, one, "A")):
        if fleet.run is None and isinstance(fleet.path, Path):
            sha256 = None if run.run is None else run.run.summary.own_source.sha256
            flights = read_flights(fleet.path, sha256)
            notes += [f"warning {each.id} in {name}: {each.text}" for each in mixed(flights)]
            studied = study(flights)
            for each in studied:
                key = (each.history.vehicle, each.history.loop, each.history.quantity)
                fleet.numbers[key], fleet.dof[key] = each.followed.now, each.fitted.dof
            if run.run is not None:
                _pick(run, fleet, studied, notes)
    for side, opposite, name in ((one, other, "A"), (other, one, "B")):
        alone = {key[:2] for key in side.numbers} - {key[:2] for key in opposite.numbers}
        if alone:
            said = ", ".join(f"{vehicle} ({loop})" for vehicle, loop in sorted(alone)[:8])
            notes.append(f"only in {name}: {said}{', …' if len(alone) > 8 else ''}")
    return _result(one, other, [], notes)


def _before_after(a: _Side, b: _Side) -> BeforeAfter | None:
    """Return what the flights of two runs say of their yaw dampers, None where none was flown.

    The rudder's effect on the Dutch roll becomes a number of both sides.
    """
    facts = [_facts(side.run) for side in (a, b) if side.run is not None]
    if facts[0] is None or facts[1] is None:
        return None
    found = before_after(facts[0], facts[1])
    for side, name in ((a, "A"), (b, "B")):
        if found is not None and name in found.effect and side.run is not None:
            loop = next(iter(side.rows))
            side.numbers[_vehicle(side.run), loop, EFFECT] = found.effect[name]
    return found


def _facts(run: McapRun) -> Facts | None:
    if run.grid is None or not run.rows:
        return None
    known = parameters_in(run.attachments.get(PARAMETERS, b""))
    return Facts(run.summary, run.config, run.grid.sample_time_s, list(run.samples()), known)


def _of_dampers(result: Diff, found: BeforeAfter) -> DamperDiff:
    """Return what the dampers say, with the verdict on the aircraft without them."""
    judged = [each for each in result.numbers if each.not_judged is None]
    differ = [each.quantity for each in judged if each.changed]
    return DamperDiff(
        parameter=found.parameter, unchanged=not differ if judged else None, differ=differ,
        flown=found.flown, notes=found.notes,
    )  # fmt: skip


def _side(path: Place, stack: ExitStack) -> _Side:
    """Return a side; a run in a store is copied, and its copy is removed when ``stack`` ends."""
    if isinstance(path, Path) and path.is_dir():
        return _Side(path)
    run = open_answered(stack.enter_context(brought(path)))
    rows: dict[str, FlightRow] = {
        row.get("loop") or NO_LOOP: row for row in flight_rows(run.summary, None, None)
    }
    vehicle = _vehicle(run)
    numbers = {
        (vehicle, loop, quantity): Value(value=row[quantity], std=row[std])
        for loop, row in rows.items()
        for quantity, std in _RUN_QUANTITIES.items()
        if row.get(quantity) is not None and row.get(std) is not None
    }
    return _Side(path, numbers, rows=rows, run=run)


def _vehicle(run: McapRun) -> str:
    seen = run.summary.vehicle
    return "unknown" if seen is None else f"sysid:{seen.sysid}"


def _pick(run: _Side, fleet: _Side, studied: list[Studied], notes: list[str]) -> None:
    """Reduce a data set to a run's vehicle, else all, with the sigmas of one more flight."""
    loops = list(run.rows)
    own = [each for each in studied if each.history.loop in loops]
    vehicle = _own_vehicle(run, own)
    run.numbers = {
        (vehicle or key[0], *key[1:]): value
        for key, value in run.numbers.items()
        if key[2] in FOLLOWED
    }
    fleet.numbers, fleet.dof = {}, {}
    for key, value in run.numbers.items():
        of = f" ({key[1]})" if len(loops) > 1 else ""
        alike = [each for each in own if (each.history.loop, each.history.quantity) == key[1:]]
        mine = [each for each in alike if each.history.vehicle == vehicle]
        sigma = value.std or 0.0
        if mine and mine[0].followed.days >= LEAST_OWN:
            fleet.numbers[key], fleet.dof[key] = one_more(mine[0], sigma), mine[0].fitted.dof
        elif len(alike) >= LEAST_OWN:
            fleet.numbers[key], fleet.dof[key] = _among(alike, sigma), len(alike) - 1.0
            notes.append(f"{key[2]}{of}: compared with all {len(alike)} vehicles")
    if not fleet.numbers:
        notes.append(_nothing(run, fleet, studied, own, " and ".join(loops), vehicle))


def one_more(each: Studied, sigma: float) -> Value:
    """Return the prediction of a vehicle's next flight, whose own ``sigma`` is not in its std."""
    fitted, level = each.fitted, each.level
    # scatter() contains sigma and tau.
    whole = scatter(np.array(sigma), fitted.tau**2, fitted.s2) + level.std**2
    return Value(value=level.value, std=float(np.sqrt(level.excess * whole - sigma**2)))


def _among(alike: list[Studied], sigma: float) -> Value:
    """Return the prediction of a flight of one more vehicle, whose own ``sigma`` is not in its std.

    ``alike`` are the histories of the same quantity in the vehicles known.
    """
    values = np.array([each.level.value for each in alike])
    value, count = float(np.median(values)), len(values)
    stds = np.array([each.level.std for each in alike])
    # 1.57 is the variance of a median over that of a mean.
    apart = solve_tau2((values - value) ** 2 * count / (count - 1), stds**2) * (1.0 + 1.57 / count)
    beyond = np.median([one_more(each, sigma).std or 0.0 for each in alike])
    return Value(value=value, std=float(np.hypot(np.sqrt(apart), beyond)))


def _nothing(
    run: _Side, fleet: _Side, studied: list[Studied], own: list[Studied], loop: str,
    vehicle: str | None,
) -> str:  # fmt: skip
    """Return in words why a data set has nothing to compare a run with."""
    if not studied:
        return f"{fleet.path} has no usable flight with a date, a number and its sigma"
    if not run.numbers:
        return f"{run.path} has none of {', '.join(FOLLOWED)} with its sigma"
    if not own:
        loops = ", ".join(sorted({each.history.loop for each in studied}))
        return f"{fleet.path} has flights of the loop {loops}; {run.path} is of {loop}"
    mine = [each.followed for each in own if each.history.vehicle == vehicle]
    has = "no flight of this vehicle" if not mine else (
        f"{mine[0].flights} flights of {vehicle} on {mine[0].days} days"
    )  # fmt: skip
    vehicles = len({each.history.vehicle for each in own})
    return (
        f"{fleet.path} has {has}, and {vehicles} vehicles: to compare a run, {LEAST_OWN} days of "
        f"its own vehicle are needed, or {LEAST_OWN} vehicles"
    )


def _own_vehicle(run: _Side, studied: list[Studied]) -> str | None:
    """Return the run's vehicle as the data set names it; None if it cannot be identified."""
    assert run.run is not None
    seen = run.run.summary.vehicle
    names = {each.history.vehicle for each in studied}
    serial = serial_of(run.run.attachments.get(PARAMETERS, b""))
    if serial in names:
        return serial
    found = {each.history.vehicle for each in studied if seen and each.history.sysid == seen.sysid}
    return found.pop() if len(found) == 1 else None


def _result(a: _Side, b: _Side, facts: list[Fact], notes: list[str]) -> Diff:
    a_numbers, b_numbers = a.numbers, b.numbers
    if a.rows and b.rows:
        a_numbers, b_numbers = _alike(a, b), _alike(b, a)
    both = {key for key in a_numbers if key in b_numbers}
    pairs = [(key, a_numbers[key], b_numbers[key]) for key in a_numbers if key in both]
    dofs = [[side.dof.get(key, ALL) for side in (a, b)] for key, *_ in pairs]
    why = [
        _not_judged(a, b, key, both) or (None if min(dof) > 0 else "too few days flown")
        for (key, *_), dof in zip(pairs, dofs, strict=True)
    ]
    count = sum(each is None for each in why)
    numbers = [_difference(*each, count) for each in zip(pairs, why, dofs, strict=True)]
    judged = sum(each.not_judged is None for each in numbers)
    if not numbers:
        notes.append("no number is in both A and B")
    return Diff(
        a=str(a.path.absolute()),
        b=str(b.path.absolute()),
        changed=any(each.changed for each in numbers) or any(each.changed for each in facts),
        false_alarm_rate=FALSE_ALARMS,
        judged=judged,
        numbers=numbers,
        facts=facts,
        notes=notes,
    )


def _alike(run: _Side, other: _Side) -> dict[tuple[str, str, str], Value]:
    """Return a run's numbers for the loops that both runs have, whatever the vehicles' names are.

    Without such a loop they are the headline's, with an empty loop.
    """
    both, first = run.rows.keys() & other.rows.keys(), next(iter(run.rows))
    return {
        ("", loop if both else "", quantity): value
        for (_, loop, quantity), value in run.numbers.items()
        if (loop in both if both else loop == first)
    }


def _not_judged(
    a: _Side, b: _Side, key: tuple[str, str, str], both: set[tuple[str, str, str]]
) -> str | None:
    """Return in words why a difference cannot be judged, or None if it can be."""
    vehicle, loop, quantity = key
    rows = [side.rows.get(loop) or next(iter(side.rows.values()), None) for side in (a, b)]
    for row, name in zip(rows, "AB", strict=True):
        if row is not None and not row["usable"]:
            why = ", ".join(row["reasons"])
            return f"{name} is not usable: {why}" if why else f"{name} has no verdict"
    if rows[0] is None or rows[1] is None:
        return None
    if not loop:
        return "another loop"
    if quantity == "wn_rad_s":
        if (vehicle, loop, "kappa_rad_m") in both:
            return "varies with the airspeed: see wn/V"
        one, other = (_airspeed(row) for row in rows if row is not None)
        if one is None or other is None:
            return "varies with the airspeed, which is unknown"
        if abs(other / one - 1.0) > SAME_SPEED:
            return "another airspeed"
    return None


def _airspeed(row: FlightRow) -> float | None:
    """Return the airspeed of a run in m/s; None if it is unknown or only a ground speed."""
    return row.get("airspeed_m_s") if row.get("airspeed_source") == "airspeed" else None


def _difference(
    pair: tuple[tuple[str, str, str], Value, Value], not_judged: str | None,
    dofs: Sequence[float], judged: int,
) -> Difference:  # fmt: skip
    (vehicle, loop, quantity), a, b = pair
    assert a.value is not None
    assert b.value is not None
    difference = b.value - a.value
    std = float(np.hypot(a.std or 0.0, b.std or 0.0))
    z = difference / std if std > 0.0 else None
    p = None if z is None or not_judged else min(1.0, judged * two_sided(z, min(dofs)))
    changed = p is not None and p <= FALSE_ALARMS
    if p is not None and not changed and (unknown := _may_be_0(a, b, dofs, judged)):
        p, not_judged = None, f"{CANNOT_TELL}: {unknown}"
    return Difference(
        vehicle=vehicle, loop=loop, quantity=quantity, a=a, b=b, difference=difference, sigmas=z,
        p=p, changed=changed, not_judged=not_judged,
    )  # fmt: skip


def _may_be_0(a: Value, b: Value, dofs: Sequence[float], judged: int) -> str:
    """Return in words which sides may be 0 as far as their sigmas go, "" where none may."""
    said = []
    for side, name, dof in zip((a, b), "AB", dofs, strict=True):
        size, std = abs(side.value or 0.0), side.std or 0.0
        if std > 0.0 and judged * two_sided(size / std, dof) > FALSE_ALARMS:
            percent = min(100.0 * std / size, 999.0) if size else 999.0
            said.append(f"{name} has a sigma of {percent:.0f} %")
    return " and ".join(said)


def _of_runs(a: _Side, b: _Side) -> Iterator[Fact]:
    """Yield what differs between two runs: verdict, reasons, loop, channels, settings, versions.

    A different verdict or channel counts as a change, the others do not.
    """
    runs = [side.run for side in (a, b) if side.run is not None]
    verdicts = [run.summary.deciding for run in runs]
    found = [
        ("verdict", [each.word for each in verdicts], True),
        ("reasons", [", ".join(r.id for r in each.reasons) or "none" for each in verdicts], False),
        ("loop", [" and ".join(each.rows) for each in (a, b)], False),
    ]
    channels = [{n: each.source for n, each in run.summary.channels.items()} for run in runs]
    found += [(f"channel {name}", pair, True) for name, pair in _by_name(channels)]
    for part, what in (("configuration", "configuration"), ("versions", "version")):
        settings = _by_name([run.metadata.get(part, {}) for run in runs])
        found += [(f"{what} {name}", pair, False) for name, pair in settings]
    for what, (one, other), changed in found:
        if one != other:
            yield Fact(what=what, a=one, b=other, changed=changed)


def _by_name(sides: Sequence[Mapping[str, str]]) -> Iterator[tuple[str, list[str]]]:
    """Yield each name with its text on both sides, "none" where a side does not have it."""
    for name in sorted({*sides[0], *sides[1]}):
        yield name, [side.get(name, "none") for side in sides]
