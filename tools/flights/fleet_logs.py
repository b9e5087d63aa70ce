"""Makes the logs of a fleet: many small, different flights, one in a hundred damaged.

    python -m flights.fleet_logs DIR [--count 2000] [--minutes 1,4] [--damaged 0.01] [--seed 1]

The logs are DIR/plane_NN/NNNN.tlog, flown over a year; each plane has its own Dutch roll.
DIR/truth.json has, for each damaged log, its damage, the allowed outcomes, and a reason that must
be among those given. The same options give the same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.signal import cont2discrete

from flights.long_log import RATE_HZ, START_US, Plant, write_log
from flights.surgery import Record, after, join, littered, message_id, split, without, wrong_crc

HEARTBEAT, ATTITUDE, SERVO_OUTPUT_RAW, RC_CHANNELS = 0, 30, 36, 65
RUDDER: Final = (SERVO_OUTPUT_RAW, RC_CHANNELS)
PLANES: Final = 20
YEAR_US: Final = 365 * 86_400 * 10**6
ANY: Final = ("ok", "unusable", "unreadable")
REFUSED: Final = ("unusable", "unreadable")
Damage = Callable[[bytes, int], bytes]


def plant_of(plane: int) -> Plant:
    """Return an aircraft's discrete model; its wn is 2 to 5 rad/s, its zeta 0.1 to 0.4."""
    rng = np.random.default_rng((7, plane))
    wn, zeta = rng.uniform(2.0, 5.0), rng.uniform(0.1, 0.4)
    gain, lead_s = rng.uniform(0.3, 0.8), rng.uniform(0.5, 2.0)
    continuous = ([gain * wn**2 * lead_s, gain * wn**2], [1.0, 2.0 * zeta * wn, wn**2])
    b, a, _ = cont2discrete(continuous, 1.0 / RATE_HZ)
    return b[0].tolist(), a.tolist()


def _records(change: Callable[[Sequence[Record]], Sequence[Record]]) -> Damage:
    return lambda log, _: join(change(split(log)))


def _only(keeps: Callable[[int], bool]) -> Damage:
    return _records(lambda records: [r for r in records if keeps(message_id(r[1]))])


def _still(log: bytes, _: int) -> bytes:
    """Return a log whose rudder never moves: all servo messages are its first one."""
    records = split(log)
    still = next(frame for _, frame in records if message_id(frame) == SERVO_OUTPUT_RAW)
    return join((s, still if message_id(f) == SERVO_OUTPUT_RAW else f) for s, f in records)


def _noise(log: bytes, seed: int) -> bytes:
    return np.random.default_rng(seed).bytes(len(log))


def _hole(log: bytes, _: int) -> bytes:
    at = len(log) // 2
    return log[:at] + bytes(4096) + log[at + 4096 :]


def _sparse(log: bytes, n: int = 10) -> bytes:
    """Return a log with one in ``n`` of its ATTITUDE messages."""
    records = split(log)
    attitudes = [r for r in records if message_id(r[1]) == ATTITUDE]
    lost = {id(r) for i, r in enumerate(attitudes, 1) if i % n}
    return join(r for r in records if id(r) not in lost)


DAMAGES: Final[dict[str, tuple[Damage, tuple[str, ...], str | None]]] = {
    "empty": (lambda log, _: b"", ("unreadable",), "unreadable"),
    "text": (lambda log, _: b"no log at all\n" * 500, ("unreadable",), "unreadable"),
    "noise": (_noise, REFUSED, None),
    "compressed": (lambda log, _: gzip.compress(log, 1, mtime=0), REFUSED, None),
    "picture": (lambda log, _: b"\x89PNG\r\n\x1a\n" + log[:50_000][::-1], REFUSED, None),
    "cut to a third": (lambda log, _: log[: len(log) // 3], ANY, None),
    "torn end": (lambda log, _: log[:-7], ("ok",), None),
    "torn start": (lambda log, _: log[11:], ("ok", "unusable"), None),
    "hole of zeros": (_hole, ("ok", "unusable"), None),
    "littered": (lambda log, seed: littered(split(log), seed), ("ok", "unusable"), None),
    "every CRC wrong": (_records(lambda r: [(s, wrong_crc(f)) for s, f in r]), REFUSED, None),
    "no HEARTBEAT": (_only(lambda m: m != HEARTBEAT), ("unusable",), "no_vehicle"),
    "no rudder": (_only(lambda m: m not in RUDDER), ("unusable",), "no_rudder"),
    "no ATTITUDE": (_only(lambda m: m != ATTITUDE), ("unusable",), None),
    "2 Hz": (lambda log, _: _sparse(log), ("unusable",), "rate_too_low"),
    "rudder at rest": (_still, ("unusable",), "not_excited"),
    "a gap": (_records(lambda r: without(r, 20.0, 35.0)), ANY[:2], None),
    "all twice": (_records(lambda r: [each for each in r for _ in range(2)]), ANY[:2], None),
    "a reboot": (_records(lambda r: after(r, r, 5.0)), ("ok",), None),
    "no stamps": (_records(lambda r: [(0, f) for _, f in r]), ANY, None),
    "the head alone": (lambda log, _: log[:300], REFUSED, None),
}  # fmt: skip
"""The kinds of damage by name: the function that damages a good log, the allowed outcomes, and the
reason that must be given, if one must."""


def make(folder: Path, count: int, minutes: tuple[float, float], damaged: float, seed: int) -> int:
    """Write ``count`` logs and truth.json; return how many logs are damaged."""
    rng = np.random.default_rng(seed)
    is_damaged = set(rng.choice(count, round(damaged * count), replace=False).tolist())
    ways = list(DAMAGES)
    truth: dict[str, dict[str, Any]] = {}
    for i in range(count):
        plane = int(rng.integers(PLANES))
        path = folder / f"plane_{plane:02d}" / f"{i:04d}.tlog"
        path.parent.mkdir(parents=True, exist_ok=True)
        every_s = float(rng.uniform(60.0, 180.0))
        hours = float(rng.uniform(*minutes)) / 60.0
        start_us = START_US + int(rng.integers(YEAR_US))
        write_log(
            path, hours, "raised", (seed, i), 8.0, every_s, plant=plant_of(plane), start_us=start_us
        )
        if i in is_damaged:
            way = ways[len(truth) % len(ways)]
            damage, outcomes, reason = DAMAGES[way]
            path.write_bytes(damage(path.read_bytes(), i))
            name = path.relative_to(folder).as_posix()
            truth[name] = {"damage": way, "outcomes": outcomes, "reason": reason}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return len(truth)


def main(argv: Sequence[str]) -> int:
    """Make the logs; return 0."""
    parser = argparse.ArgumentParser(prog="fleet_logs.py", description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--minutes", type=_pair, default=(1.0, 4.0), metavar="LEAST,MOST")
    parser.add_argument("--damaged", type=float, default=0.01, metavar="SHARE")
    parser.add_argument("--seed", type=int, default=1)
    asked: Any = parser.parse_args(argv)
    damaged = make(asked.folder, asked.count, asked.minutes, asked.damaged, asked.seed)
    print(f"{asked.folder}: {asked.count} logs, {damaged} damaged")
    return 0


def _pair(text: str) -> tuple[float, float]:
    low, high = map(float, text.split(","))
    return low, high


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
