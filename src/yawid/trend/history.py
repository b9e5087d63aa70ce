"""A data set's flights as histories: one number of one vehicle, flight after flight.

A vehicle flown with its roll loop responds differently from the airframe alone, so each loop is a
history of its own. So is the bare airframe that is found under a roll loop,
and that which ordinary flight shows.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from yawid.answers.reasons import Reason
from yawid.blocks import AIRSPEED_SHARE, Ints
from yawid.dataset.files import read_table
from yawid.dataset.schema import BARE, ORDINARY
from yawid.dataset.summary_rows import ordinary_row
from yawid.ordinary import Ordinary, Sums, answer_of
from yawid.quantities.airspeed import density_ratio
from yawid.quantities.vehicles import autopilot_name, type_name
from yawid.trend import SEVERAL
from yawid.trend.days import Track, alike, days_of

FOLLOWED: Final = {"kappa_rad_m": "kappa_std", "zeta": "zeta_std", "K_per_V": "K_per_V_std"}
"""The numbers that are followed, by their column, each with the column of its total sigma."""
GAP: Final = 1.5
"""Airspeeds that differ by a larger factor from the next ones are another range. One aircraft fills
its own (a Cessna 172 flew at 39 to 62 m/s). Without this, a Cessna and a model aircraft of one
sysid, which left 22 to 48 m/s empty, were one steady history."""
MADE: Final = (
    "config_hash", "analysis_version", "yawid_version", "method", "rudder_source", "yaw_source",
    "airspeed_source", "rate_hz",
)  # fmt: skip
"""Columns that say how a flight was measured: if they change with a number, they may explain it."""
_WHO: Final = ("vehicle", "loop", "vehicle_type", "date", "log_sha256", "sysid", "boot", "usable")
_MIXED: Final = ("autopilot", "airspeed_m_s")
NO_LOOP: Final = "unknown"
BY_SYSID: Final = "sysid:"
"""Begins the name of a vehicle of which only its MAVLink id is known."""
BARE_AIRFRAME: Final = "bare"
"""The loop of a history of the bare airframe."""
ORDINARY_FLIGHT: Final = "ordinary"
"""The loop of a history of the same from ordinary flight, whose sigmas and errors are others."""
_OF_ORDINARY: Final = ("kappa_rad_m", "kappa_std", "zeta", "zeta_std")
FlightRow = Mapping[str, Any]
"""A row of ``flights_by_loop`` by its columns."""


@dataclass(frozen=True, slots=True)
class History:
    """One number of one vehicle and loop by date; ``flights`` (n,) index those of Flights."""

    vehicle: str
    loop: str
    quantity: str
    vehicle_type: int | None
    sysid: int | None
    track: Track
    flights: Ints


@dataclass(frozen=True, slots=True)
class Flights:
    """The flights' answers by loop, their histories, and how many were left out by reason."""

    rows: Sequence[FlightRow]
    left_out: dict[str, int]
    histories: list[History]


def read_flights(folder: Path, without_sha: str | None = None) -> Flights:
    """Return a data set's histories, sorted by vehicle.

    The flights of the log with the hash ``without_sha`` are left out.

    Raises:
        SourceError: there is no data set, or it cannot be read.
    """
    bare = [name for name, *_ in (*BARE, *ORDINARY)]
    columns = [*_WHO, *MADE, *FOLLOWED, *FOLLOWED.values(), *bare, *_MIXED, "altitude_m"]
    table = read_table(folder, "flights_by_loop", columns)
    dates = table["date"].cast("int64").to_pylist()
    rows = [row | {"date": date} for row, date in zip(table.to_pylist(), dates, strict=True)]
    if without_sha is not None:
        rows = [row for row in rows if row["log_sha256"] != without_sha]
    by_flight = alike(rows, lambda row: (row["log_sha256"], row["sysid"], row["boot"]))
    flights = [its[0] for its in by_flight]
    return flights_of([*rows, *_bare_rows(flights), *_ordinary_rows(flights)])


