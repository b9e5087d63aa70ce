"""Seeds small defects one at a time in a copy of the tree, and checks that a test notices each.

    python tools/mutate.py --draw 300 --seed 7   # drawn at random: a table of killed shares

A mutant changes one thing: a number (a float, or an integer from 20 on, times 1.1; a smaller
integer, which is an index or a size, by one), a sign, a comparison (its limit, or inverted), or it
drops a statement. Texts, annotations and assertions stay as they are, and so do the signs of a sum
in which a text is written. A statement that binds a name is not dropped (but one with += is), nor
one that returns or defines: any test that reaches what follows could end in a NameError, which
shows nothing.

First one run of the gate's tests records under the library coverage which file of tests reaches
which lines. Then each mutant runs the files that reach it: those of its own room first, then the
cheapest, up to ``BUDGET_S``. A folder in the temporary folder keeps the record and a row of each
mutant as it ends (draw_SEED.json). The same command goes on where it was stopped; a record that was
not complete begins again.

tests/test_mutations.py, marked ``long``, seeds the defects of checks/defects.toml. Each names one
test that must fail: if that ends in any other way, it has not caught the defect. For a defect in
the kernel, or in the code that compiles it, the kernel runs as plain Python, which gives the same
bits and need not be compiled for each defect. For all others it is compiled once, as fits in plain
Python take minutes.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate, chain, islice, product, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from checks.children import LONG_S, child
from coverage import Coverage, CoverageData

ROOT = Path(__file__).resolve().parents[1]
PLAIN = ("estimation/kernel/", "estimation/machine/")
BUDGET_S = 40.0
"""Seconds, as recorded, that the tests of one mutant may take: a survivor costs that. Without it
one line that all tests reach costs ten minutes. Record on a machine that does nothing else."""
GATE = ("-m", "not slow and not long")
NO_TESTS = 5
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
TOOK = re.compile(r"^([\d.]+)s \w+ +([^:\s]+)", re.MULTILINE)
"""A line of pytest's durations: seconds, and the file of a test."""
DEFECTS: list[dict[str, str]] = tomllib.loads(
    (ROOT / "tools/checks/defects.toml").read_text(encoding="utf-8")
)["defect"]
GROUPS = (
    "estimation", "physics", "manoeuvre, results", "lateral", "channels", "sources",
    "models, damper", "sinks, report",
)  # fmt: skip
"""Rooms that share the mutants equally."""
KINDS = ("constant", "off by one", "sign", "comparison", "statement")
SMALL = 20
"""An integer from here on is a quantity; times 1.1 it is another integer."""
_OTHER: dict[type, tuple[Any, ...]] = {
    ast.Lt: (ast.GtE, ast.LtE), ast.LtE: (ast.Gt, ast.Lt), ast.Gt: (ast.LtE, ast.GtE),
    ast.GtE: (ast.Lt, ast.Gt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
    ast.USub: (ast.UAdd,), ast.Add: (ast.Sub,), ast.Sub: (ast.Add,),
}  # fmt: skip
"""What an operator becomes; a comparison the inverted one, and that with the other limit."""
_DROPPED = (ast.Expr, ast.Raise, ast.Continue, ast.Break, ast.If, ast.Assign, ast.Delete)


def copied(folder: Path) -> Path:
    """Copy the tree, in which one file of the sources at a time will be another."""
    return shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__"))


def run(
    tree: Path,
    *tests: str,
    plain: bool = False,
    within_s: float = 300.0,
    under: Sequence[str] = (),
) -> tuple[int, str]:
    """Run tests in a copy; return pytest's exit code (1: some failed) and what it printed.

    With ``plain``, the kernel runs as plain Python. After ``within_s``, the tests and their
    children are ended, and the code is another one: tests that take longer have noticed a mutant.
    Of Hypothesis the first counterexample suffices: reducing it would take minutes.
    """
    command = [
        "timeout", "--kill-after=9", str(within_s), sys.executable, *under, "-m", "pytest", "-x",
        "-q", "-p", "no:cacheprovider", "--hypothesis-profile=first", *tests,
    ]  # fmt: skip
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(tree / "src"), str(tree / "tools")]),
        "MPLBACKEND": "Agg", "NUMBA_DISABLE_JIT": str(int(plain)), "COVERAGE_CORE": "ctrace",
    }  # fmt: skip
    with child(
        command, 2.0 * within_s, cwd=tree, env=environment,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        said, _ = process.communicate(timeout=2.0 * within_s)
        return process.returncode, said


def seeded(
    tree: Path, file: str, source: bytes, *tests: str, plain: bool = False
) -> tuple[int, str]:
    """Run tests while a file (below src/yawid) has another source; see :func:`run`."""
    path = tree / "src/yawid" / file
    kept = path.read_bytes()
    try:
        path.write_bytes(source)
        return run(tree, *tests, plain=plain)
    finally:
        path.write_bytes(kept)


def catches(tree: Path, defect: Mapping[str, str]) -> bool:
    """Return whether the defect's test fails with the defect seeded."""
    file, text = defect["file"], (ROOT / "src/yawid" / defect["file"]).read_text(encoding="utf-8")
    new = text.replace(defect["old"], defect["new"]).encode()
    return seeded(tree, file, new, defect["test"], plain=file.startswith(PLAIN))[0] == 1


def misplaced(defects: Sequence[Mapping[str, str]]) -> list[str]:
    """Return in words the defects whose pattern is not exactly once in its file."""
    return [
        f"{each['what']}: {count} times in {each['file']}: {each['old']!r}"
        for each in defects
        if (
            count := (ROOT / "src/yawid" / each["file"])
            .read_text(encoding="utf-8")
            .count(each["old"])
        )
        != 1
    ]


class Mutant(NamedTuple):
    """The bytes of ``file`` (below src/yawid) from ``start`` to ``stop`` become ``new``."""

    group: str
    file: str
    kind: str
    new: str
    lines: range
    start: int
    stop: int

    def seeded(self, source: bytes) -> bytes:
        """Return the file's source with the mutant."""
        return source[: self.start] + self.new.encode() + source[self.stop :]


def mutants(source: bytes, group: str = "", file: str = "") -> Iterator[Mutant]:
    """Yield every mutant of a module."""
    starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]
    for node in _free(ast.parse(source)):
        for kind, new in _changes(node):
            yield Mutant(
                group, file, kind, ast.unparse(new), range(node.lineno, node.end_lineno + 1),
                start=starts[node.lineno - 1] + node.col_offset,
                stop=starts[node.end_lineno - 1] + node.end_col_offset,
            )  # fmt: skip


