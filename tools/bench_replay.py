"""An hour at 20 Hz to MCAP and .rrd, against bare pymavlink reading of the same log; memory too."""

from __future__ import annotations

import argparse
import os
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

RATE_HZ = 20
START_US = 1_700_000_000_000_000
WANTED = ["ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "VFR_HUD"]


def write_log(path: Path, hours: float, others_hz: int, seed: int = 1) -> int:
    """Write a flight: ATTITUDE and servos at 20 Hz, and ``others_hz`` other messages a second."""
    rng = np.random.default_rng(seed)
    n = round(3600 * hours * RATE_HZ)
    u = np.repeat(rng.choice([-0.2, 0.0, 0.2], n // 10 + 1), 10)[:n]
    rate = lfilter([0.0, 0.0124, -0.0115], [1.0, -1.957, 0.9735], u) + 0.002 * rng.normal(size=n)
    yaw = np.cumsum(rate) / RATE_HZ
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    count = 0
    with path.open("wb") as out:

        def send(t_us: int, message: Any) -> None:
            nonlocal count
            out.write(struct.pack(">Q", START_US + t_us) + message.pack(link))
            link.seq = (link.seq + 1) % 256
            count += 1

        for name, value in (("SERVO4_FUNCTION", 21), ("SERVO4_MIN", 1100), ("SERVO4_MAX", 1900),
                            ("SERVO4_TRIM", 1500)):  # fmt: skip
            send(0, mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0))
        for k in range(n):
            t_us = 10_000_000 + k * 1_000_000 // RATE_HZ
            if k % RATE_HZ == 0:
                send(t_us, mavlink.MAVLink_heartbeat_message(1, 3, 128, 5, 4, 3))
                send(t_us, mavlink.MAVLink_vfr_hud_message(25.0, 25.0, 0, 50, 100.0, 0.0))
            pwm = [1500, 1500, 1500, 1500 + round(400 * u[k]), 0, 0, 0, 0]
            send(t_us, mavlink.MAVLink_servo_output_raw_message(t_us % 2**32, 0, *pwm))
            angle = (float(yaw[k]) + np.pi) % (2 * np.pi) - np.pi
            attitude = (t_us // 1000, 0.0, 0.0, angle, 0.0, 0.0, float(rate[k]))
            send(t_us, mavlink.MAVLink_attitude_message(*attitude))
            for i in range(others_hz // RATE_HZ):
                position = (t_us // 1000, 0, 0, 0, 0, 0, 0, 0, i)
                send(t_us, mavlink.MAVLink_global_position_int_message(*position))
    return count


def bare_pymavlink(path: Path) -> tuple[float, float]:
    """Return wall and CPU seconds until pymavlink has handed over the messages yawid uses."""
    start, cpu = time.perf_counter(), time.process_time()
    log = mavutil.mavlink_connection(str(path))
    while log.recv_match(type=WANTED) is not None:
        pass
    return time.perf_counter() - start, time.process_time() - cpu


def replay(path: Path, out: Path, rerun: str) -> tuple[float, float, float]:
    """Return wall and CPU seconds and peak memory in MB of a replay in its own process."""
    command = ["replay", str(path), "--out", str(out), "--force", "--json", "--rerun", rerun]
    start = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "yawid", *command], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 5):
        raise SystemExit(f"the replay ended with {process.returncode}")
    cpu = used.ru_utime + used.ru_stime
    return time.perf_counter() - start, cpu, used.ru_maxrss / 1024.0


def main(arguments: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="bench.py replay", description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--others", type=int, default=190, help="other messages a second")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--no-bare", action="store_true", help="leave pymavlink out")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "flight.tlog"
        count = write_log(log, options.hours, options.others)
        print(f"{options.hours:g} h, {count} messages, {log.stat().st_size / 1e6:.1f} MB")
        bare = float("nan"), float("nan")
        if not options.no_bare:
            bare = min(bare_pymavlink(log) for _ in range(options.repeat))
            print(f"bare pymavlink         wall {bare[0]:5.2f} s, CPU {bare[1]:5.2f} s")
        for rerun in ("off", "save"):
            runs = [replay(log, Path(folder) / rerun, rerun) for _ in range(options.repeat)]
            wall, cpu, _ = min(runs)
            what = "MCAP" if rerun == "off" else "MCAP and .rrd"
            ratios = f"ratio {wall / bare[0]:.2f} and {cpu / bare[1]:.2f}"
            peak = max(run[2] for run in runs)
            print(
                f"replay, {what:13s}  wall {wall:5.2f} s, CPU {cpu:5.2f} s, {ratios}, {peak:.0f} MB"
            )
        sizes = {p.suffix: p.stat().st_size / 1e6 for p in (Path(folder) / "save").iterdir()}
        print(", ".join(f"{name} {size:.1f} MB" for name, size in sorted(sizes.items())))
