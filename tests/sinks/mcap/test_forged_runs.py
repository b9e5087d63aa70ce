"""A run's file that was cut off, damaged or forged: what is left is used, or refused in a line."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import examples
from finished_runs import replayed
from forged_runs import forge
from google.protobuf import descriptor_pb2
from hostile import FLIGHT
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.records import Metadata
from mcap.writer import CompressionType, Writer
from places import C172P
from printed import printed
from sinks.mcap.mcap_reading import raw, summary_of, write_file
from sinks.sink_blocks import make_blocks

from yawid.cli.main import main
from yawid.errors import SourceError
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sinks.mcap.messages import RowLayout
from yawid.sinks.mcap.reader import open_run, open_torn
from yawid.sinks.mcap.records import intact
from yawid.sinks.mcap.schemas import descriptor

COMMANDS = {
    "replay": "replay RUN --out OUT", "view": "view RUN --out OUT.rrd",
    "report": "report RUN --out OUT.html", "export": "export RUN -o OUT.csv",
    "model": "export RUN --what model -o OUT.json", "diff": "diff RUN RUN",
    "damper": "damper RUN",
}  # fmt: skip
ALL = ("replay", "view", "report")


def refused(run: Path, names: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> set[str]:
    """The lines in which commands refuse a run; they leave nothing."""
    said, before = set(), [path for path in run.parent.iterdir() if path.name != "out"]
    for name in names:
        words = [run if word == "RUN" else word for word in COMMANDS[name].split()]
        capsys.readouterr()
        given = [str(word).replace("OUT", str(run.parent / "out")) for word in words]
        assert main(given) == 6, name
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith(f"yawid: {run}")
        said.add(line)
    assert [path for path in run.parent.iterdir() if path.name != "out"] == before
    return said


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    (folder / "a.tlog").write_bytes(FLIGHT)
    return replayed(folder / "a.tlog", folder, "--rate", 10)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with an answer."""
    return replayed(C172P, tmp_path_factory.mktemp("flown"), "--rate", 10)


def with_value(path: str, value: Any, summary: Any) -> Any:
    """A summary with another value at a dotted path."""
    *before, last = path.split(".")
    inner = summary
    for name in before:
        inner = inner[int(name)] if isinstance(inner, list) else inner[name]
    inner[last] = value
    return summary


def setting(line: str, toml: str) -> str:
    """A configuration with another line."""
    kept = [old for old in toml.splitlines() if old.split(" =")[0] != line.split(" =")[0]]
    return "\n".join([*kept, line])


def record(
    of: str, values: dict[str, str], name: str, found: dict[str, str]
) -> dict[str, str] | None:
    """A record of metadata with other values, or none at all."""
    return found if name != of else found | values if values else None


def sample(field: str, value: float, topic: str, number: int, data: bytes) -> bytes:
    """One sample's message with another value."""
    if topic != "/yawid/sample" or number != 100:
        return data
    message = np.frombuffer(data, RowLayout(descriptor("yawid.Sample"), {"u": 1}).dtype).copy()
    message[field] = value
    return message.tobytes()


def columns(change: Callable[[Any], object], name: str, data: bytes) -> bytes:
    """The schema of samples with another column."""
    if name != "yawid.Sample":
        return data
    files = descriptor_pb2.FileDescriptorSet.FromString(data)
    change(next(m for m in files.file[-1].message_type if m.name == "Sample").field)
    return files.SerializeToString()


VALUES = [
    ("verdict.usable", "yes"),
    ("verdict.usable", 1),
    ("verdict.reasons", 3),
    ("verdict.reasons", [{"id": "x"}]),
    ("verdict.reasons.0.text", 1),
    ("channels", []),
    ("channels.yaw", "ATTITUDE"),
    ("channels.rudder.source", None),
    ("link", 7),
    ("link.lost", -1),
    ("boots", [{"boot": 1, "from": 0.0, "to": None}]),
    ("source", "a.tlog"),
    ("duration_s", float("nan")),
    ("duration_s", 10**400),
    ("estimates", []),
    ("estimates.els.fit", None),
    ("estimates.els.fit.one_step_pct", "good"),
    ("estimates.els.orders", {}),
    ("estimates.els.sample_time_s", 0),
    ("estimates.els.theta", {"a1": "x"}),
    ("estimates.els.dutch_roll", {"wn_rad_s": 0.0, "zeta": 0.1}),
    ("estimates.els.modes", [{"kind": 1}]),
    ("manoeuvres", {}),
    ("manoeuvres", [{"n": 1}]),
    ("flight", {"used": [1]}),
]
SETTINGS = [
    "unknown = 3",
    "orders = [1e400, 1, 1, 1]",
    "orders = [2, 2, 2, 1]",
    'inputs = ["rudder", "aileron"]',
    'method = "rml"',
    "from_s = " + "9" * 400,
    "band = " + "[" * 3000 + "]" * 3000,
    "what",
]
GRIDS = [
    {"inputs": "rudder aileron"}, {"parameters": "a1"}, {"methods": "els"}, {"inputs": ""},
    {"sample_time_s": "nan"}, {"sample_time_s": "1e-300"}, {"sample_time_s": "x"},
]  # fmt: skip
SAMPLES = {"boot_time": np.nan, "received_time": np.inf, "u": np.inf, "yaw_rate": 1e300,
           "airspeed": -1e300}  # fmt: skip