def _free(node: ast.AST) -> Iterator[Any]:
    """Yield the nodes of a tree that may change: no text, assertion or annotation."""
    yield node
    fixed = [getattr(node, field, None) for field in ("annotation", "returns")]
    for each in ast.iter_child_nodes(node):
        if each not in fixed and not isinstance(each, ast.JoinedStr | ast.Assert):
            yield from _free(each)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield the kind of each change of a node, and what the node becomes."""
    match node:
        case ast.Constant(value=bool()) | ast.Expr(value=ast.Constant()):
            return
        case ast.Constant(value=float(x)) if x:
            yield "constant", ast.Constant(float(f"{1.1 * x:.12g}"))
        case ast.Constant(value=int(n)) if n >= SMALL:
            yield "constant", ast.Constant(round(1.1 * n))
        case ast.Constant(value=int(n)):
            yield from (("off by one", ast.Constant(other)) for other in (n - 1, n + 1))
        case ast.UnaryOp(op=op) | ast.BinOp(op=op) | ast.AugAssign(op=op):
            others = () if {"'", '"'} & {*ast.unparse(node)} else _OTHER.get(type(op), ())
            yield from (("sign", type(node)(**vars(node) | {"op": other()})) for other in others)
        case ast.Compare(left, ops, compared):
            yield from (
                ("comparison", ast.Compare(left, [*ops[:i], other(), *ops[i + 1 :]], compared))
                for i, limit in enumerate(ops)
                for other in _OTHER[type(limit)]
            )
    if isinstance(node, ast.AugAssign) or (
        isinstance(node, _DROPPED)
        and not getattr(node, "orelse", [])
        and ast.Store not in {type(x.ctx) for x in ast.walk(node) if isinstance(x, ast.Name)}
    ):
        yield "statement", ast.Pass()


def drawn(package: Path, seed: int) -> Iterator[Mutant]:
    """Yield all mutants of a package in random order, one of each kind and group in turn."""
    every = [
        mutant
        for group in GROUPS
        for room in group.split(", ")
        for path in sorted((package / room).rglob("*.py"))
        for mutant in mutants(path.read_bytes(), group, path.relative_to(package).as_posix())
    ]
    random.Random(seed).shuffle(every)
    cells = (
        [each for each in every if (each.kind, each.group) == cell]
        for cell in product(KINDS, GROUPS)
    )
    for row in zip_longest(*cells):
        yield from filter(None, row)


def pytest_runtest_logstart(nodeid: str) -> None:
    """Name the file whose test begins, as a plugin of pytest: the lines that follow are its own.

    So it shares no run with other files (tests/support/finished_runs.py).
    """
    os.environ.pop("YAWID_TEST_RUNS", None)
    if cover := Coverage.current():
        cover.switch_context(nodeid.partition("::")[0])


def recorded(tree: Path, folder: Path, tests: Sequence[str]) -> tuple[CoverageData, str]:
    """Run the tests once; return which of their files reach which lines, and what pytest printed.

    What runs in a child process is not seen. What runs on import belongs to no file, as pytest
    imports all modules before the first test, to look for examples in their docstrings.
    """
    kept, data = folder / "recorded.txt", CoverageData(str(folder / "coverage"))
    if not kept.exists():
        code, said = run(
            tree, *GATE, "-p", "mutate", "--maxfail=1000", "--durations=0", "--durations-min=0",
            *tests, within_s=LONG_S,
            under=("-m", "coverage", "run", f"--data-file={folder}/coverage", "--source=yawid"),
        )  # fmt: skip
        if code not in (0, 1):
            raise SystemExit(said)
        kept.write_text(said, encoding="utf-8")
    data.read()
    return data, kept.read_text(encoding="utf-8")


def reaching(
    mutant: Mutant, package: Path, data: CoverageData, took_s: Mapping[str, float]
) -> list[str]:
    """Return the files of tests that reach a mutant, in the order in which they are tried.

    A line that no test is seen to reach, as it runs on import, compiled, in a child process or
    never, may be reached by every file that runs something of its module, and by those of its room.
    """
    by_line = data.contexts_by_lineno(str(package / mutant.file))
    own = tuple(
        f"{top}/{room}/" for top in ("tests", "src/yawid") for room in mutant.group.split(", ")
    )
    found = {test for line in mutant.lines for test in by_line.get(line, ())}
    if found <= {""}:
        in_room = (test for test in data.measured_contexts() if test.startswith(own))
        found = {*in_room, *chain.from_iterable(by_line.values())}
    order = sorted(found - {""}, key=lambda test: (not test.startswith(own), took_s[test], test))
    spent = accumulate(took_s[test] for test in order)
    return [test for test, s in zip(order, spent, strict=True) if s <= BUDGET_S] or order[:1]


def hunt(tree: Path, folder: Path, tests: Sequence[str], seed: int, count: int) -> Any:
    """Draw mutants, hunt each, and return a table with a row of each; it goes on where it ended.

    A test that fails without a mutant is set aside.
    """
    data, said = recorded(tree, folder, tests)
    took = pd.DataFrame(TOOK.findall(said), columns=["s", "test"]).astype({"s": float})
    took_s = Counter(took.groupby("test")["s"].sum().to_dict())
    aside = [f"--deselect={name}" for name in FAILED.findall(said)]
    package, path = tree / "src/yawid", folder / f"draw_{seed}.json"
    rows = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    for mutant in islice(drawn(package, seed), len(rows), count):
        source, some = (package / mutant.file).read_bytes(), reaching(mutant, package, data, took_s)
        new = mutant.seeded(source)
        code = seeded(tree, mutant.file, new, *GATE, *some, *aside)[0] if some else NO_TESTS
        rows.append({
            "group": mutant.group, "kind": mutant.kind, "tests": some,
            "where": f"{mutant.file}:{mutant.lines.start}",
            "old": source[mutant.start : mutant.stop].decode(), "new": mutant.new,
            "killed": code not in (0, NO_TESTS),
        })  # fmt: skip
        path.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return pd.DataFrame(rows)


def main() -> None:
    """Hunt mutants of the commit; print the killed shares, with their sigma, and the survivors."""
    parser = argparse.ArgumentParser(prog="mutate.py", description=__doc__.partition("\n")[0])
    parser.add_argument("--draw", metavar="N", type=int, required=True, help="how many mutants")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="which ones")
    parser.add_argument("--tests", nargs="+", metavar="FILE", default=[], help="only these")
    given = parser.parse_args()
    commit = subprocess.check_output(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, text=True
    ).strip()
    name = "-".join(["yawid-mutants", commit, *given.tests]).replace("/", "-")
    folder = Path(tempfile.gettempdir(), name).resolve()
    shutil.rmtree(folder / "tree", ignore_errors=True)  # a run that was killed leaves its mutant
    found = hunt(copied(folder / "tree"), folder, given.tests, given.seed, given.draw)
    of_all = pd.concat([found, found.assign(group="all")]).groupby("group", sort=False)["killed"]
    print(f"--draw {given.draw} --seed {given.seed} of {commit}")
    print(of_all.agg(mutants="size", killed="sum", share="mean", sigma="sem").round(2))
    print(found.loc[~found["killed"], ["where", "kind", "old", "new"]].to_string())


if __name__ == "__main__":
    main()