def _bare_rows(flights: Iterable[FlightRow]) -> Iterator[FlightRow]:
    """Yield a row for the bare airframe of each flight that has one, whatever its loops.

    It has no K / V. Its wn / V is by the equivalent airspeed, as that of the others.
    """
    for row in flights:
        if row["bare_wn_rad_s"] is not None:
            height = row["altitude_m"]
            ratio = np.nan if height is None else float(density_ratio(np.array([height]))[0])
            per_wn = 1.0 / (row["bare_airspeed_m_s"] * np.sqrt(ratio))
            numbers = {
                "zeta": row["bare_zeta"], "zeta_std": row["bare_zeta_std"], "K_per_V": None,
                "kappa_rad_m": row["bare_wn_rad_s"] * per_wn if np.isfinite(ratio) else None,
                "kappa_std": row["bare_wn_std"] * per_wn,
            }  # fmt: skip
            yield {**row, **numbers, "loop": BARE_AIRFRAME, "usable": True}


def _ordinary_rows(flights: Sequence[FlightRow]) -> Iterator[FlightRow]:
    """Yield a row for each flight whose ordinary part shows the mode; it has no K / V.

    Short flights of one day answer together.
    """
    own = {"loop": ORDINARY_FLIGHT, "usable": True, "K_per_V": None}
    for row in (*flights, *_days_of_short_flights(flights)):
        if row["ordinary_wn_rad_s"] is not None:
            yield {**row, **{name: row[f"ordinary_{name}"] for name in _OF_ORDINARY}, **own}


def _days_of_short_flights(rows: Iterable[FlightRow]) -> Iterator[FlightRow]:
    """Yield the first row of each vehicle's day with what its flights show that are too short.

    Their sums add up as those of one flight do.
    """
    needs = "ordinary_sums", "ordinary_altitude_m", "date"
    short = [row for row in rows if None not in [row[name] for name in needs]]
    short.sort(key=lambda row: (row["vehicle"], row["date"]))
    for its in alike(short, lambda row: row["vehicle"]):
        days = days_of(np.array([row["date"] for row in its]))
        for day in np.split(np.arange(len(its)), np.flatnonzero(np.diff(days)) + 1):
            flight = Ordinary()
            sums = [Sums.unpacked(its[i]["ordinary_sums"]) for i in day]
            for each in sums:
                flight.add(each)
            if found := answer_of(flight):
                speed = found.airspeed_m_s or np.nan
                away = [abs(x.speed / x.seconds / speed - 1.0) for x in sums]
                same = [its[i] for i, x in zip(day, away, strict=True) if x <= AIRSPEED_SHARE]
                height = float(np.mean([row["ordinary_altitude_m"] for row in same]))
                found = replace(found, airspeed_source="airspeed", altitude_m=height)
                yield {**same[0], **ordinary_row(found)}


def flights_of(rows: Sequence[FlightRow]) -> Flights:
    """Return the histories in rows of ``flights_by_loop``, whose dates are in us since 1970."""
    left_out = dict.fromkeys(_LEFT_OUT, 0)
    by_whose: dict[tuple[str, str], list[int]] = {}
    for i, row in enumerate(rows):
        if (why := next((why for why, holds in _LEFT_OUT.items() if holds(row)), None)) is None:
            key = (shown(row["vehicle"]), row["loop"] or NO_LOOP)
            by_whose.setdefault(key, []).append(i)
        else:
            left_out[why] += 1
    histories = []
    for (vehicle, loop), found in sorted(by_whose.items(), key=lambda each: _natural(each[0])):
        found.sort(key=lambda i: (rows[i]["date"], rows[i]["log_sha256"] or "", rows[i]["boot"]))
        for quantity in FOLLOWED:
            known = [i for i in found if _known(rows[i], quantity)]
            if known:
                histories.append(_history(vehicle, loop, quantity, rows, known))
    return Flights(list(rows), left_out, histories)


