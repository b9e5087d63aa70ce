"""Two hundred short logs, some of which kill, stop or hang their process; others are hurt, too."""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from fleet_cluster import environment, tables, yawid_fleet
from places import REPLAY_LOGS

COUNT, TIMEOUT_S, BETWEEN_S, MOST_S = 200, 5.0, 15.0, 600.0
BAD = {"killer": ("crashed", 3), "stops": ("timeout", 2), "hangs": ("timeout", 2)}
"""The outcome of each kind of bad log, and how many there are of it."""
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform == "win32", reason="no such signals there"),
]


def make_logs(folder: Path) -> None:
    """Cut short logs from those of the project; no two are alike."""
    folder.mkdir()
    whole = [path.read_bytes() for path in sorted(REPLAY_LOGS.glob("*/log.tlog"))]
    names = [f"{kind}{i}" for kind, (_, n) in BAD.items() for i in range(n)]
    names += [f"log{i:03d}" for i in range(COUNT - len(names))]
    for i, name in enumerate(names):
        data = whole[i % len(whole)]
        (folder / f"{name}.tlog").write_bytes(data[: 30_000 + 1_000 * (i // len(whole))])


def replaying(fleet: psutil.Process) -> Iterator[psutil.Process]:
    for each in fleet.children(recursive=True):
        try:
            if "yawid.fleet.one_log" in each.cmdline():
                yield each
        except psutil.Error:
            continue


def test_each_log_has_one_outcome_whatever_happens_to_the_processes(tmp_path: Path) -> None:
    logs, out, drawn = tmp_path / "logs", tmp_path / "data", random.Random(5)
    make_logs(logs)
    env = environment(tmp_path / "hook")
    words = (logs, "--workers", "2", "--timeout", f"{TIMEOUT_S:g}", "--out")
    hurt, below = Counter[int](), set[psutil.Process]()
    with yawid_fleet(env, *words, out, within_s=MOST_S) as run:
        fleet, next_s = psutil.Process(run.pid), time.monotonic() + 3.0
        while run.poll() is None:
            time.sleep(0.05)
            below |= (now := set(replaying(fleet)))
            if now and time.monotonic() > next_s:  # seldom, so that no log is hurt three times
                next_s = time.monotonic() + BETWEEN_S
                number = [signal.SIGKILL, signal.SIGSTOP][hurt.total() % 2]
                os.kill(drawn.choice(sorted(each.pid for each in now)), number)
                hurt[number] += 1
        said = run.communicate(timeout=MOST_S)
    assert run.returncode == 0, said
    assert [each for each in below if each.is_running()] == []
    assert min(hurt[signal.SIGKILL], hurt[signal.SIGSTOP]) >= 1

    rows = tables(out)["logs"]
    assert sorted(str(row["path"]) for row in rows) == sorted(map(str, logs.iterdir()))
    outcomes = {Path(str(row["path"])).stem: row["outcome"] for row in rows}
    for kind, (outcome, count) in BAD.items():
        assert [outcomes.pop(f"{kind}{i}") for i in range(count)] == [outcome] * count
    assert Counter(outcomes.values())["timeout"] <= hurt[signal.SIGSTOP]
    known = {f"{kind}{i}" for kind, (_, n) in BAD.items() for i in range(n)}
    crashed = [row for row in rows if row["outcome"] == "crashed"]
    assert [row["text"] for row in crashed if Path(str(row["path"])).stem not in known] == []

    for path in logs.iterdir():
        if path.stem not in outcomes:
            path.unlink()
    with yawid_fleet(
        env, *words, out, "--retry", within_s=MOST_S
    ) as run:  # what was stopped, by its own merits
        said = run.communicate(timeout=MOST_S)
    assert run.returncode == 0, said
    with yawid_fleet(env, *words, tmp_path / "quiet", within_s=MOST_S) as run:
        said = run.communicate(timeout=MOST_S)
    assert run.returncode == 0, said
    again, quiet = (
        {row["path"]: row["outcome"] for row in tables(each)["logs"]}
        for each in (out, tmp_path / "quiet")
    )
    assert {path: again[path] for path in quiet} == quiet
    assert set(quiet.values()) <= {"ok", "unusable"}
