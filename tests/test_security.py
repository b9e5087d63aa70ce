"""Every point of the threat model in tests/README.md, attacked: the link and the log.

What comes from a socket, a log or an MCAP was written by anybody; what comes from the command line
was not. Nothing hostile may end in a traceback, in unbounded memory or, where a key was given, in a
changed estimate.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from daylog import long_log
from flightlog import FlightLog, finished
from flights.surgery import Encoder, join, rewrite, split
from hostile import FLIGHT, run_limited
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.channels.grid_rate import MOST_SEGMENTS
from yawid.channels.stage import WANTED, Channels
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
KNOWN_CODES = {0, 3, 4, 5, 6}


def told(records: bytes, key: bytes | None) -> dict[str, Any]:
    read_options = ReadOptions(key=None if key is None else SigningKey(key))
    return finished(records, RunConfig(rate=10.0), options=read_options).to_json()


def over_udp(datagrams: list[bytes]) -> bytes:
    """Send datagrams to a real tap; return what it records of them."""
    with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
        data = b""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for first in range(0, len(datagrams), 50):
                for datagram in datagrams[first : first + 50]:
                    sender.sendto(datagram, tap.address)
                while tap.inbox.received < min(first + 50, len(datagrams)):
                    data += tap.read(0.05)
        return data + tap.read(0.0)


def signed(key: bytes) -> list[bytes]:
    return [frame for _, frame in rewrite(split(FLIGHT), key=key)]


def spoofed(frames: list[bytes]) -> Iterator[bytes]:
    """Yield the link's datagrams among forged, altered and replayed ones."""
    lie = mavlink.MAVLink_attitude_message(22_000, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0)
    plain, stranger = Encoder(), Encoder(OTHER_KEY)
    for i, frame in enumerate(frames):
        yield frame
        if i % 5 == 0:
            yield plain.frame(lie)
            yield stranger.frame(lie)
            yield frame
            yield frames[i // 2]
            altered = bytearray(frame)
            altered[-20] ^= 1
            yield bytes(altered)


def test_with_a_key_a_spoofed_and_replayed_link_changes_no_estimate():
    frames = signed(KEY)
    attacked = list(spoofed(frames))
    found = told(over_udp(attacked), KEY)
    expected = told(over_udp(frames), KEY)

    assert found["estimates"]["els"]["theta"] == expected["estimates"]["els"]["theta"]
    assert found["estimates"]["els"]["updates"] == expected["estimates"]["els"]["updates"] > 200
    assert found["link"]["unsigned_rejected"] >= 0.7 * (len(attacked) - len(frames))


def test_with_a_key_a_link_replayed_whole_is_heard_once():
    frames = signed(KEY)
    found = told(over_udp(frames + frames), KEY)

    assert found["link"]["unsigned_rejected"] == len(frames)
    assert found["link"]["reboots"] == 0
    once = told(over_udp(frames), KEY)
    assert found["estimates"]["els"]["theta"] == once["estimates"]["els"]["theta"]


def test_without_a_key_a_second_sender_of_the_vehicles_id_is_named():
    """Forged frames cannot be told from true ones then; that somebody else sends is said."""
    frames = [frame for _, frame in split(FLIGHT)][:40]
    with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
        data, count = b"", 0
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
        ):
            for frame in frames:
                for sender in (one, two):
                    sender.sendto(frame, tap.address)
                    count += 1
            while tap.inbox.received < count:
                data += tap.read(0.05)
        data += tap.read(0.0)
        assert set(tap.senders.first) == {1}
        assert tap.senders._reported == {1}


@pytest.mark.parametrize("key", [None, KEY])
def test_what_is_sent_to_a_vehicle_is_not_drawn_to_who_claims_to_be_it(key: bytes | None):
    """Without a key the first address stands; with one only what is signed says where to."""
    frames = [frame for _, frame in split(FLIGHT)][:20]
    own = frames if key is None else signed(key)[:20]
    signing = None if key is None else SigningKey(key)
    with (
        UdpTap(Endpoint("127.0.0.1", 0), may_transmit=True, key=signing) as tap,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as forger,
    ):
        if key is not None:  # he may even come first
            forger.sendto(frames[0], tap.address)
        sent = int(key is not None)
        for true, forged in zip(own, frames, strict=True):
            vehicle.sendto(true, tap.address)
            forger.sendto(forged, tap.address)
            sent += 2
        patience_s = time.monotonic() + 60.0
        while tap.inbox.received < sent and time.monotonic() < patience_s:
            tap.read(0.05)
        tap.read(0.0)
        vehicle.settimeout(60.0)
        forger.settimeout(0.0)
        assert tap.transmit(b"hello", 1)
        assert vehicle.recv(100) == b"hello"
        with pytest.raises(BlockingIOError):
            forger.recv(100)


MESSAGES = {
    "heartbeat": mavlink.MAVLink_heartbeat_message,
    "attitude": mavlink.MAVLink_attitude_message,
    "servo": mavlink.MAVLink_servo_output_raw_message,
    "vfr": mavlink.MAVLink_vfr_hud_message,
    "param": mavlink.MAVLink_param_value_message,
    "quaternion": mavlink.MAVLink_attitude_quaternion_message,
    "position": mavlink.MAVLink_global_position_int_message,
    "control": mavlink.MAVLink_actuator_control_target_message,
}