def mixed(flights: Flights) -> Iterator[Reason]:
    """Yield a warning for each MAVLink id under which several aircraft seem to fly.

    They have several types of vehicle or autopilot, or airspeeds with a gap between them.
    """
    by_id = (row for row in flights.rows if row["vehicle"].startswith(BY_SYSID))
    for rows in alike(by_id, lambda row: shown(row["vehicle"])):
        parts = (("flown as", _kinds(rows)), ("at", _ranges(rows)))
        said = [f"{how} {' and '.join(kinds)}" for how, kinds in parts if len(kinds) > 1]
        if said:
            text = (
                f"{shown(rows[0]['vehicle'])} may be several aircraft, {', '.join(said)}: name "
                "them by yawid fleet --vehicle-from folder or --vehicle NAME"
            )
            yield Reason(SEVERAL, text, weight="warning")


def _kinds(rows: Sequence[FlightRow]) -> list[str]:
    """Return the types of vehicle and autopilot of flights, in words."""
    seen = {(row["vehicle_type"], row["autopilot"]) for row in rows}
    known = sorted(each for each in seen if None not in each)
    return [f"a {type_name(kind)} on {autopilot_name(by)}" for kind, by in known]


def _ranges(rows: Sequence[FlightRow]) -> list[str]:
    """Return the ranges of airspeed of flights, in words."""
    known = [row["airspeed_m_s"] for row in rows if row["airspeed_source"] == "airspeed"]
    speeds = np.sort([each for each in known if each])
    parts = np.split(speeds, np.flatnonzero(speeds[1:] > GAP * speeds[:-1]) + 1)
    ends = [dict.fromkeys((f"{each[0]:.0f}", f"{each[-1]:.0f}")) for each in parts if len(each)]
    return [f"{' to '.join(each)} m/s" for each in ends]


def shown(text: object) -> str:
    """Return a text that is safe to print: it comes from a log, which anybody may have written."""
    return "".join(each if each.isprintable() else "?" for each in str(text))


def _natural(whose: tuple[str, str]) -> list[tuple[int, str]]:
    """Return a sort key by which 10 comes after 9."""
    parts = re.split(r"(\d+)", " ".join(whose))
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _known(row: FlightRow, quantity: str) -> bool:
    return row[quantity] is not None and row[FOLLOWED[quantity]] is not None


_LEFT_OUT: Final[dict[str, Callable[[FlightRow], bool]]] = {
    "not usable": lambda row: not row["usable"],
    "without a date": lambda row: row["date"] is None,
    "without a number and its sigma": lambda row: not any(_known(row, name) for name in FOLLOWED),
}
"""Why a flight is left out: the first that holds."""


def _history(
    vehicle: str, loop: str, quantity: str, rows: Sequence[FlightRow], known: list[int]
) -> History:
    value, sigma = (
        np.array([rows[i][name] for i in known], dtype=float)
        for name in (quantity, FOLLOWED[quantity])
    )
    dates = np.array([rows[i]["date"] for i in known], dtype=np.int64)
    return History(
        vehicle,
        loop,
        quantity,
        rows[known[-1]]["vehicle_type"],
        rows[known[-1]]["sysid"],
        Track(value, sigma, dates),
        np.array(known, dtype=np.int64),
    )


def measured_otherwise(flights: Flights, history: History, first: int, last: int) -> list[str]:
    """Return in words which of MADE differ between flights up to ``first`` and from ``last`` on.

    Both are indices in the history, from 0. Each side is represented by its most frequent value.
    """
    before = [flights.rows[i] for i in history.flights[: first + 1]]
    after = [flights.rows[i] for i in history.flights[last:]]
    made = ((name, _most(before, name), _most(after, name)) for name in MADE)
    return [f"{name}: {one} before, {other} after" for name, one, other in made if one != other]


def _most(rows: list[FlightRow], name: str) -> object:
    values = [row[name] for row in rows]
    return max(values, key=values.count)