FORGED: list[tuple[dict[str, Any], tuple[str, ...], str]] = [
    *(({"summary": lambda _, b=broken: b}, ALL, "") for broken in ([], b"[" * 100_000, b"\xff")),
    *(({"summary": partial(with_value, *each)}, ALL, "") for each in VALUES),
    *(({"toml": partial(setting, each)}, ALL, "") for each in SETTINGS),
    *(({"metadata": partial(record, "grid", each)}, ALL, "") for each in GRIDS),
    *(
        ({"message": partial(sample, *each)}, ALL, f"{each[0]} of a sample is impossible")
        for each in SAMPLES.items()
    ),
    (
        {"summary": partial(with_value, "channels.yaw.rate_hz", "fast")}, ALL,
        "channels[...].rate_hz: Expected `float | null`, got `str`",
    ),
    ({"log_time": lambda topic, time: 2**64 - 1}, ("replay",), ""),
    ({"keeps": lambda topic: "log" in topic}, ("replay",), "no sample: replay the log itself"),
    (
        {"summary": partial(with_value, "verdict.reasons.0.id", "too_hot")}, ("replay",),
        "that this version does not know: too_hot",
    ),
    *(
        (
            {"schema": partial(columns, each)}, ("replay",),
            "yawid.Sample is of another version of yawid: replay the log itself",
        )
        for each in (
            lambda fields: fields.pop(),
            lambda fields: setattr(fields[2], "name", "index"),
            lambda fields: setattr(fields[2], "type", 1),
            lambda fields: fields.add(name="further", number=99, type=1, label=1),
        )
    ),
]  # fmt: skip
"""What is forged, the commands that refuse it, and what each says."""


@pytest.mark.parametrize("number", range(len(FORGED)))
def test_what_no_run_wrote_is_refused_in_one_line_and_leaves_nothing(
    run: Path, number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes, commands, words = FORGED[number]
    forged = forge(run, tmp_path / "f.mcap", **changes)
    for line in refused(forged, commands, capsys):
        assert words in line
        # What was forged is not torn, but for a bad message among good ones.
        assert {"message", "log_time"} & changes.keys() or "what is left" not in line


def test_the_answer_of_another_version_is_not_used_until_its_samples_are_replayed(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = {"id": "els_rml_disagree", "weight": "fatal", "text": "they disagree"}
    other_form = {"verdict": {"usable": False, "reasons": [gone]}, "flight": {"another": "form"}}
    for form in ({}, {"form": "0"}):
        changes = {
            "metadata": partial(record, "answers", form),
            "summary": lambda summary: summary | other_form,
        }
        other = forge(flown, tmp_path / "other.mcap", **changes)
        line = f"yawid: {other} is of another version of yawid: replay it first"
        assert refused(other, tuple(COMMANDS)[2:], capsys) == {line}

    assert open_run(other).summary.flight is None
    summary, of_run = replay(other, {}, Outputs(tmp_path, "again"), StopFlag()), open_run(flown)
    assert (summary.flight, summary.manoeuvres) == (
        of_run.summary.flight,
        of_run.summary.manoeuvres,
    )
    assert summary.verdict.exit_code == 0
    assert main(["export", str(tmp_path / "again.mcap"), "-o", str(tmp_path / "out.csv")]) == 0


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.NONE])
def test_a_foreign_recording_is_refused_by_its_own_name(
    compression: CompressionType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (tmp_path / "ros.mcap").open("wb") as target:
        writer = Writer(target, compression=compression)
        writer.start(profile="ros2", library="libmcap")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 1, b"\x00\x01\x00\x00hello", 1)
        writer.add_metadata("rosbag2", {"version": "9"})
        writer.finish()
    assert refused(tmp_path / "ros.mcap", ALL, capsys)


def without_statistics(data: bytes) -> bytes:
    """The file with its statistics record under an opcode that readers have to skip."""
    at = int.from_bytes(data[-28:-20], "little")
    while data[at] != 0x0B:
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    crc = (0).to_bytes(4, "little")  # of the summary: 0 is "not told"
    return data[:at] + b"\x80" + data[at + 1 : -12] + crc + data[-8:]


def test_a_file_without_counts_or_with_a_name_that_is_no_text_is_read_all_the_same(
    run: Path, tmp_path: Path
) -> None:
    mute, odd = tmp_path / "mute.mcap", tmp_path / "caf\udce9.tlog"  # a name in Latin 1
    mute.write_bytes(without_statistics(forge(run, tmp_path / "f.mcap").read_bytes()))
    odd.write_bytes(FLIGHT)
    first = replayed(odd, tmp_path / "first", "--rate", 10)
    for each in (mute, first):
        again = open_run(replayed(each, tmp_path / f"of {each.name}")).summary
        assert again.estimates == open_run(run).summary.estimates


