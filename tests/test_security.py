"""Every point of the threat model in README, attacked.

What comes from a socket, a log or an MCAP was written by anybody; what comes from the command line
was not. Nothing hostile may end in a traceback, a file outside the output folder, a script in a
report, unbounded memory, or, where a key was given, a changed estimate.
"""

from __future__ import annotations

import io
import json
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from daylog import long_log
from flightlog import FlightLog, fly
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_surgery import Encoder, join, rewrite, split
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import ChunkIndex, Footer
from mcap.writer import CompressionType, Writer
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.cli import main
from yawid.errors import YawidError
from yawid.pipeline import Pipeline
from yawid.run_config import RunConfig
from yawid.sinks.mcap_run import open_run
from yawid.sinks.recover import recover
from yawid.sinks.report import write_report
from yawid.sources.endpoints import Endpoint
from yawid.sources.reading import Reading
from yawid.sources.signing import SigningKey
from yawid.sources.udp import UdpTap
from yawid.summary import summarise

ROOT = Path(__file__).parents[1]
KEY, OTHER_KEY = bytes(range(32)), bytes(32)
KNOWN_CODES = {0, 3, 4, 5, 6}


def flight() -> FlightLog:
    return fly(
        lambda t: 0.1 * np.sin(2.4 * t),
        lambda t: 1500 + int(150 * np.sin(2.0 * t) + 60 * np.sin(5.3 * t)),
        25.0,
    )


FLIGHT = flight().data


# --- a spoofed or replayed link -------------------------------------------------------------------


def told(records: bytes, key: bytes | None) -> dict[str, Any]:
    reading = Reading(key=None if key is None else SigningKey(key))
    pipeline = Pipeline(RunConfig(rate=10.0), reading=reading)
    pipeline.feed(records)
    pipeline.finish()
    return summarise(pipeline, "", "")[0]


def over_udp(datagrams: list[bytes]) -> bytes:
    """Send datagrams to a real tap; return what it records of them."""
    with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
        data = b""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for first in range(0, len(datagrams), 50):
                for datagram in datagrams[first : first + 50]:
                    sender.sendto(datagram, tap.address)
                while tap.datagrams < min(first + 50, len(datagrams)):
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
            while tap.datagrams < count:
                data += tap.read(0.05)
        data += tap.read(0.0)
        assert set(tap.senders.latest) == {1}
        assert tap.senders._told == {1}


# --- a hostile log --------------------------------------------------------------------------------

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


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(log=hostile_records())
def test_frames_with_any_bits_in_their_fields_give_a_verdict(log: bytes):
    found = told(log, None)

    json.dumps(found, allow_nan=False)
    assert isinstance(found["verdict"]["usable"], bool)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_good_log_damaged_anywhere_gives_a_verdict(data: st.DataObject):
    log = bytearray(FLIGHT[:60_000])
    for _ in range(data.draw(st.integers(1, 30))):
        at = data.draw(st.integers(0, len(log) - 1))
        log[at] = data.draw(st.integers(0, 255))
    found = told(bytes(log), None)

    json.dumps(found, allow_nan=False)


@settings(max_examples=40, deadline=None)
@given(noise=st.binary(max_size=3000))
def test_any_file_at_all_ends_in_an_exit_code_and_one_line(tmp_path_factory, noise: bytes):
    folder = tmp_path_factory.mktemp("noise")
    (folder / "x.tlog").write_bytes(noise)

    assert main(["replay", str(folder / "x.tlog"), "--out", str(folder / "out")]) in KNOWN_CODES


