"""Replays logs with another commit and with this tree, and says what differs.

    python -m checks.compare COMMIT [--logs FOLDER ...]

The logs (tlog, dataflash or ULog) are those of a folder, also in folders below it, such as those of
``bench.py truth --logs DIR``; by default those of the cases. Each is replayed with the default
options, a case also with its own, by the command line of each tree; what is compared, in any bit,
is what is printed as JSON, the exit code, and each topic of the MCAP, message by message. At the
end stands how many of all differ, and in how many each key does. The exit code is 1 if anything
differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

ROOT = Path(__file__).resolve().parents[2]


def answers(tree: Path, log: Path) -> dict[str, Any]:
    """Return what a tree's yawid makes of a log: its JSON by keys, digests of topics by name.

    Keys begin with ``options`` or ``flight``, the table of case.toml with the options; without a
    case.toml next to the log, all are of ``flight`` and the options are the default ones. The keys
    ``log`` and ``files`` have paths, and are left out. If nothing was printed, ``error`` is what
    was said on stderr.
    """
    case, found = log.parent / "case.toml", dict[str, Any]()
    toml = tomllib.loads(case.read_text(encoding="utf-8")) if case.exists() else {}
    for table in ("options", "flight") if toml else ("flight",):
        given = [f"--{key.replace('_', '-')}={x}" for key, x in toml.get(table, {}).items()]
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [sys.executable, "-m", "yawid", "replay", log.resolve(), "--json", *given],
                env=os.environ | {"PYTHONPATH": str(tree / "src")}, cwd=folder,
                capture_output=True, check=False, encoding="utf-8", timeout=600,
            )  # fmt: skip
            said = json.loads(done.stdout or "null") or {"error": done.stderr}
            topics: dict[str, Any] = defaultdict(hashlib.sha256)
            for path in Path(folder).glob("**/*.mcap"):
                with path.open("rb") as file:
                    for _, channel, sent in make_reader(file).iter_messages():
                        topics[channel.topic].update(
                            sent.log_time.to_bytes(8, "little") + sent.data
                        )
        found[table] = {name: x for name, x in said.items() if name not in ("log", "files")}
        found[table] |= {name: of.hexdigest() for name, of in topics.items()}
        found[table]["exit_code"] = done.returncode
    return found


def differences(old: Any, new: Any, *, where: str = "") -> Iterator[tuple[str, str]]:
    """Yield the name of what differs, followed down to the last key of JSON, and both values."""
    one, other = (dict(enumerate(x)) if isinstance(x, list) else x for x in (old, new))
    if isinstance(one, dict) and isinstance(other, dict):
        for name in dict.fromkeys([*one, *other]):
            below = f"{where}.{name}".strip(".")
            yield from differences(one.get(name), other.get(name), where=below)
    elif repr(one) != repr(other):
        yield where, f"{repr(old)[:80]}, {repr(new)[:80]}"


def main(arguments: Sequence[str]) -> int:
    """Print what differs, log by log; return 1 if anything does."""
    parser = argparse.ArgumentParser(prog="checks.compare", description=__doc__)
    parser.add_argument("commit")
    parser.add_argument("--logs", nargs="+", type=Path, default=[ROOT / "replay_logs"])
    options = parser.parse_args(arguments)
    logs = sorted(path for folder in options.logs for path in folder.rglob("*")
                  if path.suffix.lower() in (".tlog", ".bin", ".ulg"))  # fmt: skip
    keys, count = Counter[str](), 0
    with tempfile.TemporaryDirectory() as tree:
        asked = ["git", "archive", options.commit, "src"]
        packed = subprocess.run(asked, cwd=ROOT, capture_output=True, check=True)
        subprocess.run(["tar", "-x"], cwd=tree, input=packed.stdout, check=True)
        for log in logs:
            differ = dict(differences(answers(Path(tree), log), answers(ROOT, log)))
            print(f"{log.parent.name}/{log.name}:", "" if differ else "same", flush=True)
            print(*(f"    {name}: {both}\n" for name, both in differ.items()), sep="", end="")
            keys.update(differ.keys())
            count += bool(differ)
    print(f"{count} of {len(logs)} logs differ")
    print(*(f"    {name}: {times}\n" for name, times in keys.most_common()), sep="", end="")
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
