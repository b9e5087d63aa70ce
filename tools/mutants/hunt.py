"""Runs the tests that reach a mutant's line until one fails: the mutant is killed, or survives.

The map from lines to tests is recorded once for a commit (mutants/reach.py). A mutant's tests are
those of its own room, then the others; of both, first the files whose tests take least, as many as
fit into ``BUDGET_S``. Each mutant gets a process of its own, forked from one that has imported the
libraries, and not yawid. A test that kills must pass without the mutant under the same conditions;
if not, it is set aside and the mutant runs again.
"""

from __future__ import annotations

import ast
import importlib
import json
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from coverage.numbits import numbits_to_nums
from hypothesis import Phase, settings

from mutants.draw import GROUPS, Mutant, drawn, names

BUDGET_S = 40.0
"""Seconds of a processor, as recorded, that the tests of one mutant may take: a survivor costs
that. Without it one line that all tests reach costs ten minutes."""
LEAST_S = 0.1
"""Reading a file of tests takes about this."""
LIMIT_S = 60
"""A single test that takes more of a processor hangs: the slowest takes 10 s. By the clock it may
take as long as pyproject.toml allows."""
NOT_STARTED = "before the first test"
_LIBRARIES = (
    "numpy", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats", "hypothesis",
    "matplotlib.pyplot", "msgspec", "pyarrow.parquet", "llvmlite.binding", "rich.console",
)  # fmt: skip
_KERNEL = "estimation/kernel/"
"""Compiled: no line of it is seen. Whatever calls RUNNER reaches it."""


_LINES = """select path, context, numbits from line_bits join file on file.id = file_id
join context on context.id = context_id"""


@dataclass(frozen=True, slots=True)
class Test:
    """A test that passes, and what it costs."""

    name: str
    seconds: float

    @property
    def file(self) -> str:
        """Its file."""
        return self.name.split("::")[0]


@dataclass(frozen=True, slots=True)
class Named:
    """A place that reads a name; ``makes`` are the names of its module that it makes of it."""

    file: str
    line: int
    is_foreign: bool
    """Whether the name may be that of another module."""
    makes: tuple[str, ...]


class Map:
    """Which tests reach a mutant."""

    def __init__(self, recorded: Path, root: Path) -> None:
        rows = [json.loads(line) for line in (recorded / "tests.jsonl").open(encoding="utf-8")]
        self.tests = [Test(row["test"], row["s"]) for row in rows]
        self.passed = {number for number, row in enumerate(rows) if row["passed"]}
        self.leaning = defaultdict(set)
        for number, row in enumerate(rows):
            for each in row["leans"]:
                self.leaning[each].add(number)
        self.reached: dict[str, dict[int, set[int]]] = defaultdict(lambda: defaultdict(set))
        for path in recorded.glob("coverage*"):
            # Read by coverage.py itself, each file of each child would take a tenth of a second.
            with suppress(sqlite3.DatabaseError), closing(sqlite3.connect(path)) as data:
                for measured, context, bits in data.execute(_LINES):
                    of_file = self.reached[measured.split("/src/yawid/")[-1]]
                    for line in numbits_to_nums(bits) if context else ():
                        of_file[line].add(int(context))
        self.named: dict[str, list[Named]] = defaultdict(list)
        for path in root.rglob("*.py"):
            for name, where in _named(path.relative_to(root).as_posix(), path.read_bytes()):
                self.named[name].append(where)

    def of(self, mutant: Mutant) -> list[Test]:
        """Return the tests that reach a mutant, in the order in which they are tried."""
        if mutant.file.startswith(_KERNEL):
            direct = self._users("RUNNER", "estimation/machine/runner.py")
        elif mutant.name:
            direct = self._users(mutant.name, mutant.file) or self._inside(mutant.file)
        else:
            lines = range(mutant.lines[0], mutant.lines[1] + 1)
            direct = set().union(*(self.reached[mutant.file][line] for line in lines))
        leaning = set().union(*(self.leaning[each] for each in direct))
        return self._in_order(mutant, (direct | leaning) & self.passed)

    def _in_order(self, mutant: Mutant, numbers: set[int]) -> list[Test]:
        own = tuple(
            f"{top}/{room}/" for room in GROUPS[mutant.group] for top in ("tests", "src/yawid")
        )
        files = defaultdict(list)
        for number in sorted(numbers):
            files[self.tests[number].file].append(self.tests[number])
        costs = {file: LEAST_S + sum(each.seconds for each in files[file]) for file in files}
        chosen: list[Test] = []
        left = BUDGET_S
        for file in sorted(files, key=lambda file: (not file.startswith(own), costs[file], file)):
            left -= LEAST_S
            tests = files[file]
            if costs[file] > left:
                tests = sorted(tests, key=lambda each: (each.seconds, each.name))
            for each in tests:
                if each.seconds <= left:
                    chosen.append(each)
                    left -= each.seconds
        return chosen

    def _inside(self, file: str) -> set[int]:
        """Return the tests that run a function of a file."""
        return set().union(*self.reached[file].values())

    def _users(self, name: str, file: str) -> set[int]:
        """Return the tests that run a line of a function that names ``name``, defined in a file.

        Names that are made of it on import count as well.
        """
        found: set[int] = set()
        waiting, seen = [(name, file)], set[tuple[str, str]]()
        while waiting:
            name, file = waiting.pop()
            seen.add((name, file))
            for each in self.named[name]:
                if each.file == file or each.is_foreign:
                    found |= self.reached[each.file][each.line]
                    made = {(other, each.file) for other in each.makes}
                    waiting += made - seen
        return found


