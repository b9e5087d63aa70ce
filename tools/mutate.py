"""Seeds small defects one at a time in a copy of the tree, and checks that a test notices each.

    python tools/mutate.py --draw 300 --seed 7   # drawn at random: a table of killed shares

First one run of the gate's tests records under the library coverage which file of tests reaches
which lines. Then each mutant (checks/mutants.py) runs the files that reach it: those of its own
room first, then the cheapest, up to ``BUDGET_S``. A folder in the temporary folder keeps the record
and a row of each mutant as it ends (draw_SEED.jsonl). The same command goes on where it was
stopped; a record that was not complete begins again.

tests/test_mutations.py, marked ``long``, seeds those of checks/defects.toml. Each names one test
that must fail: if that ends in any other way, it has not caught the defect. For a defect in the
kernel, or in the code that compiles it, the kernel runs as plain Python, which gives the same bits
and need not be compiled for each defect. For all others it is compiled once, as fits in plain
Python take minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import accumulate, chain, islice
from pathlib import Path

import pandas as pd
from checks.children import LONG_S, child
from checks.mutants import Mutant, drawn
from coverage import Coverage, CoverageData

ROOT = Path(__file__).resolve().parents[1]
KERNEL = "estimation/kernel/"
PLAIN = (KERNEL, "estimation/machine/")
RUNNER = "estimation/machine/runner.py"
"""The kernel is compiled, so that no line of it is seen: whatever runs RUNNER reaches it."""
TIMEOUT_S = 300.0
"""Time limit in s of the tests of one defect: a mutant's that take longer have noticed it."""
BUDGET_S = 40.0
"""Seconds, as recorded, that the tests of one mutant may take: a survivor costs that. Without it
one line that all tests reach costs ten minutes."""
GATE = ("-m", "not slow and not long")
NO_TESTS = 5
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
TOOK = re.compile(r"^([\d.]+)s \w+ +([^:\s]+)", re.MULTILINE)
"""A line of pytest's durations: seconds, and the file of a test."""
DEFECTS: list[dict[str, str]] = tomllib.loads(
    (ROOT / "tools/checks/defects.toml").read_text(encoding="utf-8")
)["defect"]


def copied(folder: Path) -> Path:
    """Copy the tree, in which one file of the sources at a time will be another."""
    return shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__"))


