"""Judges ``yawid trend`` on drawn fleets: it must find a falling damping, and nothing else.

    python -m checks.judge_trend [DRAWS]    # 2000

The numbers scatter by 8 % (zeta), 1.5 % (wn/V) and 5 % (K/V). 3/8 to 7/8 of that is the flight's
own total sigma, which is given; the rest is tau. 5 % of the flights are outliers, off by 25 to 60 %
in all three numbers.

It counts in how many data sets drawn by each of PLANS a change is reported. The plans have one to
three flights on a day, which may share an offset, and are tested once or after every day. Where
zeta falls, it does so by 20 % over 30 days, from a day drawn among the first 31. The plans of
ordinary flight have its two numbers, with the scatter that ``bench.py ordinary`` has.
Then it counts in how many draws ``yawid diff`` reports one more flight of a vehicle as changed,
compared with 3 to 30 flights.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

import numpy as np

from yawid.trend.best_profile import LEAST_DAYS
from yawid.trend.changes import fit_fleets
from yawid.trend.days import DAY_US, HOUR_US, YEAR_US, Track
from yawid.trend.diff import one_more
from yawid.trend.history import MADE, Flights, History
from yawid.trend.moderated import two_sided
from yawid.trend.trend import FALSE_ALARMS, study

SCATTER: Final = {"kappa_rad_m": 0.015, "zeta": 0.08, "K_per_V": 0.05}
OF_ORDINARY: Final = {"kappa_rad_m": 0.022, "zeta": 0.12}
LEVELS: Final = {"kappa_rad_m": 0.12, "zeta": 0.15, "K_per_V": 0.04}
FALL: Final = 0.2
FALL_DAYS: Final = 30
START_US: Final = 1_740_000_000_000_000  # 2025-02-19
_AT_ONCE: Final = 50
"""Number of fleets that are fitted together."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How a fleet is drawn.

    A day has 1 to ``most`` flights, which share an offset of ``share`` times the scatter; days are
    ``apart_days`` apart. ``falls`` is whether zeta of vehicle 7 (or the last) falls; ``season`` is
    the amplitude of a season, as a fraction. ``nightly`` tests after every day. ``scatter`` is that
    of each number, as a fraction.
    """

    vehicles: int = 20
    days: int = 60
    most: int = 1
    share: float = 0.0
    falls: bool = False
    season: float = 0.0
    apart_days: int = 1
    nightly: bool = False
    scatter: Mapping[str, float] = field(default_factory=lambda: SCATTER)


PLANS: Final = {
    "independent": Plan(vehicles=5, days=60),
    "days": Plan(vehicles=5, days=60, most=3, share=1.0),
    "nightly": Plan(vehicles=1, days=40, nightly=True),
    "nightly-days": Plan(vehicles=1, days=40, most=3, share=1.0, nightly=True),
    "season": Plan(vehicles=5, days=50, season=0.03, apart_days=7),
    "fall": Plan(vehicles=5, days=60, most=3, share=0.5, falls=True),
    "ordinary": Plan(vehicles=5, days=60, scatter=OF_ORDINARY),
    "ordinary-days": Plan(vehicles=5, days=60, most=3, share=1.0, scatter=OF_ORDINARY),
    "ordinary-nightly": Plan(vehicles=1, days=40, nightly=True, scatter=OF_ORDINARY),
    "ordinary-fall": Plan(vehicles=5, days=60, most=3, share=0.5, falls=True, scatter=OF_ORDINARY),
}
"""A fall should be found, in the others nothing changed."""


def draw_history(
    rng: np.random.Generator, level: float, scatter: float, n: int, off: Any, shared: Any = 0.0
) -> tuple[Any, Any]:
    """Return numbers (n,) and total sigmas (n,) of a vehicle.

    ``off`` (n,) are the factors of outliers, ``shared`` (n,) the offsets that the flights of a day
    share, in units of the scatter.
    """
    sigma = scatter * rng.uniform(3 / 8, 7 / 8, n)
    tau2 = scatter**2 * (1.0 - (9 + 21 + 49) / 3 / 64)  # sigma² is on average 79/192 of scatter²
    own = np.sqrt(sigma**2 + tau2) * rng.standard_normal(n)
    return level * (1.0 + own + scatter * shared) * off, level * sigma


def draw_off(rng: np.random.Generator, n: int) -> Any:
    """Return a factor for each flight (n,), which is 1 except for outliers."""
    far = rng.choice([-1.0, 1.0], n) * rng.uniform(0.25, 0.6, n)
    return np.where(rng.random(n) < 0.05, 1.0 + far, 1.0)


def draw_vehicles(rng: np.random.Generator, plan: Plan) -> Iterator[dict[str, Track]]:
    """Yield the three histories of each vehicle by quantity."""
    begin = int(rng.integers(0, max(plan.days - FALL_DAYS, 0) + 1))
    for vehicle in range(1, plan.vehicles + 1):
        counts = rng.integers(1, plan.most + 1, plan.days)
        day = np.repeat(np.arange(plan.days), counts)
        of_day = np.concatenate([np.arange(count) for count in counts])
        date = START_US + day * plan.apart_days * DAY_US + of_day * HOUR_US + vehicle * 1_000_000
        falls = plan.falls and vehicle == min(plan.vehicles, 7)
        left = {"zeta": 1.0 - falls * FALL * np.clip((day - begin) / FALL_DAYS, 0.0, 1.0)}
        phase = 2.0 * np.pi * (rng.random() + date / YEAR_US)
        off = draw_off(rng, len(day))
        tracks = {}
        for name, scatter in plan.scatter.items():
            own = LEVELS[name] * (1.0 + 0.03 * rng.standard_normal())
            value, sigma = draw_history(
                rng, own, scatter, len(day), off, plan.share * rng.standard_normal(plan.days)[day]
            )
            value = value * left.get(name, 1.0) * (1.0 + plan.season * np.sin(phase))
            tracks[name] = Track(value, sigma, date)
        yield tracks


def flight(sysid: int, i: int, date: int, **numbers: Any) -> dict[str, Any]:
    """Return a usable row of ``flights`` with a log hash of its own."""
    return {
        "log_sha256": f"{sysid:03d}-{i:05d}", "yawid_version": "0", "analysis_version": "1",
        "config_hash": "c", "vehicle": f"sysid:{sysid}", "sysid": sysid, "boot": 1, "date": date,
        "loop": "airframe", "vehicle_type": 1, "usable": True, "method": "rml",
    } | numbers  # fmt: skip


def _until(track: Track, days: int) -> Track:
    """Return a history as it was after ``days`` days."""
    n = int(np.searchsorted(track.day, days))
    return Track(track.value[:n], track.sigma[:n], track.dates[:n])


def judge_plan(plan: Plan, draws: int, *, seed: int = 0, every: int = 1) -> tuple[int, int]:
    """Return in how many drawn data sets the fall was reported, and in how many another change.

    Of the nightly tests, only one in every ``every`` days is made; the last one always is.
    """
    rng, names = np.random.default_rng(seed), list(plan.scatter)
    looks = range(plan.days, LEAST_DAYS - 1, -every) if plan.nightly else [plan.days]
    drawn = (list(draw_vehicles(rng, plan)) for _ in range(draws))
    found = wrong = 0
    while fleets := list(islice(drawn, _AT_ONCE)):
        numbers = [[each[name] for each in fleet] for fleet in fleets for name in names]
        seen = ([[_until(track, days) for track in tracks] for tracks in numbers] for days in looks)
        ps = [[[1.0 if each.change is None else each.change.p for each in fits]
               for fits in fit_fleets(some)] for some in seen]  # fmt: skip
        changed = np.min(ps, axis=0) * len(names) * plan.vehicles <= FALSE_ALARMS
        by_fleet = changed.reshape(len(fleets), len(names), plan.vehicles)
        if plan.falls:
            falls = by_fleet[:, names.index("zeta"), min(plan.vehicles, 7) - 1]
            found += int(falls.sum())
            falls[:] = False
        wrong += int(by_fleet.any(axis=(1, 2)).sum())
    return found, wrong


def judge_diff(flights: int, draws: int, *, seed: int = 0) -> int:
    """Return in how many draws one more flight of a vehicle with ``flights`` is called changed."""
    rng, numbers, wrong = np.random.default_rng(seed), np.arange(flights), 0
    rows: list[Mapping[str, Any]] = [
        dict.fromkeys(MADE) | flight(1, i, START_US + i * DAY_US) for i in range(flights)
    ]
    for _ in range(draws):
        histories, newest = [], []
        for name, level in LEVELS.items():
            value, sigma = draw_history(rng, level, SCATTER[name], flights + 1, 1.0)
            track = Track(value[:-1], sigma[:-1], START_US + numbers * DAY_US)
            histories.append(History("sysid:1", "airframe", name, 1, 1, track, numbers))
            newest.append((float(value[-1]), float(sigma[-1])))
        ps = []
        for each, (last, std) in zip(study(Flights(rows, {}, histories)), newest, strict=True):
            expected = one_more(each, std)
            apart = (last - (expected.value or 0.0)) / np.hypot(std, expected.std or 0.0)
            ps.append(two_sided(float(apart), each.fitted.dof))
        wrong += min(ps) * len(ps) <= FALSE_ALARMS
    return wrong


def main(draws: int) -> None:
    """Print how many of so many draws had a reported fall or change, and twice as many of diff."""
    for name, plan in PLANS.items():
        found, wrong = judge_plan(plan, draws)
        print(f"{name}: of {draws} {found} with the fall, {wrong} with a change", flush=True)
    for flights in (3, 5, 8, 12, 30):
        wrong = judge_diff(flights, 2 * draws)
        print(f"one flight after {flights}: of {2 * draws} {wrong} with a change", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:] or ["2000"]))