def _named(file: str, source: bytes) -> Iterator[tuple[str, Named]]:
    """Yield each name that a module's statements read, with the place."""
    tree = ast.parse(source)
    foreign = {
        each.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for each in node.names
    }
    for statement in tree.body:
        made = names(statement) if isinstance(statement, ast.Assign | ast.AnnAssign) else []
        for node in ast.walk(statement):
            match node:
                case ast.Name(id=name, lineno=line):
                    yield name, Named(file, line, name in foreign, tuple(made))
                case ast.Attribute(attr=name, lineno=line):
                    yield name, Named(file, line, True, tuple(made))


class Plan:
    """A pytest plugin that reads files of tests one by one and ends with the first failure."""

    def __init__(self, tests: Sequence[Test], note: Path) -> None:
        self.note = note
        self.wanted: dict[str, list[str]] = {}
        for each in tests:
            self.wanted.setdefault(each.file, []).append(each.name)

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> bool:
        """Leave the reading to the loop; a first counterexample suffices."""
        phases = (Phase.explicit, Phase.generate)
        settings.register_profile(
            "mutant", phases=phases, derandomize=True, database=None, deadline=None
        )
        settings.load_profile("mutant")
        session.items = []
        return True

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests in their order, up to the first that fails."""
        for file, wanted in self.wanted.items():
            self.note.write_text(file, encoding="utf-8")
            found = {each.nodeid: each for each in session.perform_collect([file])}
            items = [found[each] for each in wanted if each in found]
            for item, after in zip(items, [*items[1:], None], strict=True):
                self.note.write_text(item.nodeid, encoding="utf-8")
                limit_s = int(time.process_time()) + LIMIT_S
                resource.setrlimit(resource.RLIMIT_CPU, (limit_s, resource.RLIM_INFINITY))
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
                if session.testsfailed:
                    return True
            if session.testsfailed:
                return True
        self.note.write_text("", encoding="utf-8")
        return True


class Hunter:
    """Seeds mutants in a copy of the tree, one at a time, and looks for a test that notices."""

    def __init__(self, tree: Path, scratch: Path) -> None:
        self.tree, self.scratch = tree, scratch
        self.sound: set[str] = set()
        self.set_aside: set[str] = set()
        """Tests that fail here without a mutant."""
        for each in _LIBRARIES:
            importlib.import_module(each)

    def first_failure(self, tests: Sequence[Test]) -> str:
        """Return the first test that fails, in a process of its own; "" if all pass."""
        if not tests:
            return ""
        note = self.scratch / "note"
        note.write_text(NOT_STARTED, encoding="utf-8")
        child = os.fork()
        if child == 0:
            code = 70
            try:
                code = self._run(Plan(tests, note))
            finally:
                sys.stdout.flush()
                os._exit(code)
        os.waitpid(child, 0)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what its tests started and did not end
        return note.read_text(encoding="utf-8")

    def _run(self, plan: Plan) -> int:
        os.setsid()
        os.chdir(self.tree)
        with (self.scratch / "output").open("w", encoding="utf-8") as output:
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
        paths = [str(self.tree / "src"), str(self.tree / "tools")]
        os.environ.update(PYTHONPATH=os.pathsep.join(paths), MPLBACKEND="Agg")
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        sys.path[:0] = paths
        options = [
            "-q",
            "-W",
            "ignore::pytest.PytestAssertRewriteWarning",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:xdist",
            "--durations=0",
        ]
        options += [f"--basetemp={self.scratch / 'tmp'}"]
        return int(pytest.main([*options, "tests"], plugins=[plan]))

    def killer(self, mutant: Mutant, tests: Sequence[Test]) -> str:
        """Return the test that notices a mutant, "" if it survives."""
        path = self.tree / "src/yawid" / mutant.file
        source, times = path.read_bytes(), path.stat()
        while tests := [each for each in tests if each.name not in self.set_aside]:
            try:
                path.write_bytes(mutant.seeded(source))
                name = self.first_failure(tests)
            finally:
                path.write_bytes(source)
                # Else the mutant's bytecode, of the same second and size, might count as its own.
                os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            if not name or self.is_sound(name, tests):
                return name
        return ""

    def is_sound(self, name: str, tests: Sequence[Test]) -> bool:
        """Return whether a test, or all of a file, passes without a mutant; else set it aside."""
        if name not in self.sound:
            own = [each for each in tests if name in (each.name, each.file)]
            if failed := self.first_failure(own or tests[:1]):
                if failed == NOT_STARTED:
                    raise RuntimeError(f"pytest does not start: see {self.scratch / 'output'}")
                self.set_aside |= {each.name for each in own or tests[:1]}
                return False
            self.sound.add(name)
        return True


def hunt(root: Path, folder: Path, *, seed: int, count: int) -> Path:
    """Draw mutants, hunt each, and return the file with one row each; it goes on where it ended."""
    rows = folder / f"draw_{seed}.jsonl"
    done = len(rows.read_text(encoding="utf-8").splitlines()) if rows.exists() else 0
    package = folder / "tree/src/yawid"
    mutants = list(islice(drawn(package, seed), count))
    known = Map(folder / "reach", package)
    hunter = Hunter(folder / "tree", folder)
    for number, mutant in enumerate(mutants[done:], done + 1):
        began = time.monotonic()
        tests = known.of(mutant)
        killer = hunter.killer(mutant, tests)
        source = (package / mutant.file).read_bytes()
        line = source[source.rfind(b"\n", 0, mutant.start) + 1 :].split(b"\n")[0].strip()
        row: dict[str, Any] = {
            "number": number, "group": mutant.group, "kind": mutant.kind,
            "where": f"{mutant.file}:{source.count(bytes([10]), 0, mutant.start) + 1}",
            "line": line.decode(), "old": source[mutant.start : mutant.end].decode(),
            "new": mutant.new, "killer": killer, "tests": len(tests),
            "recorded_s": round(sum(each.seconds for each in tests), 1),
            "took_s": round(time.monotonic() - began, 1), "set_aside": sorted(hunter.set_aside),
        }  # fmt: skip
        with rows.open("a", encoding="utf-8") as file:
            print(json.dumps(row), file=file)
    return rows


def record(folder: Path) -> None:
    """Record which tests reach which lines, all tests but those marked slow or long."""
    reach = folder / "reach"
    if (reach / "ended").exists():
        return
    shutil.rmtree(reach, ignore_errors=True)
    reach.mkdir()
    tree = folder / "tree"
    paths = os.pathsep.join([str(tree / "src"), str(tree / "tools")])
    options = ["-q", "-p", "mutants.reach", "-p", "no:cacheprovider", "-p", "no:xdist"]
    environment = os.environ | {"REACH": str(reach), "PYTHONPATH": paths, "MPLBACKEND": "Agg"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, "-m", "pytest", *options, "-m", "not slow and not long"]
    with (folder / "reach.txt").open("w", encoding="utf-8") as output:
        subprocess.run(
            command, cwd=tree, env=environment, stdout=output, stderr=output, check=False
        )


def survivors(rows: Path) -> str:
    """Return the mutants that no test noticed, by room, a line each."""
    found = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    lines = sorted(
        f"{each['where']} {each['kind']}: {each['line']!r}: {each['old']!r} -> {each['new']!r}, "
        f"{each['tests']} tests"
        for each in found
        if not each["killer"]
    )
    return "".join(f"{line}\n" for line in lines)


def table(rows: Path, title: str) -> str:
    """Return the killed share of each room with its binomial sigma, as a Markdown table."""
    found = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    drawn_of, killed = Counter[str](), Counter[str]()
    for row in found:
        for each in (row["group"], "all"):
            drawn_of[each] += 1
            killed[each] += bool(row["killer"])
    lines = [f"| {title} | mutants | killed | share % | sigma % |", "|---|---|---|---|---|"]
    for each in (*GROUPS, "all"):
        if n := drawn_of[each]:
            p = killed[each] / n
            sigma = 100.0 * (p * (1.0 - p) / n) ** 0.5
            lines.append(f"| {each} | {n} | {killed[each]} | {100.0 * p:.0f} | {sigma:.0f} |")
    return "\n".join(lines)