def run(
    tree: Path,
    *tests: str,
    plain: bool = False,
    within_s: float = TIMEOUT_S,
    under: Sequence[str] = (),
) -> tuple[int, str]:
    """Run tests in a copy; return pytest's exit code (1: some failed) and what it printed.

    With ``plain``, the kernel runs as plain Python. After ``within_s``, the tests and their
    children are ended, and the code is another one. Of Hypothesis the first counterexample
    suffices: reducing it would take minutes.
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
        if (count := (ROOT / "src/yawid" / each["file"]).read_text("utf-8").count(each["old"])) != 1
    ]


def pytest_runtest_logstart(nodeid: str) -> None:
    """Name the file whose test begins, as a plugin of pytest: the lines that follow are its own.

    So it shares no run with other files (tests/support/finished_runs.py).
    """
    os.environ.pop("YAWID_TEST_RUNS", None)
    if cover := Coverage.current():
        cover.switch_context(nodeid.partition("::")[0])


def recorded(tree: Path, folder: Path, tests: Sequence[str]) -> tuple[CoverageData, str]:
    """Run the tests once; return which of their files reach which lines, and what pytest printed.

    What runs in a child process is not seen.
    """
    kept, data = folder / "recorded.txt", CoverageData(str(folder / "coverage"))
    if not kept.exists():
        under = ("-m", "coverage", "run", f"--data-file={folder}/coverage", "--source=yawid")
        options = (*GATE, "-p", "mutate", "--maxfail=1000", "--durations=0", "--durations-min=0")
        code, said = run(tree, *options, *tests, within_s=LONG_S, under=under)
        if code not in (0, 1):
            raise SystemExit(said)
        kept.write_text(said, encoding="utf-8")
    data.read()
    return data, kept.read_text(encoding="utf-8")


def reaching(
    mutant: Mutant, package: Path, data: CoverageData, took_s: Mapping[str, float]
) -> list[str]:
    """Return the files of tests that reach a mutant, in the order in which they are tried.

    A line that no test is seen to reach, as it runs on import, in a child process or never, may be
    reached by every file that runs something of its module, and by those of its room.
    """
    is_kernel = mutant.file.startswith(KERNEL)
    by_line = data.contexts_by_lineno(str(package / (RUNNER if is_kernel else mutant.file)))
    own = tuple(
        f"{top}/{room}/" for top in ("tests", "src/yawid") for room in mutant.group.split(", ")
    )
    found = {test for line in mutant.lines for test in by_line.get(line, ())}
    if is_kernel or found <= {""}:
        in_room = (test for test in data.measured_contexts() if test.startswith(own))
        found = {*in_room, *chain.from_iterable(by_line.values())}
    order = sorted(found - {""}, key=lambda test: (not test.startswith(own), took_s[test], test))
    spent = accumulate(took_s[test] for test in order)
    return [test for test, s in zip(order, spent, strict=True) if s <= BUDGET_S] or order[:1]


def hunt(tree: Path, folder: Path, tests: Sequence[str], seed: int, count: int) -> list[str]:
    """Draw mutants, hunt each, and return a row of each as JSON; it goes on where it ended.

    A test that fails without a mutant is set aside.
    """
    data, said = recorded(tree, folder, tests)
    took = pd.DataFrame(TOOK.findall(said), columns=["s", "test"]).astype({"s": float})
    took_s = Counter(took.groupby("test")["s"].sum().to_dict())
    aside = [f"--deselect={name}" for name in FAILED.findall(said)]
    package, path = tree / "src/yawid", folder / f"draw_{seed}.jsonl"
    rows = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for mutant in islice(drawn(package, seed), len(rows), count):
        source = (package / mutant.file).read_bytes()
        some, new = reaching(mutant, package, data, took_s), mutant.seeded(source)
        code = seeded(tree, mutant.file, new, *GATE, *some, *aside)[0] if some else NO_TESTS
        row = {
            "group": mutant.group, "kind": mutant.kind, "tests": some,
            "where": f"{mutant.file}:{mutant.lines.start}",
            "old": source[mutant.where].decode(), "new": mutant.new,
            "killed": code not in (0, NO_TESTS),
        }  # fmt: skip
        rows.append(json.dumps(row))
        path.write_text("\n".join(rows), encoding="utf-8")
    return rows


def main() -> None:
    """Hunt mutants of the commit; print the killed shares, with their sigma, and the survivors."""
    parser = argparse.ArgumentParser(prog="mutate.py", description=__doc__.partition("\n")[0])
    parser.add_argument("--draw", metavar="N", type=int, required=True, help="how many mutants")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="which ones")
    parser.add_argument("--tests", nargs="+", metavar="FILE", default=[], help="only these")
    given = parser.parse_args()
    asked = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.check_output(asked, cwd=ROOT, text=True).strip()
    name = re.sub(r"\W+", "-", " ".join(["yawid-mutants", commit, *given.tests]))
    folder = Path(tempfile.gettempdir()).resolve() / name
    shutil.rmtree(folder / "tree", ignore_errors=True)  # a run that was killed leaves its mutant
    rows = hunt(copied(folder / "tree"), folder, given.tests, given.seed, given.draw)
    found = pd.DataFrame(map(json.loads, rows))
    of_all = pd.concat([found, found.assign(group="all")]).groupby("group", sort=False)["killed"]
    shares = of_all.agg(mutants="size", killed="sum", share="mean", sigma="sem").round(2)
    left = found.loc[~found["killed"], ["where", "kind", "old", "new"]]
    print(
        f"--draw {given.draw} --seed {given.seed} of {commit}", shares, left.to_string(), sep="\n\n"
    )


if __name__ == "__main__":
    main()
