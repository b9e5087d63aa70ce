"""Sends a vehicle's flight at 50 times its speed, and watches the memory of the session."""

from __future__ import annotations

import json
import math
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from checks.children import LEAVE_S, resident_mb
from flights.long_log import write_log
from flights.send_tlog import Sent, send
from flights.surgery import Record, split

SPEED, HOUR_S = 50.0, 3600.0
WARM_S = 60.0


def flight(seconds: float) -> Iterator[Record]:
    """Yield what a vehicle sends in ``seconds`` of its time: an hour of telemetry again and again.

    Each time it has booted again. It is silent for 20 s every ten minutes, and for one second in
    every 97.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.tlog"
        write_log(path, min(seconds / HOUR_S, 1.0), "raised")
        records = split(path.read_bytes())
    first_us = records[0][0]
    for boot in range(math.ceil(seconds / HOUR_S)):
        for stamp_us, frame in records:
            second, _ = divmod(stamp_us - first_us, 1_000_000)
            if second % 600 < 580 and second % 97 != 96:
                yield stamp_us + round(1e6 * HOUR_S) * boot, frame


def soak(process: subprocess.Popen[str], port: int, seconds: float) -> str:
    """Send the flight, watch the process's memory, end it, and return the result in words."""
    sent: list[Sent] = []
    assert process.stderr is not None
    reader = threading.Thread(target=process.stderr.read, daemon=True)
    reader.start()
    records = flight(SPEED * seconds)
    to = ("127.0.0.1", port)
    vehicle = threading.Thread(target=lambda: sent.append(send(records, to, SPEED)), daemon=True)
    start_s = time.monotonic()
    vehicle.start()
    memory = []
    while vehicle.is_alive():
        vehicle.join(10.0)
        memory.append((time.monotonic() - start_s, resident_mb(process.pid)))
    process.terminate()
    assert process.stdout is not None
    summary = json.loads(process.stdout.read())
    reader.join(LEAVE_S)
    warm = [mb for at_s, mb in memory if at_s >= WARM_S] or [memory[-1][1]]
    dropped, link = sum(summary["live"]["dropped"].values()), summary["link"]
    return (
        f"{memory[-1][0]:.0f} s at {SPEED:g}x, {sent[0].sent} frames, {dropped} dropped, "
        f"{link['reboots']} reboots, {link['gaps']} gaps; memory {memory[0][1]:.0f} MB at first, "
        f"{memory[-1][1]:.0f} at the end, grown by {max(warm) - warm[0]:.1f} after a minute"
    )
