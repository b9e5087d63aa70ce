"""Reading a telemetry log: MB/s and peak memory of several readers, and reading a damaged log.

Each reader runs in a process of its own, whose start and imports are not timed. The damaged log is
read by yawid alone, and compared with the truth record by record.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from flights.surgery import CLASSES, STAMP_SIZE, split
from numpy.typing import NDArray

from bench.table import head, line, options_of

TOOLS = Path(__file__).resolve().parents[1]
WANTED = (
    "ATTITUDE", "SERVO_OUTPUT_RAW", "RAW_IMU", "VFR_HUD", "RC_CHANNELS",
    "HEARTBEAT", "PARAM_VALUE",
)  # fmt: skip
"""What a replay reads of such a log."""
MIX, MB_AN_HOUR = "raised", 25.8
"""The messages of the logs (flights/long_log.py), of which 53 % are wanted; and an hour's size."""
FLIP_RATE, GARBAGE_BLOCKS, LONGEST_GARBAGE = 1e-4, 60, 3000
Result = dict[str, float]


def damage(source: Path, target: Path) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Write a damaged copy; return where its intact records begin, and where all records begin."""
    rng = np.random.default_rng(2)
    data = np.fromfile(source, np.uint8)
    starts = np.cumsum([0, *(STAMP_SIZE + len(frame) for _, frame in split(data.tobytes()))])[:-1]
    ends = np.append(starts[1:], len(data))
    hit = np.flatnonzero(rng.random(len(data)) < FLIP_RATE)
    data[hit] ^= rng.integers(1, 256, len(hit), dtype=np.uint8)
    is_hit = np.zeros(len(starts), np.bool_)
    is_hit[np.searchsorted(starts, hit, side="right") - 1] = True
    places = np.sort(rng.integers(0, len(data), GARBAGE_BLOCKS))
    places[0] = 0
    blocks = [rng.bytes(int(n)) for n in rng.integers(1, LONGEST_GARBAGE, GARBAGE_BLOCKS)]
    moves = np.cumsum([0, *map(len, blocks)])
    before, inside = (np.searchsorted(places, at, side="right") for at in (starts, ends - 1))
    pieces = np.split(data, places)
    parts = [pieces[0].tobytes()]
    for block, piece in zip(blocks, pieces[1:], strict=True):
        parts += [block, piece.tobytes()]
    target.write_bytes(b"".join(parts))
    is_whole = ~is_hit & (before == inside)
    moved = np.asarray(starts + moves[before], np.int64)
    return moved[is_whole], moved


def read_yawid(path: Path) -> Iterator[int]:
    """Yield the number of wanted messages in each piece."""
    from yawid.sources.logs.tlog import read_tlog
    from yawid.sources.mavlink.decoder import Decoder

    decoder = Decoder(WANTED)
    for chunk in read_tlog(path):
        block = decoder.feed(chunk)
        yield 0 if block is None else sum(map(len, block.messages.values()))
    block = decoder.finish()
    yield 0 if block is None else sum(map(len, block.messages.values()))


def read_pymavlink(path: Path) -> Iterator[int]:
    """Yield 1 for each wanted message that pymavlink reads."""
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while log.recv_match(type=list(WANTED)) is not None:
        yield 1


def read_plain(path: Path) -> Iterator[int]:
    """Read all bytes without decoding them: the upper limit of speed."""
    with path.open("rb") as file:
        while file.read(1 << 21):
            yield 0


READERS: dict[str, Callable[[Path], Iterator[int]]] = {
    "yawid": read_yawid,
    "pymavlink recv_match": read_pymavlink,
    "plain read": read_plain,
}
_MODULES = {
    "yawid": "yawid.sources.logs.tlog",
    "pymavlink recv_match": "pymavlink.mavutil",
}


def measure(reader: str, path: Path, repeats: int) -> Result:
    """Return the least time of ``repeats`` readings in this process, and its peak memory."""
    if reader in _MODULES:
        importlib.import_module(_MODULES[reader])
    best, found = float("inf"), 0
    for _ in range(repeats):
        began = time.perf_counter()
        found = sum(READERS[reader](path))
        best = min(best, time.perf_counter() - began)
    return {"seconds": best, "found": found, "peak_mb": own_peak_mb()}


def own_peak_mb() -> float:
    """Return the peak memory of this process in MB.

    The kernel's VmHWM is preferred: ru_maxrss includes memory of the parent before the start.
    """
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def measured(reader: str, path: Path, repeats: int) -> Result | None:
    """Return what :func:`measure` gives in a new process; None if the reader failed."""
    command = [sys.executable, "-m", "bench.link", reader, str(path), str(repeats)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=TOOLS)
    if done.returncode:
        print(f"{reader} failed: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return None
    result: Result = json.loads(done.stdout)
    return result


def speeds(paths: list[Path], repeats: int) -> Iterator[str]:
    """Yield a row for each reader, with a figure for each log in each cell."""
    slow = "pymavlink recv_match"
    bases = [measured(slow, path, 1) for path in paths]
    for reader in READERS:
        found = bases if reader == slow else [measured(reader, path, repeats) for path in paths]
        rates, peaks, times = [], [], []
        for path, result, base in zip(paths, found, bases, strict=True):
            if result is not None:
                rates.append(f"{path.stat().st_size / 1e6 / result['seconds']:.3g}")
                peaks.append(f"{result['peak_mb']:.0f}")
                times.append(f"{base['seconds'] / result['seconds']:.2g}" if base else "-")
        if rates:
            yield line(reader, *map(" / ".join, (rates, peaks, times)))


def recovered(path: Path, truth: NDArray[np.int64], starts: NDArray[np.int64]) -> str:
    """Return the row of a damaged log: how many of its intact records are read.

    A record with a damaged stamp within 3 days of its neighbours cannot be recognised as damaged.
    """
    from yawid.sources.mavlink.decoder import Decoder

    decoder = Decoder(CLASSES)
    block, rest = decoder.feed(path.read_bytes()), decoder.finish()
    orders = [m.order for b in (block, rest) if b is not None for m in b.messages.values()]
    found = np.concatenate(orders)
    hits, known = int(np.isin(found, truth).sum()), int(np.isin(found, starts).sum())
    return line(
        f"yawid, {FLIP_RATE:g} of the bytes flipped, {GARBAGE_BLOCKS} blocks of garbage",
        f"{hits} of {len(truth)} intact records, {len(found) - known} invented, "
        f"{known - hits} with a damaged stamp", "", "",
    )  # fmt: skip


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    from flights.long_log import write_log  # its memory would count as that of the readers

    options = options_of("link", __doc__, arguments, megabytes=(20, 200), repeats=5)
    yield from head("", ("MB/s", "peak MB", "x pymavlink"))
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{megabytes}mb.tlog" for megabytes in options.megabytes]
        for path, megabytes in zip(paths, options.megabytes, strict=True):
            write_log(path, megabytes / MB_AN_HOUR, MIX)
        yield from speeds(paths, options.repeats)
        damaged = Path(folder) / "damaged.tlog"
        yield recovered(damaged, *damage(paths[0], damaged))


if __name__ == "__main__":
    # A reader may print something, but stdout must contain only the result.
    with contextlib.redirect_stdout(io.StringIO()):
        outcome = measure(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
    print(json.dumps(outcome))