def test_a_reason_that_this_version_does_not_know_is_shown(run: Path, tmp_path: Path) -> None:
    forged = forge(
        run, tmp_path / "f.mcap", summary=partial(with_value, "verdict.reasons.0.id", "too_hot")
    )
    assert main(["view", str(forged), "--out", str(tmp_path / "v.rrd")]) == 0


Sound = tuple[bytes, list[Any], list[int]]


def chunk_ends(path: Path) -> list[int]:
    """The end of each chunk record in the file."""
    return [c.chunk_start_offset + c.chunk_length for c in summary_of(path).chunk_indexes]


def left(path: Path) -> list[tuple[str, int, int, int, bytes]]:
    """The messages that are left, as ``raw`` has those of a whole file."""
    with path.open("rb") as stream:
        return [
            (channel.topic, found.log_time, found.publish_time, found.sequence, found.data)
            for each in intact(stream)
            if not isinstance(each, Metadata)
            for _, channel, found in each
        ]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Sound:
    """A file, its messages, and the ends of its chunks."""
    path = write_file(tmp_path_factory.mktemp("sound") / "whole.mcap", make_blocks(n=100))
    return path.read_bytes(), raw(path), chunk_ends(path)


@given(
    size=st.floats(0.0, 1.0), at=st.floats(0.0, 1.0, exclude_max=True), value=st.integers(0, 255)
)
@example(size=1.0, at=0.08625533546313657, value=1)  # the topic of a channel record
@example(size=0.999999, at=0.08625533546313657, value=1)
@examples(50)
def test_a_file_cut_anywhere_has_all_its_complete_chunks_and_no_flipped_byte_makes_a_false_message(
    size: float, at: float, value: int, sound: Sound, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole, rows, ends = sound
    data = bytearray(whole[: int(size * len(whole))])
    if data:
        data[int(at * len(data))] ^= value
    path = tmp_path_factory.mktemp("torn") / "torn.mcap"
    path.write_bytes(data)
    found = left(path)
    assert found == rows[: len(found)]
    complete = 20 * 4 * sum(end <= len(data) for end in ends)  # messages of a second's samples
    assert value or len(found) >= min(complete, len(rows)) - (complete == 400)


def test_a_channel_that_claims_the_number_of_another_ends_the_file(
    sound: Sound, tmp_path: Path
) -> None:
    data, names = bytearray(sound[0]), (b"\x0d\0\0\0/yawid/sample", b"\x0c\0\0\0/yawid/modes")
    sample, modes = (data.index(name) - 4 for name in names)
    data[modes : modes + 2] = data[sample : sample + 2]
    (tmp_path / "a.mcap").write_bytes(data)
    assert left(tmp_path / "a.mcap") == []


def flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :]


def test_it_is_replayed_as_the_same_stretch_of_the_whole_run_and_is_no_answer(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, torn, bad = run.read_bytes(), tmp_path / "a.mcap.part", tmp_path / "bad.mcap"
    torn.write_bytes(data[: 2 * len(data) // 3])  # as kill -9 leaves it
    left_over, whole = open_torn(torn, SourceError("why")), open_run(run)
    times = np.concatenate([samples.boot_us for samples in left_over.samples()]) / 1e6
    assert left_over.config == whole.config
    assert 100 < left_over.rows == len(times) < whole.rows
    options = ["--orders", "2,2,2,1", "--json", "--out"]
    assert main(["replay", str(torn), *options, str(tmp_path / "again")]) == 130
    again = printed("replay", capsys.readouterr().out)
    main(["replay", str(run), "--to", str(times[-1]), *options, str(tmp_path / "direct")])
    direct = printed("replay", capsys.readouterr().out)
    assert (tmp_path / "again" / "a.mcap").exists()
    for key in ("estimates", "manoeuvres"):
        assert again[key] == direct[key]
    first = again["verdict"]["reasons"][0]
    assert (first["id"], again["verdict"]["usable"]) == ("interrupted", False)
    assert (
        f"a.mcap.part was cut off or is damaged: it has {left_over.rows} samples" in first["text"]
    )

    ends = chunk_ends(run)  # one that is damaged in its middle is read up to there
    bad.write_bytes(flipped(data, (ends[6] + ends[7]) // 2))
    assert main(["replay", str(bad), "--out", str(tmp_path / "out")]) == 130
    assert "interrupted: bad.mcap was cut off or is damaged" in capsys.readouterr().out
    assert 60 < open_torn(bad, SourceError("why")).rows < whole.rows / 2

    [line] = refused(torn, tuple(COMMANDS)[1:], capsys)
    assert "yawid replay of this file reads what is left of it" in line
    # Without a sample, or without what they are, only the log can help.
    for content in (data[:2000], flipped(data[: 2 * len(data) // 3], data.index(b"configuration"))):
        bad.write_bytes(content)
        [line] = refused(bad, ("replay",), capsys)
        assert "replay its log again" in line
    assert {path.name for path in tmp_path.iterdir()} == {
        "a.mcap.part", "bad.mcap", "again", "direct", "out",
    }  # fmt: skip
