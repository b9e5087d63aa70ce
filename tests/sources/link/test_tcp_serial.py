"""The tap on a TCP connection and on a serial line: frames cut anywhere come out whole."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from live_link import heard
from sources.tlog_records import random_records

from yawid.errors import SourceError
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.tcp_serial import StreamTap, complete_until

FRAMES = [rec[8:] for rec in random_records(np.random.default_rng(0), 200)]


def frames_of(data: bytes) -> bytes:
    """Return the frames of records whose frames are known: all stamps cut out."""
    out, at = b"", 0
    for frame in FRAMES:
        if at >= len(data):
            break
        out += data[at + 8 : at + 8 + len(frame)]
        at += 8 + len(frame)
    return out


def test_frames_cut_anywhere_come_out_whole_and_nothing_is_sent_back() -> None:
    stream, rng = b"".join(FRAMES), np.random.default_rng(1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        tap = StreamTap(Endpoint(*server.getsockname(), "tcp"))
        vehicle, _ = server.accept()
        with tap, vehicle:
            cuts = [0, *sorted(rng.integers(0, len(stream), 60).tolist()), len(stream)]
            for first, stop in pairwise(cuts):
                vehicle.sendall(stream[first:stop])
            data = heard(tap, len(stream) + 8 * len(FRAMES))
            vehicle.settimeout(0.0)
            with pytest.raises(BlockingIOError):
                vehicle.recv(1)
    assert frames_of(data) == stream


def test_a_connection_that_is_lost_is_sought_again_and_both_are_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        tap = StreamTap(Endpoint(*server.getsockname(), "tcp"))
        first, _ = server.accept()
        with tap:
            first.sendall(FRAMES[0])
            assert heard(tap, 1)
            first.close()
            again, _ = server.accept()
            with again:
                again.sendall(FRAMES[1])
                assert heard(tap, 1)[8:] == FRAMES[1]
                news = [("lost" in line, "back" in line) for line in tap.news]
                assert news == [(True, False), (False, True)]


def test_a_peer_that_is_not_there_is_one_line_with_the_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
    with pytest.raises(SourceError, match="nothing listens there"):
        StreamTap(Endpoint(*address, "tcp"))


def test_a_serial_port_that_cannot_be_opened_is_one_line() -> None:
    with pytest.raises(SourceError, match="no such device") as caught:
        StreamTap(Endpoint("/dev/ttyNone", 57600, "serial"))
    assert "\n" not in str(caught.value)


def test_without_pyserial_a_serial_port_is_one_line_that_names_the_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(SourceError, match=r"/dev/ttyUSB0,57600: .*pip install 'yawid\[serial\]'"):
        StreamTap(Endpoint("/dev/ttyUSB0", 57600, "serial"))


@contextmanager
def serial_line(device: Path) -> Iterator[int]:
    """A serial line whose one end is the device, the other the descriptor that is yielded."""
    vehicle, line = os.openpty()
    device.unlink(missing_ok=True)
    device.symlink_to(os.ttyname(line))
    try:
        yield vehicle
    finally:
        os.close(line)
        os.close(vehicle)


needs_pty = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")


@needs_pty
def test_frames_on_a_serial_line_come_out_whole_and_nothing_is_sent_back(tmp_path: Path) -> None:
    stream, device = b"".join(FRAMES), tmp_path / "tty"
    with serial_line(device) as vehicle:
        with StreamTap(Endpoint(str(device), 57600, "serial")) as tap:
            sender = threading.Thread(target=write_all, args=(vehicle, stream), daemon=True)
            sender.start()
            data = heard(tap, len(stream) + 8 * len(FRAMES))
            sender.join(60.0)
        os.set_blocking(vehicle, False)
        with pytest.raises(BlockingIOError):
            os.read(vehicle, 1)
    assert frames_of(data) == stream
    assert tap.skipped_bytes == 0


@needs_pty
def test_a_serial_device_that_is_pulled_out_is_sought_again_and_both_are_said(
    tmp_path: Path,
) -> None:
    device = tmp_path / "tty"
    with ExitStack() as stack:
        with serial_line(device) as vehicle:
            tap = stack.enter_context(StreamTap(Endpoint(str(device), 57600, "serial")))
            os.write(vehicle, FRAMES[0])
            assert heard(tap, 1)[8:] == FRAMES[0]
        vehicle = stack.enter_context(serial_line(device))
        patience = time.monotonic() + 60.0
        while not any("back" in news for news in tap.news) and time.monotonic() < patience:
            time.sleep(0.05)
        os.write(vehicle, FRAMES[1])
        assert heard(tap, 1)[8:] == FRAMES[1]
        news = [("lost" in line, "back" in line) for line in tap.news]
        assert news == [(True, False), (False, True)]


def write_all(descriptor: int, data: bytes) -> None:
    """Write everything: a serial line takes a few kilobytes at a time."""
    while data:
        data = data[os.write(descriptor, data) :]


def test_bytes_before_an_unfinished_frame_are_complete() -> None:
    frame = FRAMES[0]
    for size in range(1, len(frame)):
        assert complete_until(b"ab" + frame[:size]) == 2
    assert complete_until(b"ab" + frame) == 2 + len(frame)
    assert complete_until(b"abc") == 3
