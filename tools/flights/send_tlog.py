"""Sends the frames of a telemetry log to a UDP endpoint, one in each datagram.

    python -m flights.send_tlog log.tlog 127.0.0.1:14560 --speed 2
    python -m flights.send_tlog log.tlog 127.0.0.1:14560 --rate 20000 --count 1200000

By default they are sent at the pace of their stamps. With ``--rate``, so many are sent a second
regardless of the stamps, and the log starts again when it ends.
"""

from __future__ import annotations

import argparse
import itertools
import socket
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from flights.surgery import Record, split

PAUSE_S, BURST_S = 0.0005, 0.001


def send(frames: Iterable[Record], endpoint: tuple[str, int], speedup: float = 1.0) -> int:
    """Send each frame as a datagram at the pace of its stamps; return how many were sent.

    Those of a millisecond are sent together.
    """
    count, first_us, start_s = 0, None, time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for stamp_us, frame in frames:
            first_us = stamp_us if first_us is None else first_us
            ahead_s = (stamp_us - first_us) / (1e6 * speedup) - (time.monotonic() - start_s)
            if ahead_s > 0.0:
                time.sleep(max(ahead_s, BURST_S))
            sock.sendto(frame, endpoint)
            count += 1
    return count


def endpoint(text: str) -> tuple[str, int]:
    """Return (host, port) of ``HOST:PORT``."""
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isdecimal() and 0 < int(port) < 65536):
        raise argparse.ArgumentTypeError(f"expected HOST:PORT, got {text!r}")
    return host, int(port)


def flood(frames: Sequence[bytes], where: tuple[str, int], rate: float, count: int) -> None:
    """Send ``count`` datagrams evenly at ``rate`` a second, in bursts of half a millisecond."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(where)
        transmit, supply = sock.send, itertools.cycle(frames)
        start_s, sent = time.monotonic(), 0
        while sent < count:
            due = min(count, int((time.monotonic() - start_s) * rate) + 1)
            for frame in itertools.islice(supply, due - sent):
                transmit(frame)
            sent = due
            if rate <= 20_000:
                time.sleep(PAUSE_S)


def main(argv: Sequence[str]) -> int:
    """Send the log; return 0."""
    parser = argparse.ArgumentParser(
        prog="send_tlog.py", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("log", type=Path)
    parser.add_argument("endpoint", type=endpoint, metavar="HOST:PORT")
    parser.add_argument("--speed", type=float, default=1.0, help="times the pace of the stamps")
    parser.add_argument("--rate", type=float, help="datagrams a second instead")
    parser.add_argument("--count", type=int, default=100_000, help="of --rate")
    options = parser.parse_args(argv)
    frames = split(options.log.read_bytes())
    if options.rate is not None:
        flood([frame for _, frame in frames], options.endpoint, options.rate, options.count)
    else:
        send(frames, options.endpoint, options.speed)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
