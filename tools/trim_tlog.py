"""Cuts a stretch of vehicle time out of a tlog: whole records, whose bytes do not change.

    python tools/trim_tlog.py IN.tlog OUT.tlog --from 76.5 --to 255 --only

Vehicle time is ATTITUDE's time_boot_ms; a record has the time of the last ATTITUDE up to it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

from flights.surgery import CLASSES, join, message_id, messages, split

ESSENTIAL = ("HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD", "PARAM_VALUE", "STATUSTEXT")


def trim(log: bytes, start_s: float, stop_s: float, only: Collection[str] | None = None) -> bytes:
    """Return the records with ``start_s <= boot time < stop_s``; ``only`` names their messages."""
    wanted = None if only is None else {CLASSES[name].id for name in only}
    attitude, boot_s, kept = CLASSES["ATTITUDE"].id, -1.0, []
    for stamp, frame in split(log):
        if (ident := message_id(frame)) == attitude:
            [now] = messages([(stamp, frame)], "ATTITUDE")
            boot_s = now.time_boot_ms / 1000.0
        if start_s <= boot_s < stop_s and (wanted is None or ident in wanted):
            kept.append((stamp, frame))
    return join(kept)


def main(argv: Sequence[str]) -> int:
    """Trim the log; return 0."""
    parser = argparse.ArgumentParser(prog="trim_tlog.py")
    parser.add_argument("log", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--from", dest="start_s", type=float, default=0.0, help="boot seconds")
    parser.add_argument("--to", dest="stop_s", type=float, default=float("inf"))
    parser.add_argument("--only", nargs="*", metavar="NAME", help=f"none named: {ESSENTIAL}")
    options = parser.parse_args(argv)
    only = ESSENTIAL if options.only == [] else options.only
    part = trim(options.log.read_bytes(), options.start_s, options.stop_s, only)
    options.out.write_bytes(part)
    print(f"trim_tlog: {len(part)} bytes", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
