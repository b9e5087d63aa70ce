"""``yawid diff``: two finished runs, two data sets, or a run against its fleet.

A number has changed where its difference is beyond what the total sigmas of both sides explain, at
FALSE_ALARMS over all the numbers judged. A data set's side is where each vehicle stands at its end.
A run beside a data set is one flight more: tau, by which flights scatter, is added to its sigma,
and the run's own log is left out of the data set.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.special import ndtr

from yawid.dataset.summary_rows import flight_row
from yawid.dataset.values import serial_of
from yawid.results.run_summary import Part, Value
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.trend.days import solve_tau2
from yawid.trend.history import NO_LOOP, QUANTITIES, read_flights
from yawid.trend.trend import FALSE_ALARMS, Studied, study

LEAST_OWN: Final = 3
"""Flights of a vehicle, below which a run of it is compared with all vehicles."""
SAME_SPEED: Final = 0.02
_RUN_QUANTITIES: Final = {"wn_rad_s": "wn_std"} | {q: std for q, (std, *_) in QUANTITIES.items()}


class Difference(Part, frozen=True, kw_only=True):
    """A number of both sides, B less A, and by how many sigmas of the difference."""

    vehicle: str
    loop: str
    quantity: str
    a: Value
    b: Value
    difference: float
    sigmas: float | None = None
    p: float | None = None
    changed: bool
    not_judged: str | None = None


class Fact(Part, frozen=True, kw_only=True):
    """What stands otherwise in B than in A; ``changed`` where that is a change of the answer."""

    what: str
    a: str
    b: str
    changed: bool


class Diff(Part, frozen=True, kw_only=True):
    """What changed from A to B; ``judged`` is the count of numbers judged."""

    a: str
    b: str
    changed: bool
    false_alarm_rate: float
    judged: int
    numbers: list[Difference]
    facts: list[Fact]
    notes: list[str]


@dataclass(slots=True)
class _Side:
    """Numbers by (vehicle, loop, quantity); of a run its row and file too."""

    path: Path
    numbers: dict[tuple[str, str, str], Value] = field(default_factory=dict)
    row: Mapping[str, Any] | None = None
    run: McapRun | None = None
    sha256: str | None = None


def diff(a: Path, b: Path) -> Diff:
    """Return what changed from A to B.

    Raises:
        SourceError: one of them is neither a finished run nor a data set.
    """
    one, other = _side(a), _side(b)
    if one.run is not None and other.run is not None:
        return _told(one, other, list(_of_runs(one, other)), [])
    notes: list[str] = []
    for run, fleet in ((one, other), (other, one)):
        if fleet.run is None:
            studied = study(read_flights(fleet.path, run.sha256))
            fleet.numbers = _as_they_stand(studied)
            if run.run is not None:
                _pick(run, fleet, studied, notes)
    for side, beside, name in ((one, other, "A"), (other, one, "B")):
        alone = {key[:2] for key in side.numbers} - {key[:2] for key in beside.numbers}
        if alone:
            said = ", ".join(f"{vehicle} ({loop})" for vehicle, loop in sorted(alone)[:8])
            notes.append(f"only in {name}: {said}{', …' if len(alone) > 8 else ''}")
    return _told(one, other, [], notes)


def _side(path: Path) -> _Side:
    if path.is_dir():
        return _Side(path)
    run = open_run(path)
    row = flight_row(run.summary, None, None)
    vehicle = _vehicle(run)
    loop = row.get("loop") or NO_LOOP
    numbers = {
        (vehicle, loop, quantity): Value(value=row[quantity], std=row[std])
        for quantity, std in _RUN_QUANTITIES.items()
        if row.get(quantity) is not None and row.get(std) is not None
    }
    return _Side(path, numbers, row, run, run.summary.own_source.sha256)


def _vehicle(run: McapRun) -> str:
    seen = run.summary.vehicle
    return "unknown" if seen is None else f"sysid:{seen.sysid}"


def _as_they_stand(studied: list[Studied]) -> dict[tuple[str, str, str], Value]:
    return {
        (each.history.vehicle, each.history.loop, each.history.quantity): each.told.now
        for each in studied
    }


def _pick(run: _Side, fleet: _Side, studied: list[Studied], notes: list[str]) -> None:
    """Leave of a data set what a run is compared with: its own vehicle, else all of them.

    The sigmas become those of one flight more.
    """
    (old, loop) = next((key[:2] for key in run.numbers), (_vehicle_of(run), NO_LOOP))
    own = [each for each in studied if each.history.loop == loop]
    vehicle = _own_vehicle(run, own)
    fleet.numbers = {}
    for quantity in QUANTITIES:
        alike = [each for each in own if each.history.quantity == quantity]
        mine = [each for each in alike if each.history.vehicle == vehicle]
        if mine and mine[0].told.flights >= LEAST_OWN:
            value, std = mine[0].level.value, mine[0].level.std
            tau = mine[0].told.between_std
            tau = mine[0].fitted.tau if tau is None else tau
        elif len(alike) >= LEAST_OWN:
            values = np.array([each.level.value for each in alike])
            value, std = float(np.median(values)), 0.0
            stds = np.array([each.level.std for each in alike])
            # 1.57: a median scatters by that much more than a mean.
            spread = solve_tau2((values - value) ** 2, stds**2) * (1.0 + 1.57 / len(values))
            tau = float(np.sqrt(spread + np.median([each.fitted.tau for each in alike]) ** 2))
            notes.append(f"{quantity}: compared with all {len(alike)} vehicles")
        else:
            continue
        key = (vehicle or old, loop, quantity)
        fleet.numbers[key] = Value(value=value, std=float(np.hypot(std, tau)))
    run.numbers = {
        (vehicle or old, loop, key[2]): value
        for key, value in run.numbers.items()
        if key[2] in QUANTITIES
    }
    if not fleet.numbers:
        notes.append(f"{fleet.path} has no flights ({loop}) to compare {run.path} with")


def _vehicle_of(run: _Side) -> str:
    assert run.run is not None
    return _vehicle(run.run)


def _own_vehicle(run: _Side, studied: list[Studied]) -> str | None:
    """Return the run's vehicle as the data set names it; None where that is not plain."""
    assert run.run is not None
    seen = run.run.summary.vehicle
    names = {each.history.vehicle for each in studied}
    serial = serial_of(run.run.attachments.get("parameters.txt", b""))
    if serial in names:
        return serial
    found = {each.history.vehicle for each in studied if seen and each.history.sysid == seen.sysid}
    return found.pop() if len(found) == 1 else None


