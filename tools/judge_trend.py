"""Judge ``yawid trend`` on drawn fleets: a damping that falls is found, and nothing else.

    python tools/judge_trend.py seeds [--seeds 100] [--first 0]
    python tools/judge_trend.py looks [--histories 30000]

seeds: fleets of 20 aircraft with 40 flights each, scatter 8 % in zeta, 1.5 % in wn/V, 5 % in K/V
(the flight's own total sigma, 3/8 to 7/8 of it, is told; the rest is tau), 5 % of the flights off
by 25 to 60 % in all three. In each fleet with a change zeta of one aircraft falls by 20 % over 30
flights, from a flight drawn between the first and the eleventh. Every fleet is written and read
back as a data set. looks: whether the p of a change is right, by histories without one
(changes.looks is from it).
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from yawid.dataset.files import merge
from yawid.trend.changes import Track, fit_tracks
from yawid.trend.trend import trend

VEHICLES: Final = 20
FLIGHTS: Final = 40
SCATTER: Final = {"kappa_rad_m": 0.015, "zeta": 0.08, "K_per_V": 0.05}
STDS: Final = {"kappa_rad_m": "kappa_std", "zeta": "zeta_std", "K_per_V": "K_per_V_std"}
LEVELS: Final = {"kappa_rad_m": 0.12, "zeta": 0.15, "K_per_V": 0.04}
OUTLIERS: Final = 0.05
FALL: Final = 0.2
FALL_FLIGHTS: Final = 30
FALLS: Final = "sysid:7"
WEEK_US: Final = 7 * 86_400_000_000
START_US: Final = 1_740_000_000_000_000  # 2025-02-19


def draw_history(
    rng: np.random.Generator, level: float, scatter: float, n: int, off: Any
) -> tuple[Any, Any]:
    """Return numbers (n,) and total sigmas (n,) of a vehicle; ``off`` (n,) factors of outliers."""
    sigma = scatter * rng.uniform(3 / 8, 7 / 8, n)
    tau2 = scatter**2 * (1.0 - (9 + 21 + 49) / 3 / 64)  # sigma² is 79/192 of it in the mean
    number = 1.0 + np.sqrt(sigma**2 + tau2) * rng.standard_normal(n)
    return level * number * off, level * sigma


def draw_off(rng: np.random.Generator, n: int, share: float = OUTLIERS) -> Any:
    """Return a factor (n,) for each flight, 1 but for outliers."""
    far = rng.choice([-1.0, 1.0], n) * rng.uniform(0.25, 0.6, n)
    return np.where(rng.random(n) < share, 1.0 + far, 1.0)


def draw_fleet(
    seed: int, *, falls: bool, vehicles: int = VEHICLES, n: int = FLIGHTS
) -> list[dict[str, Any]]:
    """Return a fleet's rows of ``flights``; FALLS is the aircraft whose zeta falls."""
    rng = np.random.default_rng(seed)
    start = int(rng.integers(0, n - FALL_FLIGHTS + 1))
    fall = 1.0 - FALL * np.clip((np.arange(n) - start) / FALL_FLIGHTS, 0.0, 1.0)
    rows = []
    for sysid in range(1, vehicles + 1):
        off = draw_off(rng, n)
        columns: dict[str, Any] = {}
        for name, level in LEVELS.items():
            own = level * (1.0 + 0.03 * rng.standard_normal())
            value, sigma = draw_history(rng, own, SCATTER[name], n, off)
            if falls and name == "zeta" and f"sysid:{sysid}" == FALLS:
                value = value * fall
            columns |= {name: value, STDS[name]: sigma}
        for i in range(n):
            date = START_US + i * WEEK_US + sysid * 1_000_000
            row = {name: float(column[i]) for name, column in columns.items()}
            rows.append(flight(sysid, i, date, **row))
    return rows


def flight(sysid: int, i: int, date: int, **numbers: Any) -> dict[str, Any]:
    """Return a usable row of ``flights``, of a log of its own."""
    return {
        "log_sha256": f"{sysid:03d}-{i:05d}", "yawid_version": "0", "analysis_version": "1",
        "config_hash": "c", "vehicle": f"sysid:{sysid}", "sysid": sysid, "boot": 1, "date": date,
        "loop": "airframe", "vehicle_type": 1, "usable": True, "method": "rml",
    } | numbers  # fmt: skip


def write_fleet(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows of ``flights`` as a data set."""
    made_by = ("log_sha256", "yawid_version", "analysis_version", "config_hash")
    merge(
        folder,
        [
            {
                "logs": [
                    {"path": f"/{row['log_sha256']}", "outcome": "ok"}
                    | {name: row[name] for name in made_by}
                ],
                "flights": [row],
            }
            for row in rows
        ],
    )


@dataclass(slots=True)
class Judged:
    """Over many fleets: changes found, fleets with a wrong one, without and with a true one."""

    fleets: int = 0
    found: int = 0
    wrong_beside: int = 0
    false_alarms: int = 0
    outliers: int = 0


def judge_seed(seed: int, judged: Judged) -> None:
    """Judge one fleet with a change, and one without, of another seed."""
    for falls in (True, False):
        with tempfile.TemporaryDirectory() as folder:
            write_fleet(Path(folder), draw_fleet(2 * seed + falls, falls=falls))
            told, _ = trend(Path(folder))
        names = {(each.vehicle, each.quantity) for each in told.followed if each.change}
        wrong = names - ({(FALLS, "zeta")} if falls else set())
        if falls:
            judged.found += (FALLS, "zeta") in names
            judged.wrong_beside += bool(wrong)
            judged.outliers += sum(len(each.outliers) for each in told.followed)
        else:
            judged.false_alarms += bool(wrong)
    judged.fleets += 1


def print_seeds(first: int, seeds: int) -> None:
    """Print the table's row."""
    judged = Judged()
    for seed in range(first, first + seeds):
        judge_seed(seed, judged)
    print("| `judge_trend.py seeds` | fall found | another found beside it | false alarms |")
    print("|---|---|---|---|")
    of = f"of {judged.fleets}"
    print(
        f"| seeds {first} to {first + seeds - 1} | {judged.found} {of} | "
        f"{judged.wrong_beside} {of} | {judged.false_alarms} {of} |"
    )


def print_looks(histories: int) -> None:
    """Print by what factor a history without a change has a p more often than p says."""
    for vehicles in (VEHICLES, 3):
        for n in (12, 20, 40, 100, 300):
            rng = np.random.default_rng(n)
            found: list[float] = []
            while len(found) < histories:
                tracks = []
                for _ in range(vehicles):
                    value, sigma = draw_history(rng, 1.0, 0.08, n, draw_off(rng, n))
                    tracks.append(Track(value, sigma))
                changes = [fit.change for fit in fit_tracks(tracks)]
                found += [each.p for each in changes if each is not None]
            p = np.array(found)
            shown = ", ".join(
                f"{np.mean(p <= each) / each:.2f} at {each:g}"
                for each in (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
            )
            print(f"n = {n}, {vehicles} vehicles: as often as p says x {shown}", flush=True)


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    commands = parser.add_subparsers(dest="what", required=True)
    seeds = commands.add_parser("seeds")
    seeds.add_argument("--seeds", type=int, default=100)
    seeds.add_argument("--first", type=int, default=0)
    drawn = commands.add_parser("looks")
    drawn.add_argument("--histories", type=int, default=30_000)
    arguments = parser.parse_args()
    if arguments.what == "seeds":
        print_seeds(arguments.first, arguments.seeds)
    else:
        print_looks(arguments.histories)


if __name__ == "__main__":
    main()
