"""Mutants of src/yawid: drawn at random, and run against the files of tests that reach their line.

A mutant changes one thing: a number (a float, or an integer from 20 on, times 1.1; a smaller
integer, which is an index or a size, by one), a sign, a comparison (its limit, or inverted), or it
drops a statement. Texts, annotations, assertions and ``__all__`` stay as they are. A statement that
binds a new name is not dropped, nor one that returns or defines: any test that reaches what follows
would end in a NameError, which shows nothing. A mutant runs the files of tests that reach its line:
those of its own room first, then the cheapest, up to ``BUDGET_S``.
"""

from __future__ import annotations

import ast
import functools
import json
import os
import random
import re
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from mutate import KERNEL, Copy

RUNNER = "estimation/machine/runner.py"
"""The kernel is compiled, so that no line of it is seen: whatever runs RUNNER reaches it."""
BUDGET_S = 40.0
"""Seconds of a processor, as recorded, that the tests of one mutant may take: a survivor costs
that. Without it one line that all tests reach costs ten minutes."""
HANG_S = 240.0
"""Time limit in s of the tests of a mutant: if they take longer, they have noticed."""
GATE = ("-m", "not slow and not long")
NO_TESTS = 5
GROUPS = {
    "estimation": ("estimation",),
    "physics": ("physics",),
    "manoeuvre, results": ("manoeuvre", "results"),
    "lateral": ("lateral",),
    "channels": ("channels",),
    "sources": ("sources",),
    "models, damper": ("models", "damper"),
    "sinks, report": ("sinks", "report"),
}
"""Rooms that share the mutants equally, by their name in the table."""
KINDS = ("constant", "off by one", "sign", "comparison", "statement")
SMALL = 20
"""An integer from here on is a quantity; times 1.1 it is another integer."""
_LIMIT = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_INVERTED = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_TEXTS = (ast.JoinedStr, ast.List, ast.Tuple, ast.Set, ast.Dict)
_KEPT = (ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom, ast.arg)
COVERAGE = """
[run]
source_pkgs = yawid
core = ctrace
parallel = true
disable_warnings = no-data-collected,module-not-imported,module-not-measured
data_file = {}
"""


class Site(NamedTuple):
    """A place of a syntax tree: ``holder[key]`` or ``holder.key`` may become one of ``others``."""

    kind: str
    holder: Any
    key: Any
    others: list[ast.AST]
    lines: range
    """The lines of the statement, of a compound one those of its head."""
    on_import: bool


def sites(tree: ast.Module) -> Iterator[Site]:
    """Yield what can be changed in a module."""
    yield from _below(tree, range(0), True, set())


