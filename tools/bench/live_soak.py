"""A vehicle at many times its speed: silences, reboots, gaps; the memory is watched."""

from __future__ import annotations

import json
import math
import re
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from checks.children import LEAVE_S
from pymavlink.dialects.v20 import ardupilotmega as dialect

SPEED, HZ = 50.0, 50
A, B = (-1.85, 0.9), (0.02, 0.01)
NOISE = 0.002
WARM_S = 60.0
_PARAMETERS = {"SERVO4_FUNCTION": 21, "SERVO4_MIN": 1100, "SERVO4_TRIM": 1500, "SERVO4_MAX": 1900}


def flight(rng: np.random.Generator) -> Iterator[list[bytes]]:
    """Yield what the vehicle sends in each fiftieth of a second, without end.

    Every ten minutes of its time it is silent for 20 s, every hour it reboots, and now and then a
    second of frames is missing.
    """
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)

    def packed(message: Any) -> bytes:
        frame = bytes(message.pack(link))
        link.seq = (link.seq + 1) % 256
        return frame

    step, boot, y, y1, u1, u2 = 0, 0, 0.0, 0.0, 0.0, 0.0
    while True:
        tick = step - boot
        if tick == 3600 * HZ:
            boot, tick = step, 0
        second, phase = divmod(step, HZ)
        u = 0.5 * math.copysign(1.0, math.sin(3.0 * step / HZ) + 0.7 * rng.standard_normal())
        y, y1 = -A[0] * y - A[1] * y1 + B[0] * u1 + B[1] * u2 + NOISE * rng.standard_normal(), y
        u1, u2 = u, u1
        out = []
        if phase == 0:
            out.append(packed(dialect.MAVLink_heartbeat_message(1, 3, 0x81, 5, 4, 3)))
        if tick == 0:
            out += [
                packed(dialect.MAVLink_param_value_message(name.encode(), value, 4, 4, i))
                for i, (name, value) in enumerate(_PARAMETERS.items())
            ]
        ms, servos = 100_000 + tick * 1000 // HZ, [1500] * 3 + [int(1500 + 400 * u)] + [0] * 4
        out.append(packed(dialect.MAVLink_servo_output_raw_message(1000 * ms, 0, *servos)))
        out.append(packed(dialect.MAVLink_attitude_message(ms, 0.0, 0.0, 0.0, 0.0, 0.0, y)))
        silent = second % 600 >= 580 or second % 97 == 96
        yield [] if silent else out
        step += 1


def fly(port: int, seconds: float, sent: list[int]) -> None:
    """Send the flight at ``SPEED`` for so many seconds."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        start_s = time.monotonic()
        for step, frames in enumerate(flight(np.random.default_rng(0))):
            ahead_s = step / (SPEED * HZ) - (time.monotonic() - start_s)
            if ahead_s > 0.002:
                time.sleep(ahead_s)
            for frame in frames:
                sock.send(frame)
            sent[0] += len(frames)
            if step / (SPEED * HZ) > seconds:
                return


def soak(
    process: subprocess.Popen[str], port: int, seconds: float, say: Callable[[str], None]
) -> None:
    """Fly, watch the process's memory, end it, and say what came of it."""
    sent = [0]
    lines: list[str] = []
    assert process.stderr is not None
    reader = threading.Thread(target=lines.extend, args=(process.stderr,), daemon=True)
    reader.start()
    vehicle = threading.Thread(target=fly, args=(port, seconds, sent), daemon=True)
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
    report(summary, memory, sent[0], lines, say)


def report(
    summary: dict[str, Any],
    memory: list[tuple[float, float]],
    sent: int,
    lines: list[str],
    say: Callable[[str], None],
) -> None:
    """Say what the soak came to."""
    warm = [mb for at_s, mb in memory if at_s >= WARM_S] or [memory[-1][1]]
    lost = (
        f"{sum(summary['live']['dropped'].values())} dropped, {summary['link']['reboots']} reboots"
    )
    say(f"soak   {memory[-1][0]:.0f} s at {SPEED:g}x, {sent} frames, {lost}; memory "
        f"{memory[0][1]:.0f} MB at first, {memory[-1][1]:.0f} at the end, grown by "
        f"{max(warm) - warm[0]:.1f} after a minute")  # fmt: skip
    say(f"       link {summary['link']}, dropped {summary['live']['dropped']}, "
        f"latency {summary['live'].get('latency_ms')}")  # fmt: skip
    for method, estimate in summary["estimates"].items():
        roll = {k: round(v, 4) for k, v in estimate.get("dutch_roll", {}).items() if k != "level"}
        say(f"       {method}: {estimate['updates']} updates, {estimate['held']} held, {roll}")
    said = sum("diverged" in line for line in lines)
    say(f"       lines that said diverged: {said}; verdict {summary['verdict']}")


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process, without what it shares with files."""
    text = Path(f"/proc/{pid}/status").read_text()
    match = re.search(r"RssAnon:\s+(\d+) kB", text)
    return math.nan if match is None else int(match[1]) / 1024.0
