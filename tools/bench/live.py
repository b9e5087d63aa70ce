"""The live tap: loss, CPU per message against pymavlink, latency, kill -9, a soak at 50x speed.

The parts are independent: --only loss stall cpu latency fits kill soak. ``--seconds`` is the length
of the loss at 20 000 messages a second, ``--speed`` that of the latency's link, ``--soak`` the
length of the soak in s. The sender is a process of its own.
"""

from __future__ import annotations

import argparse
import json
import resource
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from checks.children import LONG_S, child, free_udp_port
from flights.surgery import split

from bench.table import head, line, options_of
from yawid.channels.stage import WANTED
from yawid.runs.outputs import Outputs
from yawid.runs.replay import replay
from yawid.runs.stop import StopFlag
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder

TOOLS = Path(__file__).resolve().parents[1]
LOG = TOOLS.parent / "replay_logs" / "sitl_fbwa_50hz" / "log.tlog"
LIVE: tuple[object, ...] = ("-m", "yawid", "live")
QUIET_S = 0.5
CPU_TURNS = 4
STALL_HZ, STALL_S = 1872.0, 5.0
FITS_SPEED = 4.0
ENDING_S = 300.0
"""Time limit in s for the end of a session, which estimates each of its vehicles then."""


def sender(port: int, log: Path, *options: object) -> AbstractContextManager[subprocess.Popen[str]]:
    """Start a process that sends the frames of a log to a port on loopback."""
    program = (sys.executable, "-m", "flights.send_tlog")
    command = [*program, log.resolve(), f"127.0.0.1:{port}", *options]
    return child([*map(str, command)], LONG_S, stdout=subprocess.PIPE, text=True, cwd=TOOLS)


def hear(
    log: Path, rate: float, count: int, before: Callable[[UdpTap], None] = lambda tap: None
) -> dict[str, Any]:
    """Receive and decode ``count`` messages at ``rate`` a second.

    Return how many were sent, heard and dropped, and the CPU time. ``before`` is called with the
    tap before anything is read.
    """
    with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
        decoder, cpu_s = Decoder(WANTED), time.process_time()
        with sender(tap.address[1], log, "--rate", rate, "--count", count) as process:
            before(tap)
            heard_s = time.monotonic()
            while process.poll() is None or time.monotonic() - heard_s < QUIET_S:
                if data := tap.read(0.2):
                    heard_s = time.monotonic()
                    decoder.feed(data)
            assert process.stdout is not None
            sent: dict[str, Any] = json.loads(process.stdout.read())
        cpu_s = time.process_time() - cpu_s
        decoder.finish()
        return sent | {
            "heard": tap.inbox.received, "frames": decoder.link.frames, "queue": tap.inbox.dropped,
            "socket": tap.socket_dropped, "buffer": tap.receive_buffer,
            "cpu_us": 1e6 * cpu_s / max(tap.inbox.received, 1),
        }  # fmt: skip


def bench_loss(options: argparse.Namespace) -> Iterator[str]:
    """Measure the loss at 20 000 messages a second, then at 80 000."""
    for rate, seconds in ((20_000, options.seconds), (80_000, options.seconds / 3)):
        got = hear(options.log, rate, int(rate * seconds))
        lost = got["sent"] - got["heard"]
        achieved = got["sent"] / got["seconds"]
        yield (
            f"{rate} msg/s asked, {achieved:.0f} sent for {got['seconds']:.1f} s: {lost} of "
            f"{got['sent']} lost, the operating system counted {got['socket']}, the queue "
            f"{got['queue']}"
        )


def bench_stall(options: argparse.Namespace) -> Iterator[str]:
    """Measure the loss if the tap is not read for five seconds."""

    def stall(tap: UdpTap) -> None:
        while not tap.inbox.received:
            time.sleep(0.01)
        time.sleep(STALL_S)

    got = hear(options.log, STALL_HZ, int(10 * STALL_HZ), stall)
    lost = got["sent"] - got["frames"]
    yield f"{STALL_S:g} s at {STALL_HZ:g} msg/s: {lost} of {got['sent']} lost"


def bench_cpu(options: argparse.Namespace) -> Iterator[str]:
    """Compare the CPU of yawid's tap and decoder with pymavlink's loop; they take turns."""
    for rate in (STALL_HZ, 20_000.0):
        count = int(4 * rate)
        turns = [
            (hear(options.log, rate, count)["cpu_us"], pymavlink_loop(options.log, rate, count))
            for _ in range(CPU_TURNS)
        ]
        ours, theirs = (min(column) for column in zip(*turns, strict=True))
        yield (
            f"{rate:g} msg/s: tap and decoder {ours:.1f} us a message, {ours / theirs:.2f} of "
            f"pymavlink's udpin loop"
        )


