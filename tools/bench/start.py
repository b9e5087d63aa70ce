"""The cost of short runs: start-up, compiling, and what one more hour of log adds.

Each of these runs in a process of its own: the import of NumPy alone; ``yawid --help``; a replay of
half a minute with compiled code; the same replay with an empty folder for compiled code; compiling
into an empty folder. "An hour" is how much longer a replay takes for one more hour of log
(20 Hz, to MCAP, no .rrd). Seconds are CPU time with that of children, or
wall time where the column says so, and are the least of all rounds. The ratio in brackets is to the
import of NumPy; that of the cold replay is to the warm one. All MCAP messages of the cold replay
must equal those of the warm one, byte for byte.

With ``--against COMMIT``, a row of that commit comes before the row of the tree; both are measured
in turns.
"""

from __future__ import annotations

import argparse
import io
import os
import subprocess
import tarfile
import tempfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

from checks.children import cost_of
from flights.long_log import write_log
from mcap.reader import make_reader

from bench.table import head, line, options_of

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "replay_logs" / "c172p_3211" / "log.tlog"
NUMPY, HELP, SHORT = "`import numpy`", "`yawid --help`", "a replay"
SHORT_WALL, COLD, WARM = "its wall", "cold, wall; messages", "compiling"
COMPILE = "from yawid.estimation.machine.runner import compile_behind; compile_behind()"
HOURS = {"off": "an hour", "auto": "manoeuvres"}
COLUMNS = (NUMPY, HELP, SHORT, SHORT_WALL, COLD, WARM, *HOURS.values())
MOST_OF_NUMPY, MOST_OF_WARM = 8.0, 2.0
"""Limits: the CPU of a replay over that of importing NumPy, and a cold replay's time over a warm
one's."""
MOVED_S, EVERY_S = 30.0, 300.0
"""The long logs have a manoeuvre of MOVED_S seconds in every EVERY_S seconds."""


@contextmanager
def sources(commit: str | None) -> Iterator[list[Path]]:
    """Yield the source folders to compare: that of ``commit``, if given, and that of the tree."""
    with tempfile.TemporaryDirectory() as folder:
        if commit is not None:
            git = ["git", "-C", str(ROOT), "archive", commit, "src"]
            packed = subprocess.run(git, check=True, capture_output=True).stdout
            with tarfile.open(fileobj=io.BytesIO(packed)) as tree:
                tree.extractall(folder, filter="data")
        yield [*([Path(folder) / "src"] if commit else []), ROOT / "src"]