def _told(a: _Side, b: _Side, facts: list[Fact], notes: list[str]) -> Diff:
    if a.row is not None and b.row is not None:
        # Of two runs the vehicle's id matters less than that somebody compares them.
        (a_numbers, b_numbers) = (_by_quantity(side.numbers) for side in (a, b))
    else:
        a_numbers, b_numbers = a.numbers, b.numbers
    pairs = [(key, a_numbers[key], b_numbers[key]) for key in a_numbers if key in b_numbers]
    why = [_not_judged(a, b, key[2], {k[2] for k in a_numbers if k in b_numbers}) for key, *_ in
           pairs]  # fmt: skip
    judged = sum(each is None for each in why)
    numbers = [_difference(*pair, reason, judged) for pair, reason in zip(pairs, why, strict=True)]
    if not numbers:
        notes.append("no number of A has one of B beside it")
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


def _by_quantity(
    numbers: Mapping[tuple[str, str, str], Value],
) -> dict[tuple[str, str, str], Value]:
    return {("", "", key[2]): value for key, value in numbers.items()}


def _not_judged(a: _Side, b: _Side, quantity: str, both: set[str]) -> str | None:
    """Say why a difference of two runs says nothing of the vehicle, None where it does."""
    if a.row is None or b.row is None:
        return None
    if a.row.get("loop") != b.row.get("loop"):
        return "another loop"
    if quantity == "wn_rad_s":
        if "kappa_rad_m" in both:
            return "goes with the airspeed: see ωn/V"
        speeds = a.row.get("airspeed_m_s"), b.row.get("airspeed_m_s")
        known = [speed for speed in speeds if speed is not None]
        if len(known) == 2 and abs(known[1] / known[0] - 1.0) > SAME_SPEED:
            return "another airspeed"
    return None


def _difference(
    key: tuple[str, str, str], a: Value, b: Value, not_judged: str | None, judged: int
) -> Difference:
    vehicle, loop, quantity = key
    assert a.value is not None
    assert b.value is not None
    difference = b.value - a.value
    std = float(np.hypot(a.std or 0.0, b.std or 0.0))
    z = difference / std if std > 0.0 else None
    p = None if z is None or not_judged else min(1.0, judged * 2.0 * float(ndtr(-abs(z))))
    return Difference(
        vehicle=vehicle, loop=loop, quantity=quantity, a=a, b=b, difference=difference, sigmas=z,
        p=p, changed=p is not None and p <= FALSE_ALARMS, not_judged=not_judged,
    )  # fmt: skip


def _of_runs(a: _Side, b: _Side) -> Iterator[Fact]:
    """Yield what two runs say otherwise of verdict, channels and configuration.

    Verdict and channels are answers; the configuration is what somebody chose.
    """
    assert a.run is not None
    assert b.run is not None
    one, other = a.run.summary, b.run.summary
    if one.deciding.usable != other.deciding.usable:
        words = [_usable(each.usable) for each in (one.deciding, other.deciding)]
        yield Fact(what="verdict", a=words[0], b=words[1], changed=True)
    ids = [", ".join(reason.id for reason in each.deciding.reasons) or "none"
           for each in (one, other)]  # fmt: skip
    if ids[0] != ids[1]:
        yield Fact(what="reasons", a=ids[0], b=ids[1], changed=False)
    loops = [each.row.get("loop") or NO_LOOP for each in (a, b) if each.row is not None]
    if loops[0] != loops[1]:
        yield Fact(what="loop", a=loops[0], b=loops[1], changed=False)
    for name in sorted({*one.channels, *other.channels}):
        found = [each.channels[name].source if name in each.channels else "none"
                 for each in (one, other)]  # fmt: skip
        if found[0] != found[1]:
            yield Fact(what=f"channel {name}", a=found[0], b=found[1], changed=True)
    for part, what in (("configuration", "configuration"), ("versions", "version")):
        yield from _settings(what, a.run.metadata.get(part, {}), b.run.metadata.get(part, {}))


def _settings(what: str, a: Mapping[str, str], b: Mapping[str, str]) -> Iterator[Fact]:
    for name in sorted({*a, *b}):
        one, other = a.get(name, "none"), b.get(name, "none")
        if one != other:
            yield Fact(what=f"{what} {name}", a=one, b=other, changed=False)


def _usable(usable: bool) -> str:
    return "usable" if usable else "not usable"
