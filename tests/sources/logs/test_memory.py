"""A log of any size and any content is read in 96 MB: the reader alone, without a replay."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from hostile import run_limited
from sources.tlog_records import BY_NAME, START_US, message, pack, random_records, record, sender

MEGABYTES = 96
SIZE = 8 << 20
READ = """
from pathlib import Path
from yawid.sources.open_log import Log

wanted = {"ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "PARAM_VALUE", "VFR_HUD"}
for path in sorted(Path(sys.argv[1]).iterdir()):
    log = Log(path, wanted)
    for _ in log.read():
        pass
    assert log.link.frames * 20 + log.link.skipped_bytes > path.stat().st_size // 10, path
"""
RECORDS = random_records(np.random.default_rng(1), 2000)
ATTITUDE = pack(message(BY_NAME["ATTITUDE"], struct.pack("<I", 20)), sender())
CONTENTS = (
    b"".join(RECORDS),
    record(START_US, ATTITUDE),
    np.random.default_rng(2).bytes(1 << 20),
    b"\xfe" * 1000,
    b"\xfd" * 1000,
    b"\xfe\x1c\x00\x01\x01\x1e",  # the header of an ATTITUDE
)


def test_a_log_of_any_size_is_read_in_96_mb(tmp_path: Path) -> None:
    for i, content in enumerate(CONTENTS):
        log = b"".join(RECORDS[:5]) + content * (SIZE // len(content))
        (tmp_path / str(i)).write_bytes(log)

    run_limited(READ, MEGABYTES, tmp_path)  # they were read, not skipped
