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
import json
import os
import random
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, islice
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
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
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
_OTHER = {
    ast.Lt: (ast.GtE, ast.LtE), ast.LtE: (ast.Gt, ast.Lt), ast.Gt: (ast.LtE, ast.GtE),
    ast.GtE: (ast.Lt, ast.Gt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
"""What a comparison becomes: the inverted one, and that with the other kind of limit."""
_SIGNS = {ast.USub: ast.UAdd, ast.Add: ast.Sub, ast.Sub: ast.Add}
_CHANGED = (ast.stmt, ast.Constant, ast.UnaryOp, ast.BinOp, ast.Compare)
_TEXTS = (ast.JoinedStr, ast.List, ast.Tuple, ast.Set, ast.Dict)
COVERAGE = """
[run]
source_pkgs = yawid
core = ctrace
parallel = true
disable_warnings = no-data-collected,module-not-imported,module-not-measured
data_file = {}
"""


class Site(NamedTuple):
    """A place of a syntax tree: the ``field`` of ``holder`` may have one of ``others``."""

    kind: str
    holder: ast.AST
    field: str
    others: list[Any]
    lines: range
    """The lines of the statement, of a compound one those of its head."""
    on_import: bool


Change = tuple[str, ast.AST, str, list[Any]]


def sites(tree: ast.Module) -> Iterator[Site]:
    """Yield what can be changed in a module."""
    above = {
        each: (parent, field)
        for parent in ast.walk(tree)
        for field, value in ast.iter_fields(parent)
        for each in (value if isinstance(value, list) else [value])
        if isinstance(each, ast.AST)
    }
    for node in (each for each in ast.walk(tree) if isinstance(each, _CHANGED)):
        way: list[tuple[ast.AST, str]] = [(node, "")]
        while way[-1][0] in above:
            way.append(above[way[-1][0]])
        own = next((each for each, _ in way if isinstance(each, ast.stmt)), None)
        if own is None or any(_stays(*each) for each in way):
            continue
        later = (ast.FunctionDef, ast.Lambda)
        on_import = not any(field == "body" and isinstance(each, later) for each, field in way)
        scope = next((each for each, _ in way[1:] if isinstance(each, ast.FunctionDef)), tree)
        body = getattr(own, "body", None)
        last = body[0].lineno - 1 if body else own.end_lineno
        lines = range(own.lineno, max(last or 0, own.lineno) + 1)
        for change in _changes(node, *way[1], scope):
            yield Site(*change, lines, on_import)


def _stays(node: ast.AST, field: str) -> bool:
    """Return whether what ``field`` of a node has stays as it is."""
    match node:
        case ast.JoinedStr() | ast.Assert() | ast.Import() | ast.ImportFrom() | ast.arg():
            return True
        case (
            ast.If(test=ast.Compare(left=ast.Name(id="__name__")))
            | ast.Assign(targets=[ast.Name(id="__all__")])
        ):
            return True
    return field in ("annotation", "returns")


def _changes(node: ast.AST, parent: ast.AST, field: str, scope: ast.AST) -> Iterator[Change]:
    """Yield the changes of a node, which is in a ``field`` of its parent."""
    match node:
        case ast.Constant(value=bool()):
            return
        case ast.Constant(value=float(x)) if x:
            yield "constant", node, "value", [float(f"{1.1 * x:.12g}")]
        case ast.Constant(value=int(n)) if n >= SMALL:
            yield "constant", node, "value", [round(1.1 * n)]
        case ast.Constant(value=int(n)):
            yield "off by one", node, "value", [n - 1, n + 1]
        case ast.UnaryOp(op=op) | ast.BinOp(op=op) | ast.AugAssign(op=op):
            if type(op) in _SIGNS and not _is_text(node):
                yield "sign", node, "op", [_SIGNS[type(op)]()]
        case ast.Compare(ops=ops):
            for i, limit in enumerate(ops):
                others = [[*ops[:i], other(), *ops[i + 1 :]] for other in _OTHER[type(limit)]]
                yield "comparison", node, "ops", others
    if isinstance(node, ast.stmt) and _can_go(node, scope):
        left = [ast.Pass() if each is node else each for each in getattr(parent, field)]
        yield "statement", parent, field, [left]


def _is_text(node: ast.AST) -> bool:
    """Return whether an operand of + is a text or a list, which has no other sign."""
    if isinstance(node, ast.BinOp | ast.AugAssign):
        return any(_is_text(each) for each in ast.iter_child_nodes(node))
    is_text = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return is_text or isinstance(node, _TEXTS)


def _can_go(node: ast.stmt, scope: ast.AST) -> bool:
    """Return whether a statement can be dropped and what follows still knows its names."""
    match node:
        case ast.Expr(value=ast.Constant()):
            return False
        case ast.Expr() | ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break():
            return True
        case ast.If(orelse=[]) | ast.Assign() | ast.Delete():
            known = {name for name, line in _bound(scope) if line < node.lineno}
            return all(name in known for name, _ in _bound(node))
    return False


@lru_cache(maxsize=1000)
def _bound(node: ast.AST) -> set[tuple[str, int]]:
    """Return the names that are bound below a node, with their lines; arguments have none."""
    return {
        (each.arg, 0) if isinstance(each, ast.arg) else (each.id, each.lineno)
        for each in ast.walk(node)
        if isinstance(each, ast.arg)
        or (isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))
    }


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
        setattr(site.holder, site.field, site.others[self.other])
        return ast.unparse(ast.fix_missing_locations(tree))


def drawn(root: Path, seed: int) -> Iterator[Mutant]:
    """Yield mutants of the package ``root`` in random order, one of each group in turn.

    Of a group's mutants, each kind is drawn as often as the others.
    """
    chance, left = random.Random(seed), dict[str, dict[str, list[Mutant]]]()
    for group, rooms in GROUPS.items():
        every = [
            Mutant(group, site.kind, path.relative_to(root).as_posix(), number,
                   chance.randrange(len(site.others)), site.lines, site.on_import)
            for room in rooms
            for path in sorted((root / room).rglob("*.py"))
            for number, site in enumerate(sites(ast.parse(path.read_bytes())))
        ]  # fmt: skip
        chance.shuffle(every)
        left[group] = {kind: [each for each in every if each.kind == kind] for kind in KINDS}
    while True:
        for of_kind in left.values():
            yield of_kind[chance.choice([kind for kind in KINDS if of_kind[kind]])].pop()


class Recorded(NamedTuple):
    """What a file of tests cost, which of its tests failed, and which lines of each file it ran."""

    seconds: float
    failed: list[str]
    lines: dict[str, list[int]]


def recorded(copy: Copy, folder: Path, test: str) -> Recorded:
    """Run a file of tests; child processes write their lines next to its own."""
    kept = folder / f"{test.replace('/', '.')}.json"
    if not kept.exists():
        from coverage import Coverage

        settings = folder / "coveragerc"
        settings.write_text(COVERAGE.format(folder / "coverage"), encoding="utf-8")
        under = ("-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest")
        before = sum(os.times()[:4])
        code, output = copy.run(
            *GATE, "--maxfail=1000", test, under=under, COVERAGE_PROCESS_START=str(settings)
        )
        seconds, cover = sum(os.times()[:4]) - before, Coverage(config_file=str(settings))
        cover.combine()
        data = cover.get_data()
        files = data.measured_files() if code in (0, 1) else ()
        lines = {file.split("/src/yawid/")[-1]: data.lines(file) for file in files}
        cover.erase()
        kept.write_text(json.dumps([seconds, FAILED.findall(output), lines]), encoding="utf-8")
    return Recorded(*json.loads(kept.read_text(encoding="utf-8")))


def reaching(mutant: Mutant, reach: Mapping[str, Recorded]) -> list[str]:
    """Return the files of tests that reach a mutant, in the order in which they are tried."""
    file = RUNNER if mutant.file.startswith(KERNEL) else mutant.file
    own = tuple(f"{top}/{room}/" for room in GROUPS[mutant.group] for top in ("tests", "src"))
    by_test = {test: set(of.lines[file]) for test, of in reach.items() if of.lines.get(file)}
    found = [test for test, lines in by_test.items() if lines & set(mutant.lines)]
    if by_test and (mutant.on_import or file == RUNNER):
        imported = set.intersection(*by_test.values())
        found = [test for test, lines in by_test.items() if lines - imported] or list(by_test)
    order = sorted(found, key=lambda test: (not test.startswith(own), reach[test].seconds, test))
    start_s = min((of.seconds for of in reach.values()), default=0.0)  # of pytest: it is paid once
    spent = accumulate(reach[test].seconds - start_s for test in order)
    return [test for test, s in zip(order, spent, strict=True) if s <= BUDGET_S] or order[:1]


def hunt(copy: Copy, folder: Path, tests: Sequence[str], seed: int, count: int) -> list[Any]:
    """Draw mutants, hunt each, and return their rows; it goes on where it ended.

    First all files of the copy are written as ``ast`` writes them; a test that fails with them is
    set aside.
    """
    for path in copy.package.rglob("*.py"):
        path.write_text(ast.unparse(ast.parse(path.read_bytes())), encoding="utf-8")
    reach = {test: recorded(copy, folder, test) for test in tests}
    aside = [f"--deselect={name}" for of in reach.values() for name in of.failed]
    path = folder / f"draw_{seed}.jsonl"
    done = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for mutant in islice(drawn(copy.package, seed), len(done), count):
        began, some = time.monotonic(), reaching(mutant, reach)
        old = (copy.package / mutant.file).read_text(encoding="utf-8")
        new, code, output = mutant.seeded(old), 0, ""
        with copy.seeded(mutant.file, new):
            if some:
                code, output = copy.run(*GATE, *some, *aside, limit_s=HANG_S)
        failed = FAILED.findall(output) or ["none ended"]
        row = {
            "group": mutant.group, "kind": mutant.kind, "tests": some,
            "killer": "" if code in (0, NO_TESTS) else failed[0],
            "where": f"{mutant.file}:{mutant.lines.start}",
            "old": [x.strip() for x in old.splitlines() if x not in new.splitlines()],
            "new": [x.strip() for x in new.splitlines() if x not in old.splitlines()],
            "took_s": round(time.monotonic() - began, 1),
        }  # fmt: skip
        done.append(json.dumps(row))
        path.write_text("\n".join(done), encoding="utf-8")
    return list(map(json.loads, done))


def table(rows: Sequence[Any], title: str) -> str:
    """Return the killed share of each room with its binomial sigma, as a Markdown table."""
    lines = [f"| {title} | mutants | killed | share % | sigma % |", "|---|---|---|---|---|"]
    for name in (*GROUPS, "all"):
        some = [bool(row["killer"]) for row in rows if name in (row["group"], "all")]
        p, n = sum(some) / max(len(some), 1), max(len(some), 1)
        sigma = 100.0 * (p * (1.0 - p) / n) ** 0.5
        lines.append(f"| {name} | {len(some)} | {sum(some)} | {100.0 * p:.0f} | {sigma:.0f} |")
    return "\n".join(lines)
