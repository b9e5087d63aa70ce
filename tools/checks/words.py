"""List where the words of checks/words.toml are still written.

    python -m checks.words [PATH ...]    # from tools/; PATH below the root: src/yawid/fleet

It reads the comments and strings of src and tools, the TOML files of src, the manual and the
READMEs. It leaves out names: a string without a space, ``text in backquotes``, ``{a field}``. Each
line of the output gives a place, the word there and what to write instead. The exit code is 1 where
a word is left, or where words.toml allows a place that no longer exists.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
READ = (
    "src/**/*.py",
    "src/**/*.toml",
    "src/yawid/manual/*.md",
    "tools/**/*.py",
    "*.md",
    "*/README.md",
)
"""Which files are read, as patterns below the root."""
_PARTS = {
    ".md": re.compile(r"(?s:.+)"),
    ".toml": re.compile(r'"[^"\n]*"|#.*'),
    ".py": re.compile(
        r'(?s:"""(?:\\.|[^\\])*?""")|"(?:\\.|[^"\\\n])*"|'
        r"'(?:\\.|[^'\\\n])*'|#.*(?:\n *#.*)*"
    ),
}
"""What of a file is prose: strings, and comments with those that go on in the next line."""
_NAMES = re.compile(r"``[^`]*``|`[^`\n]*`|\{(?:[^{}\n]|\{[^{}\n]*\})*\}")
"""What of prose is code: between backquotes, or a field of an f-string, perhaps with another."""


class Word(NamedTuple):
    """A word or phrase that is not written."""

    pattern: re.Pattern[str]
    better: str
    """What to write instead."""


class Allowed(NamedTuple):
    """A place where such a word may stand."""

    path: str
    """The file, below the root."""
    text: str
    """The text in it that holds the word."""
    why: str


class Finding(NamedTuple):
    """A word that is left."""

    path: str
    line: int
    text: str
    better: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.text!r}: write {self.better}"


def rules() -> tuple[list[Word], list[Allowed]]:
    """Return the words of words.toml, and the places that may keep one."""
    found = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    words = [
        # A comment's next line begins with a number sign.
        Word(re.compile(w["pattern"].replace(" ", r"(?:\s+(?:# )?)"), re.IGNORECASE), w["better"])
        for w in found["word"]
    ]
    return words, [Allowed(**each) for each in found.get("allowed", [])]


def left(
    path: str, text: str, words: list[Word], allowed: list[Allowed]
) -> Iterator[Finding | Allowed]:
    """Yield the words that are left in a file's ``text``, and the allowed places that it has."""
    words = [word for word in words if word.pattern.search(text)]
    places = [place for place in allowed if place.path == path]
    for part in _PARTS[Path(path).suffix].finditer(text) if words else ():
        prose = _NAMES.sub(lambda name: "`" * len(name[0]), part[0])
        for word in words if " " in prose else ():
            for match in word.pattern.finditer(prose):
                start, end = match.span()
                keeping: list[Finding | Allowed] = [
                    place
                    for place in places
                    for kept in re.finditer(re.escape(place.text), prose)
                    if kept.start() <= start and end <= kept.end()
                ]
                line = text.count("\n", 0, part.start() + start) + 1
                yield from keeping or [Finding(path, line, " ".join(match[0].split()), word.better)]


def main(below: list[str]) -> int:
    """Print what is left in the files ``below``, by default in all of them."""
    words, allowed = rules()
    files = {path for pattern in READ for path in ROOT.glob(pattern)}
    found: list[Finding | Allowed] = []
    for file in sorted(files):
        path = file.relative_to(ROOT).as_posix()
        if not below or path.startswith(tuple(below)):
            found += left(path, file.read_text(encoding="utf-8"), words, allowed)
    findings = sorted({each for each in found if isinstance(each, Finding)})
    gone = [] if below else [place for place in allowed if place not in found]
    for finding in findings:
        print(finding)
    for place in gone:
        print(f"words.toml allows {place.text!r} in {place.path}, where it no longer is")
    print(f"{len(findings)} words left; allowed: {len(allowed) - len(gone)} places")
    return 1 if findings or gone else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
