"""Reading a telemetry log: MB/s and peak memory of yawid and of pymavlink.

Each reader runs in a process of its own, whose start and imports are not timed.
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from checks.children import LONG_S

from bench.frame import head, line, options_of

WANTED = (
    "ATTITUDE", "SERVO_OUTPUT_RAW", "RAW_IMU", "VFR_HUD", "RC_CHANNELS", "HEARTBEAT", "PARAM_VALUE",
)  # fmt: skip
"""What a replay reads of such a log."""
MIX, MB_AN_HOUR = "raised", 25.8
"""The messages of the logs (flights/long_log.py), of which 53 % are wanted; and an hour's size."""


def read_yawid(path: Path) -> None:
    """Decode the wanted messages of a log."""
    from yawid.sources.logs.tlog import read_tlog
    from yawid.sources.mavlink.decoder import Decoder

    decoder = Decoder(WANTED)
    for chunk in read_tlog(path):
        decoder.feed(chunk)
    decoder.finish()


def read_pymavlink(path: Path) -> None:
    """Decode them by pymavlink."""
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while log.recv_match(type=list(WANTED)) is not None:
        pass


READERS: dict[str, tuple[Callable[[Path], None], int]] = {
    "yawid": (read_yawid, 5),
    "pymavlink recv_match": (read_pymavlink, 1),
}
"""The readers, and how often each reads a log, of which the fastest counts."""


def measured(reader: str, path: Path) -> tuple[float, float]:
    """Return MB/s and the peak memory in MB of a reader, in this process."""
    read, times = READERS[reader]
    spent = []
    for _ in range(times):
        began = time.perf_counter()
        read(path)
        spent.append(time.perf_counter() - began)
    # ru_maxrss would have the memory of the parent before the start in it.
    peak = re.findall(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text(encoding="utf-8"))
    return path.stat().st_size / 1e6 / min(spent), int(peak[0]) / 1024


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    from flights.long_log import write_log  # its memory would count as that of the readers

    options = options_of("link", __doc__, arguments, megabytes=(20, 200))
    yield from head("", ("MB/s", "peak MB"))
    with tempfile.TemporaryDirectory() as folder:
        paths = {mb: Path(folder) / f"{mb}.tlog" for mb in options.megabytes}
        for mb, path in paths.items():
            write_log(path, mb / MB_AN_HOUR, MIX)
        for reader in READERS:
            found = []
            for path in paths.values():
                with ProcessPoolExecutor(1, get_context("spawn")) as own:
                    found.append(own.submit(measured, reader, path).result(LONG_S))
            columns = zip(*found, strict=True)
            yield line(reader, *(" / ".join(f"{x:.3g}" for x in column) for column in columns))
