"""Inputs of an attacker (logs, names, forged runs), and checks of the outputs."""

from __future__ import annotations

import io
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from flightlog import FlightLog, fly
from flights.surgery import Encoder
from forged_runs import forge
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, Footer
from mcap.writer import Writer
from places import ROOT
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from report_page import Page, assert_runs_only_its_own

from yawid.report.html import SCRIPTS

FLIGHT = fly(
    lambda t: 0.1 * np.sin(2.4 * t),
    lambda t: 1500 + int(150 * np.sin(2.0 * t) + 60 * np.sin(5.3 * t)),
    25.0,
).data


def run_limited(
    code: str, megabytes: int, *arguments: object, within_s: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process whose peak memory must be less than ``megabytes``.

    VmHWM is the peak of the process itself; Linux includes memory of its parent in ru_maxrss.
    """
    limited = (
        "import resource, sys\n"
        "sys.path.insert(0, sys.argv.pop(1))\n"
        f"{code}\n"
        "from pathlib import Path as P\n"
        "lines = P('/proc/self/status').read_text().splitlines() if P('/proc').is_dir() else []\n"
        "own = [int(line.split()[1]) for line in lines if line.startswith('VmHWM')]\n"
        "print((own or [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss])[0] // 1024)\n"
    )
    command = [sys.executable, "-c", limited, str(ROOT / "src"), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=within_s)
    assert done.returncode == 0, done.stderr
    peak = int(done.stdout.split()[-1])
    assert peak < megabytes, f"{peak} MB"
    return done


HOSTILE_NAMES = (
    b"../../../../x",
    b"/etc/passwd",
    b"<script>alert",
    b"\x1b[2J\x1b]0;own\x07",
    b"[red]x[/red]",
    b"a\nb\r\nc",
    b"\xff\xfe\x80",
    b'"onload="x',
    b"&lt;b&gt;",
    b"%s%n{0}",
    b"SERVO99_FUNCTIO",
)


def hostile_log() -> bytes:
    log = FlightLog()
    log.heartbeat(9.0)
    log.parameter(9.0, "SERVO4_FUNCTION", 21.0)
    for name in HOSTILE_NAMES:
        log.add(9.0, named(name))
    return log.data + FLIGHT


def named(name: bytes) -> Any:
    return mavlink.MAVLink_param_value_message(name, 1.0, 9, 1, 0)


def parameter(name: bytes) -> bytes:
    return Encoder().frame(named(name))


def assert_harmless(html: str) -> None:
    """Assert that a page runs only its own scripts, and loads and links nothing outside."""
    page = Page(html)
    assert_runs_only_its_own(page, SCRIPTS)
    active = {"iframe", "object", "embed", "img", "base", "form"}
    assert set(page.tags) & active == set()
    assert [each for each in page.addresses if not each.startswith(("#", "data:"))] == []
    assert "alert(1)>" not in html


INJECTION = "\"'><script>alert(1)</script><img src=x onerror=alert(1)>"


def poisoned(value: Any) -> Any:
    """Return the value with an attack appended to every text in it, but not to keys."""
    if isinstance(value, dict):
        return {key: poisoned(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [poisoned(entry) for entry in value]
    return f"{value}{INJECTION}" if isinstance(value, str) else value


def rewritten(source: Path, out: Path, poison_metadata: bool) -> Path:
    """Copy an MCAP with an attack in its summary, its parameters and, if asked, its metadata."""
    line = INJECTION.encode() + b" 1.0\n"
    return forge(
        source,
        out,
        summary=poisoned,
        metadata=lambda name, record: dict(poisoned(record)) if poison_metadata else record,
        attached=lambda name, data: line + data if name == "parameters.txt" else data,
    )


def bomb(megabytes: int) -> bytes:
    """Return an MCAP whose only chunk is small and unpacks to so many megabytes."""
    out = io.BytesIO()
    Writer(out).start(library="bomb")
    return out.getvalue() + bomb_chunk(megabytes)


def bomb_chunk(megabytes: int) -> bytes:
    compressor = zstandard.ZstdCompressor().compressobj(size=megabytes << 20)
    data = b"".join(compressor.compress(bytes(1 << 20)) for _ in range(megabytes))
    data += compressor.flush()
    chunk = RecordBuilder()
    Chunk("zstd", data, 0, 0, 0, megabytes << 20).write(chunk)
    return bytes(chunk.end())


def with_bomb(good: bytes, megabytes: int) -> bytes:
    """Return a run's file with such a chunk, which has log lines according to the index."""
    summary = make_reader(io.BytesIO(good)).get_summary()
    line = next(n for n, channel in summary.channels.items() if channel.topic == "/yawid/log")
    summary_start, offsets = struct.unpack("<QQ", good[-28:-12])
    chunk, data = bomb_chunk(megabytes), good[: summary_start - 13]
    index = RecordBuilder()
    ChunkIndex(
        chunk_length=len(chunk),
        chunk_start_offset=len(data),
        compression="zstd",
        compressed_size=len(chunk),
        message_end_time=2**63,
        message_index_length=0,
        message_index_offsets={line: len(data)},
        message_start_time=0,
        uncompressed_size=megabytes << 20,
    ).write(index)
    Footer(len(data) + len(chunk) + 13, 0, 0).write(index)
    data_end = b"\x0f" + struct.pack("<QI", 4, 0)
    its_summary = good[summary_start : offsets or len(good) - 37]
    return data + chunk + data_end + its_summary + index.end() + good[-8:]
