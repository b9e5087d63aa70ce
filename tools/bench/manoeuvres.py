"""The cost of finding manoeuvres: CPU of whole replays with and without it.

``made`` is made-up telemetry as a plane sends it (long_log.py), ``jsbsim`` a flight of the c172p.
Manoeuvres are a tenth of each log, or the rudder never rests, and every 120 s make one manoeuvre.
Each replay is a process of its own, with auto and off in turn. The seconds are medians of user CPU,
the ratio is the median over the pairs. ``--share`` shortens the logs.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from statistics import median

from checks.children import cost_of
from checks.judge import replayed
from flights.fly import flight_of
from flights.legs import Leg, LegPlan
from flights.long_log import write_log
from flights.plan import FlightPlan
from flights.surgery import join
from flights.telemetry import Link, telemetry

from bench.table import head, line, options_of

SETTINGS = ("off", "auto")
ANSWERED = (0, 5)
"""Exit codes of a log with a usable answer, and of one without."""
MOVED_S, EVERY_S = 30.0, 360.0
"""How long and how often the rudder of the made-up telemetry moves, in s. With the second before
and the 5 s of rest after, that is a tenth of the log."""
BETWEEN = (
    Leg("idle", 90.0),
    Leg("turn", 40.0, bank_deg=20.0),
    Leg("climb", 30.0, climb_ft_min=300.0),
    Leg("idle", 60.0),
    Leg("turn", 40.0, bank_deg=-20.0),
    Leg("climb", 30.0, climb_ft_min=-300.0),
    Leg("idle", 82.0),
)


def made_tenth(path: Path, minutes: float) -> None:
    """Write made-up telemetry whose rudder moves for MOVED_S in every EVERY_S."""
    write_log(path, minutes / 60.0, "raised", moved_s=MOVED_S, every_s=EVERY_S)


def made_throughout(path: Path, minutes: float) -> None:
    """Write made-up telemetry whose rudder never rests."""
    write_log(path, minutes / 60.0, "raised")


def flown_tenth(path: Path, minutes: float) -> None:
    """Fly 3-2-1-1s, doublets and PRBS, with turns, climbs and idle between them."""
    legs: list[Leg] = []
    for shape in cycle(("3211", "doublets", "prbs")):
        if sum(leg.seconds for leg in legs) >= 60.0 * minutes:
            break
        legs += [Leg("manoeuvre", 48.0, shape=shape, amplitude=0.1), *BETWEEN]
    plan = LegPlan("c172p", 95.0, tuple(legs))
    path.write_bytes(join(telemetry(Link(), flight_of(plan, Link()))))


def flown_throughout(path: Path, minutes: float) -> None:
    """Fly one long PRBS."""
    plan = FlightPlan(speed_kt=95.0, seconds=60.0 * minutes, manoeuvre="prbs", amplitude=0.1)
    path.write_bytes(join(telemetry(Link(), flight_of(plan, Link()))))


Log = tuple[str, Callable[[Path, float], None], float]
LOGS: tuple[Log, ...] = (
    ("made", made_tenth, 60.0),
    ("made", made_throughout, 20.0),
    ("jsbsim", flown_tenth, 28.0),
    ("jsbsim", flown_throughout, 20.0),
)
"""A log: where it comes from, the function that writes it, and its length in minutes."""


def user_s(log: Path, out: Path, setting: str) -> float:
    """Return the user CPU time in s of a replay in a process of its own.

    Raises:
        SystemExit: the replay failed.
    """
    to = ["--out", str(out), "--force", "--json", "--manoeuvres", setting]
    return cost_of("-m", "yawid", "replay", str(log), *to, allowed=ANSWERED).user_s


def compared(log: Path, name: str, pairs: int) -> tuple[str, str]:
    """Return a log's heading, with its share of manoeuvres, and the cost of finding them."""
    found = replayed(log)
    spans = [each.duration_s for each in found.manoeuvres or []]
    out = log.with_suffix("")
    for setting in SETTINGS:
        user_s(log, out, setting)  # compiles what is needed: that time is not counted
    turns = [[user_s(log, out, setting) for setting in SETTINGS] for _ in range(pairs)]
    off, auto = (median(column) for column in zip(*turns, strict=True))
    ratio = median(b / a for a, b in turns)
    minutes, share = found.duration_s / 60.0, sum(spans) / found.duration_s
    return f"{name}, {minutes:.0f} min ({share:.0%})", f"{off:.2f}, {auto:.2f}: {ratio:.2f}"


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    options = options_of("manoeuvres", __doc__, arguments, pairs=5, share=1.0)
    columns = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number, (what, write, minutes) in enumerate(LOGS):
            log = folder / f"{number}.tlog"
            write(log, options.share * minutes)
            columns.append(compared(log, what, options.pairs))
    heads, cells = zip(*columns, strict=True)
    yield from head("", heads)
    yield line("user CPU s, off, auto: ratio", *cells)
