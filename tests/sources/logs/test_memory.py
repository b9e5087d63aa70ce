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

wanted = {"ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "PARAM_VALUE", "VFR_HUD"}
log = Log(Path(sys.argv[1]), wanted)
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
    "every message": (b"", b"".join(RECORDS)),
    "frames as short as can be": (b"", b"".join(record(START_US, each) for each in ATTITUDES)),
    "noise": (HEAD, np.random.default_rng(2).bytes(1 << 20)),
    "magics of version 1": (HEAD, b"\xfe" * 1000),
    "magics of version 2": (HEAD, b"\xfd" * 1000),
    "headers of an ATTITUDE": (HEAD, b"\xfe\x1c\x00\x01\x01\x1e"),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_of_any_size_is_read_in_96_mb(name: str, tmp_path: Path) -> None:
    head, content = LOGS[name]
    (tmp_path / "log").write_bytes(head + content * (SIZE // len(content)))

    done = run_limited(READ, MEGABYTES, tmp_path / "log")

    frames, skipped = map(int, done.stdout.split()[:2])
    assert frames * 20 + skipped > SIZE // 10  # it was read, not skipped