def _below(node: ast.AST, lines: range, on_import: bool, bound: set[str]) -> Iterator[Site]:
    """Yield the sites below a node; ``bound`` has the names that its function knows."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns"):
            continue
        is_run_later = field == "body" and isinstance(node, ast.FunctionDef | ast.Lambda)
        inside = on_import and not is_run_later
        for key, each in enumerate(value) if isinstance(value, list) else [(field, value)]:
            if not isinstance(each, ast.AST) or isinstance(each, _KEPT) or _is_door(each):
                continue
            holder = value if isinstance(value, list) else node
            own, known = lines, bound
            if isinstance(each, ast.stmt):
                body = getattr(each, "body", None)
                last = body[0].lineno - 1 if body else each.end_lineno
                own = range(each.lineno, max(last or 0, each.lineno) + 1)
            if isinstance(each, ast.FunctionDef):
                known = {part.arg for part in ast.walk(each.args) if isinstance(part, ast.arg)}
            if found := _others(each, node, known):
                yield Site(found[0], holder, key, found[1], own, inside)
            yield from _below(each, own, inside, known)
            if isinstance(each, ast.stmt) and not isinstance(each, ast.FunctionDef | ast.ClassDef):
                bound |= _stored(each)


def _others(each: ast.AST, parent: ast.AST, bound: set[str]) -> tuple[str, list[ast.AST]] | None:
    """Return the kind of change of a node, and what it may become; None if it stays."""
    match each:
        case ast.Constant(value=bool() | str() | bytes() | None):
            return None
        case ast.Constant(value=float(x)) if x:
            return "constant", [ast.Constant(float(f"{1.1 * x:.12g}"))]
        case ast.Constant(value=int(n)) if n >= SMALL:
            return "constant", [ast.Constant(round(1.1 * n))]
        case ast.Constant(value=int(n)):
            return "off by one", [ast.Constant(n - 1), ast.Constant(n + 1)]
        case ast.USub():
            return "sign", [ast.UAdd()]
        case ast.Add() | ast.Sub() if not _is_text(parent):
            return "sign", [ast.Sub() if isinstance(each, ast.Add) else ast.Add()]
        case ast.cmpop():
            kinds = dict.fromkeys([_INVERTED[type(each)], _LIMIT.get(type(each))])
            return "comparison", [kind() for kind in kinds if kind]
        case ast.stmt() if _can_go(each, bound):
            return "statement", [ast.Pass()]
    return None


def _is_text(node: ast.AST) -> bool:
    """Return whether an operand of + is a text or a list, which has no other sign."""
    if isinstance(node, ast.BinOp | ast.AugAssign):
        return any(_is_text(each) for each in ast.iter_child_nodes(node))
    is_text = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return is_text or isinstance(node, _TEXTS)


def _can_go(node: ast.stmt, bound: set[str]) -> bool:
    """Return whether a statement can be dropped and what follows still knows its names."""
    match node:
        case ast.Expr(value=ast.Constant()):
            return False
        case ast.Expr() | ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break():
            return True
        case ast.If(orelse=[]) | ast.Assign() | ast.Delete():
            return not _stored(node) - bound
    return False


def _stored(node: ast.AST) -> set[str]:
    names = (each for each in ast.walk(node) if isinstance(each, ast.Name))
    return {each.id for each in names if isinstance(each.ctx, ast.Store)}


def _is_door(node: ast.AST) -> bool:
    """Return whether a statement names what a module gives to others, or runs it as a program."""
    match node:
        case ast.If(test=ast.Compare(left=ast.Name(id="__name__"))):
            return True
        case ast.Assign(targets=[ast.Name(id="__all__")]):
            return True
    return False


@dataclass(frozen=True, slots=True)
class Mutant:
    """Site number ``site`` of ``file`` (below src/yawid) becomes number ``other`` of its others."""

    group: str
    kind: str
    file: str
    site: int
    other: int
    lines: range
    on_import: bool

    def seeded(self, source: str) -> str:
        """Return the file's text with the mutant, as ``ast`` writes it."""
        tree = ast.parse(source)
        site = next(islice(sites(tree), self.site, None))
        if isinstance(site.holder, list):
            site.holder[site.key] = site.others[self.other]
        else:
            setattr(site.holder, site.key, site.others[self.other])
        return ast.unparse(ast.fix_missing_locations(tree))


def drawn(root: Path, seed: int) -> Iterator[Mutant]:
    """Yield mutants of the package ``root`` in random order, one of each group in turn.

    Of a group's mutants, each kind is drawn as often as the others.
    """
    chance = random.Random(seed)
    left: dict[str, dict[str, list[tuple[str, int, Site]]]] = {}
    for group, rooms in GROUPS.items():
        paths = [path for room in rooms for path in sorted((root / room).rglob("*.py"))]
        found = [
            (path.relative_to(root).as_posix(), number, site)
            for path in paths
            for number, site in enumerate(sites(ast.parse(path.read_bytes())))
        ]
        left[group] = {kind: [each for each in found if each[2].kind == kind] for kind in KINDS}
    while True:
        for group in GROUPS:
            kinds = [kind for kind in KINDS if left[group][kind]]
            if not kinds:
                return
            some = left[group][chance.choice(kinds)]
            file, number, site = some.pop(chance.randrange(len(some)))
            other = chance.randrange(len(site.others))
            yield Mutant(group, site.kind, file, number, other, site.lines, site.on_import)


