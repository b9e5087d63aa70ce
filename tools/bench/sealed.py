"""Runs on the sealed aircraft: which commit and seed they have, and the file of their figures.

A run belongs to a commit, whose hash gives its seed: one run of each bench for a commit, with all
changes committed. Its figures are a row of flights/sealed.csv, which is never edited by hand.
"""

from __future__ import annotations

import csv
import datetime
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILE = Path("tools", "flights", "sealed.csv")
COLUMNS = ("date", "commit", "bench", "seed", "figures")
SEEDS = 10**6


@dataclass(frozen=True, slots=True)
class SealedRun:
    """A run of a bench on the sealed aircraft."""

    bench: str
    commit: str

    @property
    def seed(self) -> int:
        """The seed that the commit's hash gives."""
        return int(self.commit[:8], 16) % SEEDS

    def note(self, figures: Mapping[str, str]) -> None:
        """Append the run's figures, by name, to the file."""
        path, today = ROOT / FILE, datetime.datetime.now(tz=datetime.UTC).date()
        known = "; ".join(f"{name} {value}" for name, value in figures.items())
        new = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerows([COLUMNS] * new)
            rows.writerow([today, self.commit, self.bench, self.seed, known])


def begin(bench: str) -> SealedRun:
    """Return the run of this commit.

    Raises:
        SystemExit: a change is not committed, or the commit has had its run.
    """
    if changed := _git("status", "--porcelain", "--", ".", f":!{FILE.as_posix()}"):
        raise SystemExit(f"a sealed run needs a commit, and this is not committed:\n{changed}")
    commit = _git("rev-parse", "HEAD").strip()
    if any((row["bench"], row["commit"]) == (bench, commit) for row in rows()):
        raise SystemExit(
            f"{FILE} has the run of {bench} for {commit[:12]}: it has one for a commit"
        )
    return SealedRun(bench, commit)


def rows() -> Iterator[dict[str, str]]:
    """Yield the rows of the file."""
    if (ROOT / FILE).exists():
        with (ROOT / FILE).open(newline="", encoding="utf-8") as file:
            yield from csv.DictReader(file)


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, check=True, encoding="utf-8"
    ).stdout
