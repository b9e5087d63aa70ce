"""Cuts a stretch of vehicle time out of a tlog: whole records, whose bytes do not change.

    python tools/trim_tlog.py IN.tlog OUT.tlog --from 76.5 --to 255 --only

Vehicle time is ATTITUDE's time_boot_ms; a record has the time of the last ATTITUDE up to it.
"""

from __future__ import annotations

import argparse
import struct
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

from flights.surgery import join, message_id, payload, split
from pymavlink.dialects.v20 import ardupilotmega

ESSENTIAL = ("HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD", "PARAM_VALUE", "STATUSTEXT")


def trim(log: bytes, start_s: float, stop_s: float, only: Collection[str] | None = None) -> bytes:
    """Return the records with ``start_s <= boot time < stop_s``; ``only`` names their messages."""
    wanted = None if only is None else {number(name) for name in only}
    attitude, boot_s, kept = number("ATTITUDE"), -1.0, []
    for stamp, frame in split(log):
        if (ident := message_id(frame)) == attitude:
            boot_s = struct.unpack("<I", payload(frame, 4))[0] / 1000.0
        if start_s <= boot_s < stop_s and (wanted is None or ident in wanted):
            kept.append((stamp, frame))
    return join(kept)


def number(name: str) -> int:
    """Return a message's number.

    Raises:
        ValueError: the dialect has no such message.
    """
    found = getattr(ardupilotmega, f"MAVLINK_MSG_ID_{name}", None)
    if found is None:
        raise ValueError(f"no MAVLink message {name!r}")
    return int(found)


def main(argv: Sequence[str]) -> int:
    """Trim the log; return 0, or 2 after printing the reason in one line."""
    parser = argparse.ArgumentParser(prog="trim_tlog.py")
    parser.add_argument("log", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--from", dest="start_s", type=float, default=0.0, help="boot seconds")
    parser.add_argument("--to", dest="stop_s", type=float, default=float("inf"))
    parser.add_argument("--only", nargs="*", metavar="NAME", help=f"none named: {ESSENTIAL}")
    options = parser.parse_args(argv)
    only = ESSENTIAL if options.only == [] else options.only
    try:
        part = trim(options.log.read_bytes(), options.start_s, options.stop_s, only)
        options.out.write_bytes(part)
    except (ValueError, OSError) as error:
        print(f"trim_tlog: {error}", file=sys.stderr)
        return 2
    print(f"trim_tlog: {len(part)} bytes", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
