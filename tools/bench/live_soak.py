"""Sends a vehicle's flight at 50 times its speed, and watches the memory of the session."""

from __future__ import annotations

import json
import math
import subprocess
import threading
import time
from collections.abc import Iterator

import numpy as np
from checks.children import LEAVE_S, resident_mb
from flights.send_tlog import Sent, send
from flights.surgery import Encoder, Record
from pymavlink.dialects.v20 import ardupilotmega as dialect

SPEED, HZ = 50.0, 50
A, B = (-1.85, 0.9), (0.02, 0.01)
NOISE = 0.002
WARM_S = 60.0
_PARAMETERS = {"SERVO4_FUNCTION": 21, "SERVO4_MIN": 1100, "SERVO4_TRIM": 1500, "SERVO4_MAX": 1900}


def flight(rng: np.random.Generator, seconds: float) -> Iterator[Record]:
    """Yield what the vehicle sends, with the time in us since the beginning as the stamp.

    In its own time, it is silent for 20 s every ten minutes, reboots every hour, and lacks one
    second of frames in every 97.
    """
    packed = Encoder().frame
    boot, y, y1, u1, u2 = 0, 0.0, 0.0, 0.0, 0.0
    for step in range(round(seconds * HZ)):
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
        if second % 600 < 580 and second % 97 != 96:
            yield from ((1_000_000 * step // HZ, frame) for frame in out)


def soak(process: subprocess.Popen[str], port: int, seconds: float) -> str:
    """Send the flight, watch the process's memory, end it, and return the result in words."""
    sent: list[Sent] = []
    assert process.stderr is not None
    reader = threading.Thread(target=process.stderr.read, daemon=True)
    reader.start()
    records = flight(np.random.default_rng(0), SPEED * seconds)
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