def pymavlink_loop(log: Path, rate: float, count: int) -> float:
    """Return the CPU time in us that pymavlink's udpin needs for a message."""
    from pymavlink import mavutil

    port = free_udp_port()
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="ardupilotmega")
    link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    heard, cpu_s = 0, time.process_time()
    with sender(port, log, "--rate", rate, "--count", count) as process:
        while True:
            if link.recv_match(blocking=True, timeout=QUIET_S) is not None:
                heard += 1
            elif process.poll() is not None:
                break
    cpu_s = time.process_time() - cpu_s
    link.close()
    return 1e6 * cpu_s / max(heard, 1)


@contextmanager
def session(
    folder: Path, *options: object, program: tuple[object, ...] = LIVE
) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Start ``yawid live`` on a free port; yield the process and the port once it listens."""
    port = free_udp_port()
    command = [*program, f"udpin:127.0.0.1:{port}", "--out", folder, "--json", *options]
    with child(
        [sys.executable, *map(str, command)], LONG_S,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        assert "listening" in process.stderr.readline()
        yield process, port


def heard(log: Path, speed: float, *options: Any, program: tuple[object, ...] = LIVE) -> Any:
    """Send a log at ``speed`` times its pace to a session; return the summary of its end."""
    with session(*options, program=program) as (process, port):
        with sender(port, log, "--speed", speed) as vehicle:
            vehicle.wait(LONG_S)
        process.terminate()
        return json.loads(process.communicate(timeout=ENDING_S)[0])


def is_as_replayed(summary: dict[str, Any], folder: Path) -> bool:
    """Return whether a replay of a vehicle's tlog gives the same answers as its session."""
    log = Path(summary["files"]["tlog"])
    settings = {"sysid": summary["vehicle"]["sysid"]}
    again = replay(log, settings, Outputs(folder, f"{log.stem}-again"), StopFlag())
    replayed = again.to_json()
    return all(
        replayed.get(name) == summary.get(name) for name in ("estimates", "manoeuvres", "flight")
    )


def bench_latency(options: argparse.Namespace) -> Iterator[str]:
    """Measure the latency of the whole program at a 50 Hz mix; compare it with a replay."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        summary = heard(options.log, options.speed, folder)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        same = is_as_replayed(summary, folder)
    frames = summary["link"]["frames"]
    dropped = sum(summary["live"]["dropped"].values())
    yield (
        f"last frame of a sample to its estimate {_latency(summary)} ms; "
        f"{1e6 * cpu_s / frames:.0f} us CPU a message in all; {dropped} dropped; "
        f"as its replay to the bit: {same}"
    )


def bench_fits(options: argparse.Namespace) -> Iterator[str]:
    """Measure the latency without manoeuvres, with them, and while a fit runs all the time."""
    with_fits = (TOOLS / "bench" / "live_with_fits.py",)
    for what, program, manoeuvres in (
        ("without manoeuvres", LIVE, "off"),
        ("with manoeuvres", LIVE, "auto"),
        ("with a fit running all the time", with_fits, "auto"),
    ):
        with tempfile.TemporaryDirectory() as name:
            asked = (Path(name), "--manoeuvres", manoeuvres)
            summary = heard(options.log, FITS_SPEED, *asked, program=program)
        rate = summary["link"]["frames"] / summary["duration_s"]
        found = len(summary.get("manoeuvres") or [])
        yield f"{what}, {rate:.0f} msg/s, {found} found: latency {_latency(summary)} ms"


def _latency(summary: dict[str, Any]) -> str:
    return ", ".join(f"{name} {ms:g}" for name, ms in summary["live"]["latency_ms"].items())


def bench_kill(options: argparse.Namespace) -> Iterator[str]:
    """Kill a session with kill -9 at random moments, and measure what is lost."""
    from bench.live_kill import kill_once

    frames = split(options.log.read_bytes())
    rng = np.random.default_rng(0)
    losses = []
    for moment_s in rng.uniform(7.0, 15.0, options.kills):
        with tempfile.TemporaryDirectory() as folder:
            losses.append(kill_once(frames, float(moment_s), Path(folder)))
    same = all(x.is_same for x in losses)
    yield (
        f"kill -9, {len(losses)} times: at most {max(x.tlog_s for x in losses):.2f} s of the tlog "
        f"and {max(x.mcap_s for x in losses):.2f} s of the MCAP missing; the rows recovered are "
        f"{'' if same else 'not '}a replay's"
    )


def bench_soak(options: argparse.Namespace) -> Iterator[str]:
    """Send a flight at 50 times its speed, with silences, reboots and gaps; watch the memory."""
    from bench.live_soak import soak

    with tempfile.TemporaryDirectory() as name, session(Path(name)) as (process, port):
        yield soak(process, port, options.soak)


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[str]]] = {
    "loss": bench_loss, "stall": bench_stall, "cpu": bench_cpu, "latency": bench_latency,
    "fits": bench_fits, "kill": bench_kill, "soak": bench_soak,
}  # fmt: skip


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the rows of the parts asked for."""
    own = {"only": tuple(PARTS)[:-1], "log": LOG, "seconds": 60.0, "speed": 1.0, "kills": 20}
    options = options_of("live", __doc__, arguments, **own, soak=300.0)
    yield from head("", ("measured on loopback",))
    for part in options.only:
        for found in PARTS[part](options):
            yield line(part, found)
