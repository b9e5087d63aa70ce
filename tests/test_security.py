"""Every point of the threat model in tests/README.md, attacked: link, log, report and MCAP.

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
from flights.surgery import Encoder, edited, join, split
from hostile import (
    FLIGHT,
    assert_harmless,
    bomb,
    hostile_log,
    rewritten,
    run_limited,
    with_bomb,
)
from hypothesis import given
from hypothesis import strategies as st
from live_link import heard, tlog_size
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.channels.grid_rate import MOST_SEGMENTS
from yawid.channels.stage import WANTED, Channels
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import YawidError
from yawid.report.write import write_report
from yawid.runs.finished_run import FinishedRun
from yawid.sinks.mcap.reader import open_run
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import SigningKey

KEY = bytes(range(32))
SIGNED = edited(split(FLIGHT), key=KEY)


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
    leaps = long_log(np.full(10_000, 0.1), np.full(10_000, 1600.0), 1.0 / 9.0, start_s=40.0)
    (tmp_path / "leaps.tlog").write_bytes(FLIGHT + leaps)
    (tmp_path / "many.tlog").write_bytes(many_senders())

    run_limited(
        "from yawid.cli.main import main\n"
        "for log, rate in ((sys.argv[1], '50'), (sys.argv[2], '10')):\n"
        "    assert main(['replay', log, '--out', sys.argv[3], '--rate', rate]) in (0, 5)",
        400,
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

    channels.feed_frames(frames)

    assert MOST_SEGMENTS <= len(channels.startup.pieces) <= 3 * MOST_SEGMENTS
    assert channels.segmenter.reboots > 2000
    assert channels.finish() == []


@pytest.fixture(scope="module")
def hostile_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    log = folder / "a <img src=x onerror=alert(1)> & \"b\" 'c'.tlog"
    log.write_bytes(hostile_log())
    assert main(["replay", str(log), "--out", str(folder / "out"), "--rate", "10"]) in (0, 5)
    return folder


def test_names_in_a_log_make_no_file_anywhere(hostile_run: Path):
    stem = "a <img src=x onerror=alert(1)> & \"b\" 'c'"

    made = {path.relative_to(hostile_run).as_posix() for path in hostile_run.rglob("*")}
    assert made == {f"{stem}.tlog", "out", f"out/{stem}.mcap"}
    with next((hostile_run / "out").iterdir()).open("rb") as stream:
        names = [a.name for a in make_reader(stream).iter_attachments()]
    assert {Path(name).name for name in names} == set(names)


def test_a_report_runs_nothing_that_names_or_forged_messages_put_into_it(
    hostile_run: Path, tmp_path: Path
):
    mcap = next((hostile_run / "out").iterdir())
    forged = rewritten(mcap, tmp_path / "forged.mcap", poison_metadata=False)
    pages = [
        write_report(each, tmp_path / "r.html", force=True).read_text(encoding="utf-8")
        for each in (mcap, forged)
    ]
    for page in pages:
        assert_harmless(page)
    assert "&lt;img src=x onerror=alert(1)&gt;" in pages[0]

    refused = rewritten(mcap, tmp_path / "refused.mcap", poison_metadata=True)
    with pytest.raises(YawidError, match="not a file as yawid writes it"):
        write_report(refused, tmp_path / "refused.html")
    assert not list(tmp_path.glob("refused.html*"))


@pytest.fixture(scope="module")
def good_mcap(hostile_run: Path) -> bytes:
    return next((hostile_run / "out").iterdir()).read_bytes()


@given(data=st.data())
def test_a_damaged_mcap_is_read_to_there_or_refused_in_one_line(
    good_mcap: bytes, tmp_path_factory, data: st.DataObject
):
    folder = tmp_path_factory.mktemp("damaged")
    content = bytearray(good_mcap)
    for _ in range(data.draw(st.integers(0, 8))):
        at = data.draw(st.integers(0, len(content) - 1))
        width = data.draw(st.sampled_from([1, 1, 8]))
        content[at : at + width] = data.draw(st.binary(min_size=width, max_size=width))
    content = content[: data.draw(st.integers(1, len(content)))]
    (folder / "in.mcap").write_bytes(content)

    for act in (
        lambda: [*FinishedRun(folder / "in.mcap").read()],
        lambda: open_run(folder / "in.mcap"),
        lambda: write_report(folder / "in.mcap", folder / "r.html"),
    ):
        try:
            act()
        except YawidError as refusal:
            assert bytes(content) != good_mcap, refusal
            assert "\n" not in str(refusal)
    assert not list(folder.glob("*.part"))


def test_a_chunk_that_unpacks_to_gigabytes_is_not_unpacked(good_mcap: bytes, tmp_path: Path):
    (tmp_path / "bomb.mcap").write_bytes(bomb(1500))
    (tmp_path / "run.mcap").write_bytes(with_bomb(good_mcap, 1500))
    assert (tmp_path / "bomb.mcap").stat().st_size < 1_000_000

    run_limited(
        "from yawid.cli.main import main\n"
        "from yawid.sinks.mcap.records import intact\n"
        "alone, run, out = sys.argv[1:]\n"
        "assert main(['replay', alone, '--out', out]) == 6\n"
        "assert list(intact(open(alone, 'rb'))) == []\n"
        "assert main(['report', run, '-o', out + '/r.html']) == 6\n"
        "assert main(['view', run, '--out', out + '/v.rrd']) == 6",
        900,
        tmp_path / "bomb.mcap",
        tmp_path / "run.mcap",
        tmp_path / "out",
    )