@st.composite
def hostile_records(draw: st.DrawFn) -> bytes:
    """Genuine frames of what yawid reads, whose fields hold any bits at all, at any stamp."""
    link = mavlink.MAVLink(None, 1, 1)
    data = FlightLog()
    data.heartbeat(5.0, autopilot=draw(st.sampled_from([3, 12])))
    log = data.data
    for _ in range(draw(st.integers(0, 40))):
        kind = MESSAGES[draw(st.sampled_from(sorted(MESSAGES)))]
        size = struct.calcsize(kind.unpacker.format)
        payload = draw(st.binary(min_size=size, max_size=size))
        stamp = draw(st.integers(0, 2**52))
        count = draw(st.sampled_from([1, 1, 30]))
        for i in range(count):
            link.seq = (link.seq + 1) % 256
            frame = framed(link, kind, payload, i)
            log += struct.pack(">Q", stamp + 20_000 * i) + frame
    return log


def framed(link: Any, kind: Any, payload: bytes, i: int) -> bytes:
    """Return the frame of a payload; where it begins with a time, that goes on by 20 ms a frame."""
    first = (int.from_bytes(payload[:4], "little") + 20 * i) % 2**32
    body = first.to_bytes(4, "little") + payload[4:]
    header = bytes([0xFE, len(body), link.seq, 1, 1, kind.id])
    crc = mavlink.x25crc(header[1:] + body)
    crc.accumulate(bytes([kind.crc_extra]))
    return header + body + struct.pack("<H", crc.crc)


@given(log=hostile_records())
def test_frames_with_any_bits_in_their_fields_give_a_verdict(log: bytes):
    found = told(log, None)

    json.dumps(found, allow_nan=False)
    assert isinstance(found["verdict"]["usable"], bool)


@given(data=st.data())
def test_a_good_log_damaged_anywhere_gives_a_verdict(data: st.DataObject):
    log = bytearray(FLIGHT[:60_000])
    for _ in range(data.draw(st.integers(1, 30))):
        at = data.draw(st.integers(0, len(log) - 1))
        log[at] = data.draw(st.integers(0, 255))
    found = told(bytes(log), None)

    json.dumps(found, allow_nan=False)


@given(noise=st.binary(max_size=3000))
def test_any_file_at_all_ends_in_an_exit_code_and_one_line(tmp_path_factory, noise: bytes):
    folder = tmp_path_factory.mktemp("noise")
    (folder / "x.tlog").write_bytes(noise)

    assert main(["replay", str(folder / "x.tlog"), "--out", str(folder / "out")]) in KNOWN_CODES


def test_a_clock_that_leaps_from_frame_to_frame_takes_no_memory(tmp_path: Path):
    """Nine seconds from frame to frame at the highest rate: nothing is filled in between."""
    leaps = long_log(np.full(20_000, 0.1), np.full(20_000, 1600.0), 1.0 / 9.0, start_s=40.0)
    (tmp_path / "leaps.tlog").write_bytes(FLIGHT + leaps)

    run_limited(
        "from yawid.cli.main import main\n"
        "assert main(['replay', sys.argv[1], '--out', sys.argv[2], '--rate', '50']) in (0, 5)",
        900,
        tmp_path / "leaps.tlog",
        tmp_path / "out",
    )


def test_a_clock_that_starts_anew_with_every_message_takes_little_memory_and_time() -> None:
    """Segments too short to tell a rate are kept for later, but not all that anybody can make."""
    rng, log, encoder, records = np.random.default_rng(1), FlightLog(), Encoder(), []
    log.heartbeat(0.0)
    records = split(log.data)
    for t in rng.integers(0, 4_000_000, 6000).tolist():
        angles = mavlink.MAVLink_attitude_message(1000 * t, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1)
        servos = mavlink.MAVLink_servo_output_raw_message(10**6 * t % 2**32, 0, *[1500] * 8)
        stamp = records[-1][0] + 1000
        records += [(stamp, encoder.frame(message)) for message in (angles, servos)]
    decoder, channels = Decoder(WANTED), Channels(RunConfig())
    frames = decoder.feed(join(records))
    assert frames is not None

    channels.feed_frames(frames)

    assert channels.startup is not None
    assert MOST_SEGMENTS <= len(channels.startup.pieces) <= 3 * MOST_SEGMENTS
    assert channels.segmenter.reboots > 2000
    assert channels.finish() == []


def test_ten_thousand_senders_and_parameters_take_little_memory(tmp_path: Path):
    encoder = Encoder()
    records = split(FLIGHT)
    stamp = records[0][0]
    for i in range(20_000):
        ids = (1 + i % 250, 1 + i // 250 % 250)
        beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
        name = f"X{i:07d}".encode()
        message = beat if i % 2 else mavlink.MAVLink_param_value_message(name, 1.0, 9, 1, 0)
        records.append((stamp, encoder.frame(message, ids if i % 2 else (1, 1))))
    (tmp_path / "many.tlog").write_bytes(join(records))

    run_limited(
        "from yawid.cli.main import main\n"
        "assert main(['replay', sys.argv[1], '--out', sys.argv[2], '--rate', '10']) in (0, 5)",
        900,
        tmp_path / "many.tlog",
        tmp_path / "out",
    )