def run_limited(code: str, megabytes: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process that may take so much memory beyond what it starts with."""
    limited = (
        "import resource, sys\n"
        "sys.path.insert(0, sys.argv.pop(1))\n"
        f"{code}\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)\n"
    )
    command = [sys.executable, "-c", limited, str(ROOT / "src"), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-1]) < megabytes
    return done


def test_a_clock_that_leaps_from_frame_to_frame_takes_no_memory(tmp_path: Path):
    """Nine seconds from frame to frame at the highest rate: nothing is filled in between."""
    leaps = long_log(np.full(20_000, 0.1), np.full(20_000, 1600.0), 1.0 / 9.0, start_s=40.0)
    (tmp_path / "leaps.tlog").write_bytes(FLIGHT + leaps)

    run_limited(
        "from yawid.cli import main\n"
        "assert main(['replay', sys.argv[1], '--out', sys.argv[2], '--rate', '50']) in (0, 5)",
        900,
        tmp_path / "leaps.tlog",
        tmp_path / "out",
    )


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
        "from yawid.cli import main\n"
        "assert main(['replay', sys.argv[1], '--out', sys.argv[2], '--rate', '10']) in (0, 5)",
        900,
        tmp_path / "many.tlog",
        tmp_path / "out",
    )


# --- names out of a log ---------------------------------------------------------------------------

HOSTILE_NAMES = (
    b"../../../../x",
    b"/etc/passwd",
    b"<script>alert",
    b"\x1b[2J\x1b]0;own\x07",
    b"[red]x[/red]",
    b"a\nb\r\nc",
    b"\xff\xfe\x80",
    b'"onload="x',
    b"&lt;b&gt;",
    b"%s%n{0}",
    b"SERVO99_FUNCTIO",
)


def hostile_log() -> bytes:
    log = FlightLog()
    log.heartbeat(9.0)
    log.parameter(9.0, "SERVO4_FUNCTION", 21.0)
    for name in HOSTILE_NAMES:
        log.data += struct.pack(">Q", split(FLIGHT)[0][0]) + parameter(name)
    return log.data + FLIGHT


def parameter(name: bytes) -> bytes:
    body = struct.pack("<fHH16sB", 1.0, 1, 0, name.ljust(16, b"\0"), 9)
    header = bytes([0xFE, len(body), 0, 1, 1, mavlink.MAVLINK_MSG_ID_PARAM_VALUE])
    crc = mavlink.x25crc(header[1:] + body)
    crc.accumulate(bytes([mavlink.MAVLink_param_value_message.crc_extra]))
    return header + body + struct.pack("<H", crc.crc)


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


def test_names_in_a_log_send_the_terminal_no_commands(hostile_run: Path, tmp_path: Path, capsys):
    log = next(hostile_run.glob("*.tlog"))
    for options in ([], ["--json"]):
        main(
            [
                "replay",
                str(log),
                "--out",
                str(tmp_path / str(len(options))),
                "--rate",
                "10",
                *options,
            ]
        )
    main(["inspect", str(log)])
    said = capsys.readouterr()

    controls = {c for c in said.out + said.err if ord(c) < 32} - {"\n"}
    assert controls == set()


class Tags(HTMLParser):
    """Collects what a browser would act on."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.attributes: list[tuple[str, str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        self.attributes += [(name, value or "") for name, value in attrs]


def assert_harmless(page: str) -> None:
    """No script, no event handler, nothing loaded or followed outside the page."""
    tags = Tags(page)
    active = {"script", "iframe", "object", "embed", "img", "base", "form"}
    assert tags.names & active == set()
    assert not [name for name, _ in tags.attributes if name.startswith("on")]
    for name, value in tags.attributes:
        if name in ("href", "src", "xlink:href", "action", "data"):
            assert value.startswith(("#", "data:")), (name, value)
    assert "alert(1)>" not in page


def test_a_report_runs_nothing_that_names_put_into_it(hostile_run: Path, tmp_path: Path):
    mcap = next((hostile_run / "out").iterdir())
    page = write_report(mcap, tmp_path / "r.html").read_text(encoding="utf-8")

    assert_harmless(page)
    assert "&lt;img src=x onerror=alert(1)&gt;" in page


INJECTION = "\"'><script>alert(1)</script><img src=x onerror=alert(1)>"


def poisoned(value: Any) -> Any:
    """Return the value with every text in it, keys too, turned into an attack."""
    if isinstance(value, dict):
        return {key: poisoned(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [poisoned(entry) for entry in value]
    return f"{value}{INJECTION}" if isinstance(value, str) else value


def rewritten(source: Path, out: Path, poison_metadata: bool) -> Path:
    """Copy an MCAP with its summary, its parameters and perhaps its metadata poisoned."""
    with source.open("rb") as stream, out.open("wb") as target:
        reader, writer = make_reader(stream), Writer(target, compression=CompressionType.ZSTD)
        writer.start(profile="", library="yawid")
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        for record in reader.iter_metadata():
            metadata = poisoned(dict(record.metadata)) if poison_metadata else record.metadata
            writer.add_metadata(record.name, metadata)
        for attachment in reader.iter_attachments():
            data = attachment.data
            if attachment.name == "summary.json":
                data = json.dumps(poisoned(json.loads(data))).encode()
            elif attachment.name == "parameters.txt":
                data = INJECTION.encode() + b" 1.0\n" + data
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, data)
        writer.finish()
    return out


@pytest.mark.parametrize("poison_metadata", [False, True])
def test_a_report_of_a_forged_run_is_harmless_or_refused(
    hostile_run: Path, tmp_path: Path, poison_metadata: bool
):
    mcap = next((hostile_run / "out").iterdir())
    forged = rewritten(mcap, tmp_path / "forged.mcap", poison_metadata)
    try:
        page = write_report(forged, tmp_path / "r.html").read_text(encoding="utf-8")
    except YawidError as refusal:
        assert poison_metadata, refusal
        return

    assert_harmless(page)


# --- a hostile MCAP -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good_mcap(hostile_run: Path) -> bytes:
    return next((hostile_run / "out").iterdir()).read_bytes()


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_damaged_mcap_is_recovered_or_refused_in_one_line(
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
        lambda: recover(folder / "in.mcap", folder / "out.mcap"),
        lambda: open_run(folder / "in.mcap"),
        lambda: write_report(folder / "in.mcap", folder / "r.html"),
    ):
        try:
            act()
        except YawidError as refusal:
            assert "\n" not in str(refusal)
    assert not list(folder.glob("*.part"))


def bomb(megabytes: int) -> bytes:
    """Return an MCAP whose one chunk is small and claims, truly, to hold so many megabytes."""
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE)
    writer.start(profile="", library="bomb")
    channel = writer.register_channel("/x", "json", 0)
    writer.add_message(channel, 0, b"x", 0)
    writer.finish()
    return out.getvalue()[: out.getvalue().index(b"\x06")] + bomb_chunk(megabytes)


def bomb_chunk(megabytes: int) -> bytes:
    compressor = zstandard.ZstdCompressor().compressobj(size=megabytes << 20)
    data = b"".join(compressor.compress(bytes(1 << 20)) for _ in range(megabytes))
    data += compressor.flush()
    body = struct.pack("<QQQI", 0, 0, megabytes << 20, 0)
    body += struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(data)) + data
    return b"\x06" + struct.pack("<Q", len(body)) + body


