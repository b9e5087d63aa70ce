"""The cost of short runs: start-up, compiling, and what one more hour of log adds.

Each of these runs in a process of its own: the import of NumPy alone; ``yawid --help``; a replay of
half a minute with compiled code; the same with an empty folder for compiled code. "An hour" is how
much longer a replay takes for one more hour of log (20 Hz, to MCAP), without and with its
manoeuvres. Seconds are CPU time with that of children, or wall time where the column says so, and
are the least of all rounds; the ratio in brackets is to the import of NumPy.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator
from pathlib import Path

from checks.children import Cost, cost_of
from flights.long_log import write_log

from bench.frame import head, line, options_of

LOG = Path(__file__).resolve().parents[2] / "replay_logs" / "c172p_3211" / "log.tlog"
NUMPY, HELP, SHORT, WALL = "`import numpy`", "`yawid --help`", "a replay", "its wall"
COLD, HOURS = "cold, wall", {"off": "an hour", "auto": "manoeuvres"}
COLUMNS = (NUMPY, HELP, SHORT, WALL, COLD, *HOURS.values())
MOST = {(SHORT, NUMPY): 8.0, (COLD, WALL): 2.0}
"""Limits: the CPU of a replay over that of importing NumPy, and a cold replay over a warm one."""
MOVED_S, EVERY_S = 30.0, 300.0
"""The long logs have a manoeuvre of MOVED_S seconds in every EVERY_S seconds."""


def replayed(log: Path, folder: Path, manoeuvres: str = "auto", code: str = "code") -> Cost:
    """Replay a log in a process of its own, which keeps compiled code in the folder ``code``."""
    to = ["--out", str(folder), "--force", "--json", "--rerun", "off", "--manoeuvres", manoeuvres]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / code)}
    answered = (0, 5)  # a usable answer or none
    return cost_of("-m", "yawid", "replay", str(log), *to, allowed=answered, env=environment)


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return which limits are exceeded, None if none is."""
    options = options_of("start", __doc__, arguments, rounds=5, hours=1.0, hour_rounds=2)
    least: dict[str, float] = {}

    def keep(name: str, seconds: float) -> None:
        least[name] = min(seconds, least.get(name, seconds))

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = [folder / f"{i}.tlog" for i in (1, 2)]
        for i, log in enumerate(logs, 1):
            write_log(log, options.hours * i, "raised", moved_s=MOVED_S, every_s=EVERY_S)
        replayed(LOG, folder)  # compiles what the later ones find
        for turn in range(options.rounds):
            keep(NUMPY, cost_of("-c", "import numpy").cpu_s)
            keep(HELP, cost_of("-m", "yawid", "--help").cpu_s)
            warm = replayed(LOG, folder)
            keep(SHORT, warm.cpu_s)
            keep(WALL, warm.wall_s)
            keep(COLD, replayed(LOG, folder, code=f"cold{turn}").wall_s)
            for setting in HOURS if turn < options.hour_rounds else ():
                for log in logs:
                    keep(f"{setting} {log.stem}", replayed(log, folder, setting).cpu_s)
    for setting, column in HOURS.items():
        least[column] = (least[f"{setting} 2"] - least[f"{setting} 1"]) / options.hours
    yield from head("", COLUMNS)
    of_numpy = {
        each: f" ({least[each] / least[NUMPY]:.2g})" for each in COLUMNS if "wall" not in each
    }
    yield line("s", *(f"{least[each]:.3g}{of_numpy.get(each, '')}" for each in COLUMNS))
    exceeded = [f"{what}: {least[what] / least[of]:.1f} x {of}; {most:g} is allowed"
                for (what, of), most in MOST.items() if least[what] > most * least[of]]  # fmt: skip
    return "; ".join(exceeded) or None
