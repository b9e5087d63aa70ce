"""Seeds small defects one at a time in a copy of the tree, and checks that a test notices each.

    python tools/mutate.py --draw 300 --seed 7   # drawn at random: a table of killed shares

tests/test_mutations.py, marked ``long``, seeds those of checks/defects.toml. Each names one test
that must fail: if that ends in any other way, it has not caught the defect. For a defect in the
kernel, or in the code that compiles it, the kernel runs as plain Python, which gives the same bits
and need not be compiled for each defect. For all others it is compiled once, as fits in plain
Python take minutes.

What --draw makes stays in a folder of the temporary folder: which file of tests reaches which lines
(half an hour of one processor), one row a mutant as it ends (draw_SEED.jsonl) and the survivors
(survivors_SEED.txt). The same command goes on where it was stopped. See
tools/checks/mutants.py.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from checks.children import child

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "yawid"
COPIED = ("src", "tests", "tools", "replay_logs")
KERNEL = "estimation/kernel/"
PLAIN = (KERNEL, "estimation/machine/")
TIMEOUT_S = 300
"""Time limit in s of one test."""
# The first counterexample suffices: reducing it would take minutes.
CONFTEST = """
from hypothesis import Phase, settings

phases = (Phase.explicit, Phase.generate)
settings.register_profile(
    "mutation", phases=phases, derandomize=True, database=None, deadline=None
)
settings.load_profile("mutation")
"""


@dataclass(frozen=True, slots=True)
class Defect:
    """A defect: ``old`` in ``file`` (below src/yawid) becomes ``new``; then ``test`` must fail."""

    what: str
    file: str
    old: str
    new: str
    test: str

    @property
    def plain(self) -> bool:
        """Whether the kernel runs as plain Python for its test."""
        return self.file.startswith(PLAIN)


DEFECTS: tuple[Defect, ...] = tuple(
    Defect(**each)
    for each in tomllib.loads((ROOT / "tools/checks/defects.toml").read_text(encoding="utf-8"))[
        "defect"
    ]
)


class Copy:
    """A copy of the tree, in which one file of the sources at a time is another."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.package = folder / "src" / "yawid"
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "actual.*")
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, ignore=ignored)
        for name in ("pyproject.toml", "README.md"):
            shutil.copy2(ROOT / name, folder)
        (folder / "conftest.py").write_text(CONFTEST, encoding="utf-8")

    def run(
        self,
        *tests: str,
        plain: bool = False,
        under: Sequence[str] = ("-m", "pytest"),
        limit_s: float | None = None,
        **own: str,
    ) -> tuple[int, str]:
        """Run tests in the copy; return pytest's exit code (1: some failed) and what it printed.

        With ``plain``, the kernel runs as plain Python. ``own`` are variables of the environment.
        The code is -1 if they take longer than ``limit_s``, by default TIMEOUT_S each.
        """
        paths = os.pathsep.join([str(self.folder / "src"), str(self.folder / "tools")])
        own |= {"PYTHONPATH": paths, "MPLBACKEND": "Agg", "NUMBA_DISABLE_JIT": str(int(plain))}
        limit_s = limit_s or TIMEOUT_S * len(tests)
        with child(
            [sys.executable, *under, "-x", "-q", "-p", "no:cacheprovider", *tests], limit_s,
            cwd=self.folder, env=os.environ | own, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        ) as process:  # fmt: skip
            try:
                output, _ = process.communicate(timeout=limit_s)
            except subprocess.TimeoutExpired:
                return -1, ""
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)  # and what its tests did not end
            return process.returncode, output

    @contextmanager
    def seeded(self, file: str, text: str) -> Iterator[None]:
        """Put another text in the place of a source file's, for a while."""
        path = self.package / file
        kept = path.with_suffix(".kept")
        shutil.copy2(path, kept)
        try:
            path.write_text(text, encoding="utf-8")
            yield
        finally:
            shutil.move(kept, path)  # keeps the old time, by which Python recognises its caches

    def catches(self, defect: Defect) -> bool:
        """Return whether the defect's test fails with the defect seeded."""
        text = (self.package / defect.file).read_text(encoding="utf-8")
        with self.seeded(defect.file, text.replace(defect.old, defect.new)):
            return self.run(defect.test, plain=defect.plain)[0] == 1


def misplaced(defects: Sequence[Defect]) -> list[str]:
    """Return in words the defects whose pattern is not exactly once in its file."""
    return [
        f"{each.what}: {count} times in {each.file}: {each.old!r}"
        for each in defects
        if (count := (PACKAGE / each.file).read_text(encoding="utf-8").count(each.old)) != 1
    ]


def draw(count: int, seed: int, tests: Sequence[str]) -> None:
    """Hunt ``count`` mutants of the commit, and print the table."""
    from checks import mutants  # the library coverage is not needed for a single defect

    asked = ["git", "log", "-1", "--format=%h of %cs", "--", "src", "tests"]
    said = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    folder = Path(tempfile.gettempdir()) / f"yawid-mutants-{said.split()[0]}"
    shutil.rmtree(folder / "tree", ignore_errors=True)  # a run that was killed leaves its mutant
    print(f"mutate: {folder}", file=sys.stderr, flush=True)
    found = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("tests/**/test_*.py"))
    copy = Copy(folder / "tree")
    rows = mutants.hunt(copy, folder, tests or [*found, "src"], seed=seed, count=count)
    left = [f"{row['where']} {row['kind']}: {row['old']} -> {row['new']}, {len(row['tests'])} files"
            for row in rows if not row["killer"]]  # fmt: skip
    (folder / f"survivors_{seed}.txt").write_text("\n".join(sorted(left)), encoding="utf-8")
    print(mutants.table(rows, f"`--draw {count} --seed {seed}`, {said.strip()}"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="mutate.py", description=__doc__.partition("\n")[0])
    parser.add_argument("--draw", metavar="N", type=int, required=True, help="how many mutants")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="which ones")
    parser.add_argument("--tests", nargs="+", metavar="FILE", default=(), help="only these")
    options = parser.parse_args()
    draw(options.draw, options.seed, options.tests)