def equal_messages(one: Path, other: Path) -> tuple[int, int]:
    """Return how many messages of two MCAPs are equal, and how many the longer file has.

    Messages at the same place in the two files are compared.
    """
    read = []
    for path in (one, other):
        with path.open("rb") as stream:
            messages = make_reader(stream).iter_messages(log_time_order=False)
            read.append([(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in messages])
    return sum(a == b for a, b in zip(*read, strict=False)), max(map(len, read))


class Bench:
    """Measures the code below ``source``, which writes its files to ``folder``.

    ``least`` are the least seconds by name; ``equal`` are the results of equal_messages.
    """

    def __init__(self, source: Path, folder: Path) -> None:
        self.least: dict[str, float] = {}
        self.equal: set[tuple[int, int]] = set()
        self._environment = os.environ | {"PYTHONPATH": str(source)}
        self._environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed yawid has bytecode
        self._folder = folder

    def compile(self) -> None:
        """Compile everything into a folder of this bench."""
        self._environment["NUMBA_CACHE_DIR"] = folder = str(self._folder / "compiled")
        self._warm(folder)
        self._replay()

    def short(self) -> None:
        """Measure one round of the short processes."""
        self._keep(NUMPY, self._run("-c", "import numpy")[0])
        self._keep(HELP, self._run("-m", "yawid", "--help")[0])
        cpu_s, wall_s = self._replay()
        self._keep(SHORT, cpu_s)
        self._keep(SHORT_WALL, wall_s)

    def cold(self) -> None:
        """Measure commands that find no compiled code, and compare the messages they write."""
        with tempfile.TemporaryDirectory() as empty:
            self._keep(COLD, self._replay("cold", empty)[1])
        self.equal.add(equal_messages(*(self._folder / out / "log.mcap" for out in ("", "cold"))))
        with tempfile.TemporaryDirectory() as empty:
            self._keep(WARM, self._warm(empty)[0])

    def hours(self, logs: list[Path]) -> None:
        """Measure replays of two logs, the second longer than the first."""
        for manoeuvres, name in HOURS.items():
            for i, log in enumerate(logs):
                self._keep(f"{name} {i}", self._replay("hours", log=log, manoeuvres=manoeuvres)[0])

    def seconds(self, hours: float) -> dict[str, float]:
        """Return the seconds by column; the second long log is ``hours`` longer than the first."""
        found = dict(self.least)
        for name in HOURS.values():
            if f"{name} 0" in found:
                found[name] = (found.pop(f"{name} 1") - found.pop(f"{name} 0")) / hours
        return found

    def _replay(
        self, out: str = "", compiled: str | None = None, log: Path = LOG, manoeuvres: str = "auto"
    ) -> tuple[float, float]:
        to = ["--out", str(self._folder / out), "--force", "--json", "--rerun", "off"]
        to += ["--manoeuvres", manoeuvres]
        answered = (0, 5)  # a usable answer or none
        return self._run(
            "-m", "yawid", "replay", str(log), *to, allowed=answered, compiled=compiled
        )

    def _warm(self, compiled: str) -> tuple[float, float]:
        return self._run("-c", COMPILE, compiled=compiled)

    def _run(
        self, *arguments: str, allowed: tuple[int, ...] = (0,), compiled: str | None = None
    ) -> tuple[float, float]:
        """Return the CPU and wall seconds of Python with these arguments."""
        folder = {} if compiled is None else {"NUMBA_CACHE_DIR": compiled}
        cost = cost_of(*arguments, allowed=allowed, env=self._environment | folder)
        return cost.cpu_s, cost.wall_s

    def _keep(self, name: str, seconds: float) -> None:
        self.least[name] = min(seconds, self.least.get(name, seconds))


def measured(options: argparse.Namespace) -> list[Bench]:
    """Return the benches after measuring: that of the commit, if asked for, and of the tree."""
    with sources(options.against) as trees, tempfile.TemporaryDirectory() as name:
        logs = [Path(name) / f"{i}.tlog" for i in (1, 2)]
        for i, log in enumerate(logs):
            write_log(log, options.hours * (i + 1), "raised", moved_s=MOVED_S, every_s=EVERY_S)
        benches = [Bench(tree, Path(name) / str(i)) for i, tree in enumerate(trees)]
        for bench in benches:
            bench.compile()
        for i in range(options.rounds):
            for bench in benches:
                bench.short()
                if i < options.cold_rounds:
                    bench.cold()
                if i < options.hour_rounds:
                    bench.hours(logs)
        return benches


def row(name: str, seconds: dict[str, float], equal: set[tuple[int, int]]) -> str:
    """Return the row of one source: seconds with ratios in brackets; unknown commands are empty."""
    cells = []
    for column in COLUMNS:
        if column not in seconds:
            cells.append("")
            continue
        cell = f"{seconds[column]:.3g}"
        if column == COLD:
            shares = ", ".join(f"{same} of {number} equal" for same, number in sorted(equal))
            cell += f" ({seconds[COLD] / seconds[SHORT_WALL]:.2g} x warm), {shares}"
        elif column not in (NUMPY, SHORT_WALL):
            cell += f" ({seconds[column] / seconds[NUMPY]:.2g})"
        cells.append(cell)
    return line(name, *cells)


def missed(seconds: dict[str, float], equal: set[tuple[int, int]]) -> str | None:
    """Return which limits are exceeded, in words; None if none is."""
    most = {(SHORT, NUMPY): MOST_OF_NUMPY, (COLD, SHORT_WALL): MOST_OF_WARM}
    exceeded = [
        f"{what}: {seconds[what] / seconds[of]:.1f} x {of}; {allowed:g} is allowed"
        for (what, of), allowed in most.items()
        if what in seconds and seconds[what] > allowed * seconds[of]
    ]
    exceeded += [f"{a} of {b} messages of a cold replay are equal" for a, b in equal if a != b]
    return "; ".join(exceeded) or None


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return what costs too much or differs when cold, None if nothing does."""
    own = {"against": str, "rounds": 5, "hours": 1.0, "hour_rounds": 2, "cold_rounds": 2}
    options = options_of("start", __doc__, arguments, **own)
    yield from head("", COLUMNS)
    benches = measured(options)
    found = [bench.seconds(options.hours) for bench in benches]
    for name, seconds, bench in zip(("before", "now")[-len(found) :], found, benches, strict=True):
        yield row(name, seconds, bench.equal)
    return missed(found[-1], benches[-1].equal)