def with_bomb(good: bytes, megabytes: int) -> bytes:
    """Return a run's file with one chunk more, of which the index says that it holds log lines."""
    summary = make_reader(io.BytesIO(good)).get_summary()
    assert summary is not None
    line = next(n for n, channel in summary.channels.items() if channel.topic == "/yawid/log")
    summary_start = struct.unpack("<Q", good[-28:-20])[0]
    chunk, data = bomb_chunk(megabytes), good[: summary_start - 13]
    index = RecordBuilder()
    ChunkIndex(
        chunk_length=len(chunk),
        chunk_start_offset=len(data),
        compression="zstd",
        compressed_size=len(chunk),
        message_end_time=2**63,
        message_index_length=0,
        message_index_offsets={line: len(data)},
        message_start_time=0,
        uncompressed_size=megabytes << 20,
    ).write(index)
    tail = RecordBuilder()
    Footer(len(data) + len(chunk) + 13, 0, 0).write(tail)
    data_end = b"\x0f" + struct.pack("<QI", 4, 0)
    offsets = struct.unpack("<Q", good[-20:-12])[0] or len(good) - 37
    told = data + chunk + data_end + good[summary_start:offsets] + index.end() + tail.end()
    return told + good[-8:]


def test_a_chunk_that_unpacks_to_gigabytes_is_not_unpacked(tmp_path: Path):
    (tmp_path / "bomb.mcap").write_bytes(bomb(1500))
    assert (tmp_path / "bomb.mcap").stat().st_size < 1_000_000

    run_limited(
        "from pathlib import Path\n"
        "from yawid.errors import SinkError\n"
        "from yawid.sinks.recover import recover\n"
        "try:\n"
        "    recover(Path(sys.argv[1]), Path(sys.argv[2]))\n"
        "except SinkError as error:\n"
        "    assert 'nothing recovered' in str(error)",
        700,
        tmp_path / "bomb.mcap",
        tmp_path / "out.mcap",
    )


def test_a_run_with_such_a_chunk_is_neither_reported_nor_shown(good_mcap: bytes, tmp_path: Path):
    (tmp_path / "bomb.mcap").write_bytes(with_bomb(good_mcap, 1500))
    (tmp_path / "small.mcap").write_bytes(with_bomb(good_mcap, 1))
    assert main(["report", str(tmp_path / "small.mcap"), "-o", str(tmp_path / "s.html")]) in (0, 6)

    run_limited(
        "from yawid.cli import main\n"
        "assert main(['report', sys.argv[1], '-o', sys.argv[2]]) == 6\n"
        "assert main(['view', sys.argv[1], '--save', sys.argv[3]]) == 6",
        700,
        tmp_path / "bomb.mcap",
        tmp_path / "r.html",
        tmp_path / "v.rrd",
    )


def test_recover_never_writes_where_an_attachments_name_points(tmp_path: Path):
    with (tmp_path / "in.mcap").open("wb") as target:
        writer = Writer(target)
        writer.start(profile="", library="evil")
        channel = writer.register_channel("/../../x", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.add_attachment(0, 0, "../../../escaped.txt", "text/plain", b"x")
        writer.finish()

    recover(tmp_path / "in.mcap", tmp_path / "sub.mcap")

    assert {path.name for path in tmp_path.iterdir()} == {"in.mcap", "sub.mcap"}
    assert not (tmp_path / ".." / "escaped.txt").exists()
