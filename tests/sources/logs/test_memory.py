"""A log of any size and any content is read in 96 MB: the reader alone, without a replay."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hostile import run_limited
from sources.tlog_records import BY_NAME, START_US, message, pack, random_records, record, sender

MEGABYTES = 96
SIZE = 12 << 20
READ = """
from pathlib import Path
from yawid.sources.open_log import Log
from yawid.sources.open_log import ReadOptions

read_options = ReadOptions(sys.argv[2])
wanted = {"ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "PARAM_VALUE", "VFR_HUD"}
log = Log(Path(sys.argv[1]), wanted, read_options)
for _ in log.read():
    pass
print(log.link.frames, log.link.skipped_bytes)
"""
RECORDS = random_records(np.random.default_rng(1), 2000)
HEAD = b"".join(RECORDS[:5])
LINK = sender()
ATTITUDES = [
    pack(message(BY_NAME["ATTITUDE"], struct.pack("<I", 20 * i)), LINK) for i in range(2000)
]
LOGS = {
    "every message": ("tlog", b"", b"".join(RECORDS)),
    "frames as short as can be": (
        "tlog",
        b"",
        b"".join(record(START_US, frame) for frame in ATTITUDES),
    ),
    "frames without stamps": ("raw", b"", b"".join(ATTITUDES)),
    "noise": ("tlog", HEAD, np.random.default_rng(2).bytes(1 << 20)),
    "magics of version 1": ("tlog", HEAD, b"\xfe" * 1000),
    "magics of version 2": ("tlog", HEAD, b"\xfd" * 1000),
    "headers of an ATTITUDE": ("tlog", HEAD, b"\xfe\x1c\x00\x01\x01\x1e"),
    "headers without stamps": ("raw", ATTITUDES[0], b"\xfd\x1c\x00\x00\x00\x01\x01\x1e\x00\x00"),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_of_any_size_is_read_in_96_mb(name: str, tmp_path: Path) -> None:
    form, head, content = LOGS[name]
    (tmp_path / "log").write_bytes(head + content * (SIZE // len(content)))

    done = run_limited(READ, MEGABYTES, tmp_path / "log", form)

    frames, skipped = map(int, done.stdout.split()[:2])
    assert frames * 20 + skipped > SIZE // 10  # it was read, not skipped
