"""List where the words of checks/words.toml are still written.

    python -m checks.words    # from tools/

It reads the comments and strings of src and tools, the TOML files of src, the manual and the
READMEs. It leaves out names: a string without a space, ``text in backquotes``, ``{a field}``. Each
line of the output gives a place, the word there and what to write instead. The exit code is 1 where
a word is left.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

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


_WORDS = [
    # A comment's next line begins with a number sign.
    (re.compile(w["pattern"].replace(" ", r"(?:\s+(?:# )?)"), re.IGNORECASE), w["better"])
    for w in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))["word"]
]
"""The words of words.toml as patterns, each with what to write instead."""


def left(path: Path) -> Iterator[str]:
    """Yield the words that are left in a file: the place, the word, and a better one."""
    text = path.read_text(encoding="utf-8")
    words = [word for word in _WORDS if word[0].search(text)]
    for part in _PARTS[path.suffix].finditer(text) if words else ():
        prose = _NAMES.sub(lambda name: "`" * len(name[0]), part[0])
        for pattern, better in words if " " in prose else ():
            for match in pattern.finditer(prose):
                line = text.count("\n", 0, part.start() + match.start()) + 1
                yield f"{path.relative_to(ROOT)}:{line}: {match[0]!r}: write {better}"


def main() -> bool:
    """Print what is left in all files; return whether something is."""
    findings = {found for pattern in READ for path in ROOT.glob(pattern) for found in left(path)}
    print(*sorted(findings), f"{len(findings)} words left", sep="\n")
    return bool(findings)


if __name__ == "__main__":
    sys.exit(main())
