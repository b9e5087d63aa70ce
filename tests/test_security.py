"""Every point of the threat model in tests/README.md, attacked: the link and the log.

What comes from a socket, a log or an MCAP was written by anybody; what comes from the command line
was not. Nothing hostile may end in a traceback, in unbounded memory or, where a key was given, in a
changed estimate. Frames and files with any bits in them are drawn in test_fuzz.py.
"""

from __future__ import annotations

import socket
from pathlib import Path

import numpy as np
import pytest
from daylog import long_log
from flightlog import FlightLog
from flights.surgery import Encoder, join, rewrite, split
from hostile import FLIGHT, run_limited
from hypothesis import given
from hypothesis import strategies as st
from live_link import heard, tlog_size
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.channels.grid_rate import MOST_SEGMENTS
from yawid.channels.stage import WANTED, Channels
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import SigningKey

KEY = bytes(range(32))
SIGNED = rewrite(split(FLIGHT), key=KEY)


@pytest.mark.parametrize("key", [None, KEY])
def test_what_is_sent_to_a_vehicle_is_not_drawn_to_who_claims_to_be_it(key: bytes | None):
    """Without a key the first address stands; with one only what is signed says where to."""
    frames = [frame for _, frame in split(FLIGHT)][:20]
    own = frames if key is None else [frame for _, frame in SIGNED[:20]]
    with (
        UdpTap(Endpoint("127.0.0.1", 0), may_transmit=True, key=key and SigningKey(key)) as tap,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as forger,
    ):
        if key is not None:  # he may even come first
            forger.sendto(frames[0], tap.address)
        for true, forged in zip(own, frames, strict=True):
            vehicle.sendto(true, tap.address)
            forger.sendto(forged, tap.address)
        heard(tap, tlog_size(own) + tlog_size(frames))
        vehicle.settimeout(60.0)
        forger.settimeout(0.0)
        assert tap.transmit(b"hello", 1)
        assert vehicle.recv(100) == b"hello"
        with pytest.raises(BlockingIOError):
            forger.recv(100)


@given(noise=st.binary(max_size=3000))
def test_any_file_at_all_ends_in_an_exit_code_and_one_line(tmp_path_factory, noise: bytes):
    folder = tmp_path_factory.mktemp("noise")
    (folder / "x.tlog").write_bytes(noise)

    assert main(["replay", str(folder / "x.tlog"), "--out", str(folder / "out")]) in {0, 3, 4, 5, 6}


def many_senders() -> bytes:
    """Ten thousand senders and parameters."""
    encoder, records = Encoder(), split(FLIGHT)
    for i in range(20_000):
        ids = (1 + i % 250, 1 + i // 250 % 250)
        beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
        name = f"X{i:07d}".encode()
        message = beat if i % 2 else mavlink.MAVLink_param_value_message(name, 1.0, 9, 1, 0)
        records.append((records[0][0], encoder.frame(message, ids if i % 2 else (1, 1))))
    return join(records)


def test_leaps_of_a_clock_and_ten_thousand_senders_and_parameters_take_little_memory(
    tmp_path: Path,
):
    """Nine seconds from frame to frame at the highest rate: nothing is filled in between."""
    leaps = long_log(np.full(20_000, 0.1), np.full(20_000, 1600.0), 1.0 / 9.0, start_s=40.0)
    (tmp_path / "leaps.tlog").write_bytes(FLIGHT + leaps)
    (tmp_path / "many.tlog").write_bytes(many_senders())

    run_limited(
        "from yawid.cli.main import main\n"
        "for log, rate in ((sys.argv[1], '50'), (sys.argv[2], '10')):\n"
        "    assert main(['replay', log, '--out', sys.argv[3], '--rate', rate]) in (0, 5)",
        900,
        tmp_path / "leaps.tlog",
        tmp_path / "many.tlog",
        tmp_path / "out",
    )


def test_a_clock_that_starts_again_with_every_message_takes_little_memory_and_time() -> None:
    """Segments too short to show a rate are kept for later, but not all that can be made."""
    log, encoder = FlightLog(), Encoder()
    log.heartbeat(0.0)
    records = split(log.data)
    for t in np.random.default_rng(1).integers(0, 4_000_000, 6000).tolist():
        angles = mavlink.MAVLink_attitude_message(1000 * t, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1)
        servos = mavlink.MAVLink_servo_output_raw_message(10**6 * t % 2**32, 0, *[1500] * 8)
        stamp = records[-1][0] + 1000
        records += [(stamp, encoder.frame(message)) for message in (angles, servos)]
    frames, channels = Decoder(WANTED).feed(join(records)), Channels(RunConfig())
    assert frames is not None

    channels.feed_frames(frames)

    assert MOST_SEGMENTS <= len(channels.startup.pieces) <= 3 * MOST_SEGMENTS
    assert channels.segmenter.reboots > 2000
    assert channels.finish() == []