class Reach:
    """Which files of tests run, what each costs, and which lines it reaches."""

    def __init__(self, copy: Copy, folder: Path, tests: Sequence[str]) -> None:
        self.seconds: dict[str, float] = {}
        self.lines: dict[str, dict[str, set[int]]] = {}
        for number, test in enumerate(tests):
            kept = folder / f"reach_{number}.json"
            if not kept.exists():
                kept.write_text(json.dumps(self._recorded(copy, folder, test)), encoding="utf-8")
            test, code, seconds, lines = json.loads(kept.read_text(encoding="utf-8"))
            if code in (0, 1):
                self.seconds[test] = seconds
                self.lines[test] = {file: set(some) for file, some in lines.items()}

    def _recorded(self, copy: Copy, folder: Path, test: str) -> tuple[str, int, float, Any]:
        """Run a file of tests; child processes write their lines next to its own."""
        from coverage import CoverageData

        settings = folder / "coveragerc"
        settings.write_text(COVERAGE.format(folder / "coverage"), encoding="utf-8")
        under = ("-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest")
        before = sum(os.times()[:4])
        asked = (*GATE, "--maxfail=1000", test)
        code, _ = copy.run(*asked, under=under, COVERAGE_PROCESS_START=str(settings))
        lines: dict[str, set[int]] = {}
        for path in folder.glob("coverage.*"):
            data = CoverageData(str(path))
            data.read()
            for file in data.measured_files():
                name = file.split("/src/yawid/")[-1]
                lines.setdefault(name, set()).update(data.lines(file) or ())
            path.unlink()
        return test, code, sum(os.times()[:4]) - before, {k: sorted(v) for k, v in lines.items()}

    def of(self, mutant: Mutant) -> list[str]:
        """Return the files that reach a mutant, in the order in which they are tried."""
        file = RUNNER if mutant.file.startswith(KERNEL) else mutant.file
        own = tuple(f"{top}/{room}/" for room in GROUPS[mutant.group] for top in ("tests", "src"))
        by_test = {test: lines[file] for test, lines in self.lines.items() if lines.get(file)}
        imported = functools.reduce(set.intersection, by_test.values()) if by_test else set()
        of = set(mutant.lines)
        found = [test for test, lines in by_test.items() if lines & of]
        if mutant.on_import or file == RUNNER:
            found = [test for test, lines in by_test.items() if lines - imported] or list(by_test)
        spent, chosen, start_s = 0.0, list[str](), min(self.seconds.values(), default=0.0)
        for test in sorted(found, key=lambda t: (not t.startswith(own), self.seconds[t], t)):
            spent += self.seconds[test] - start_s  # what pytest needs to start is paid once
            if not chosen or spent <= BUDGET_S:
                chosen.append(test)
        return chosen


def killer(copy: Copy, mutant: Mutant, tests: Sequence[str], aside: set[str]) -> str:
    """Return the test that notices a mutant, "" if it survives.

    A test that fails with the file as ``ast`` writes it, too, is put into ``aside``.
    """
    source = (copy.package / mutant.file).read_text(encoding="utf-8")
    same, other = ast.unparse(ast.parse(source)), mutant.seeded(source)
    while tests:
        left_out = [f"--deselect={each}" for each in aside]
        with copy.seeded(mutant.file, other):
            code, output = copy.run(*GATE, *tests, *left_out, limit_s=HANG_S)
        if code in (0, NO_TESTS):
            return ""
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
        name = failed[1] if failed else "none ended"
        with copy.seeded(mutant.file, same):
            if not failed or copy.run(*GATE, name)[0] == 0:
                return name
        aside.add(name)
    return ""


def hunt(copy: Copy, folder: Path, reach: Reach, *, seed: int, count: int) -> list[dict[str, Any]]:
    """Draw mutants, hunt each, and return their rows; it goes on where it ended."""
    path, aside = folder / f"draw_{seed}.jsonl", set[str]()
    done = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for mutant in islice(drawn(copy.package, seed), len(done), count):
        began, tests = time.monotonic(), reach.of(mutant)
        source = (copy.package / mutant.file).read_text(encoding="utf-8")
        old, new = (ast.unparse(ast.parse(x)).splitlines() for x in (source, mutant.seeded(source)))
        row = {
            "group": mutant.group, "kind": mutant.kind, "tests": tests,
            "killer": killer(copy, mutant, tests, aside),
            "where": f"{mutant.file}:{mutant.lines.start}",
            "old": [x.strip() for x in old if x not in new],
            "new": [x.strip() for x in new if x not in old],
            "took_s": round(time.monotonic() - began, 1), "set_aside": sorted(aside),
        }  # fmt: skip
        done.append(json.dumps(row))
        with path.open("a", encoding="utf-8") as file:
            print(done[-1], file=file)
    return list(map(json.loads, done))


def table(rows: Sequence[Any], title: str) -> str:
    """Return the killed share of each room with its binomial sigma, as a Markdown table."""
    drawn_of = Counter(name for row in rows for name in (row["group"], "all"))
    killed = Counter(name for row in rows if row["killer"] for name in (row["group"], "all"))
    lines = [f"| {title} | mutants | killed | share % | sigma % |", "|---|---|---|---|---|"]
    for name, n in ((name, drawn_of[name]) for name in (*GROUPS, "all") if drawn_of[name]):
        p = killed[name] / n
        sigma = 100.0 * (p * (1.0 - p) / n) ** 0.5
        lines.append(f"| {name} | {n} | {killed[name]} | {100.0 * p:.0f} | {sigma:.0f} |")
    return "\n".join(lines)
