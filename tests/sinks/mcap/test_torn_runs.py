"""What is left of a run that was cut off or damaged: read to its first bad record, never wrong."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks.children import child
from drawn import examples
from finished_runs import replayed
from hostile import FLIGHT
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.records import Metadata
from printed import printed
from sinks.mcap.mcap_reading import raw, summary_of, write_file
from sinks.sink_blocks import PARAMETERS, make_blocks, script_environment

from yawid.cli.main import main
from yawid.errors import SourceError
from yawid.sinks.mcap.reader import open_run, open_torn
from yawid.sinks.mcap.records import intact
from yawid.sinks.mcap.schemas import TOPICS, schema_data

WRITER = """
import sys
from pathlib import Path
from sinks.mcap.mcap_reading import open_sink
from sinks.sink_blocks import cut, make_blocks
from yawid.sinks.base import RunRows
sink = open_sink(Path(sys.argv[1]))
for block in cut(make_blocks(n=317), list(range(317))):
    sink.take(RunRows(*block))
print("written", flush=True)
sys.stdin.read()
"""
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


def test_kill_9_loses_at_most_a_second(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path / "a.mcap")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with child(command, env=script_environment(), **pipes) as writer:
        assert writer.stdout.readline() == b"written\n"
        writer.send_signal(signal.SIGKILL)
    kept, written = left(tmp_path / "a.mcap.part"), make_blocks(n=317)[0].unix_ns
    found = [at for topic, at, *_ in kept if topic == "/yawid/sample"]
    assert found == written[: len(found)].tolist()
    assert written[-1] - found[-1] <= 1_000_000_000
    topics = ("/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes")
    counts = Counter(topic for topic, *_ in kept)
    assert counts == dict.fromkeys(topics, len(found)) | {"/yawid/mode": 1}


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


@pytest.mark.long
def test_no_byte_of_a_torn_file_makes_a_false_message_when_flipped(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap", make_blocks(n=3))
    rows, data = raw(whole), whole.read_bytes()
    stop = chunk_ends(whole)[-1]  # the summary is lost: nothing settles what a number means
    inside = np.zeros(stop, bool)  # of a schema, half of the file: each 16th byte will do
    for content in {schema_data(name, PARAMETERS) for name in TOPICS.values()}:
        for found in re.finditer(re.escape(content), data[:stop]):
            inside[slice(*found.span())] = np.arange(len(content)) % 16 > 0
    assert (~inside).sum() > 4000
    path = tmp_path / "flipped.mcap"
    for at in np.flatnonzero(~inside).tolist():
        flipped = bytearray(data[:stop])
        flipped[at] ^= 1 << at % 8
        path.write_bytes(flipped)
        kept = left(path)
        assert kept == rows[: len(kept)], at


def test_a_channel_that_claims_the_number_of_another_ends_the_file(
    sound: Sound, tmp_path: Path
) -> None:
    data, names = bytearray(sound[0]), (b"\x0d\0\0\0/yawid/sample", b"\x0c\0\0\0/yawid/modes")
    sample, modes = (data.index(name) - 4 for name in names)
    data[modes : modes + 2] = data[sample : sample + 2]
    (tmp_path / "a.mcap").write_bytes(data)
    assert left(tmp_path / "a.mcap") == []


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    (folder / "a.tlog").write_bytes(FLIGHT)
    return replayed(folder / "a.tlog", folder, "--rate", 10, "--memory", "inf")


def flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :]


def test_it_is_replayed_as_the_same_stretch_of_the_whole_run_and_is_no_answer(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, torn, bad = whole.read_bytes(), tmp_path / "a.mcap.part", tmp_path / "bad.mcap"
    torn.write_bytes(data[: 2 * len(data) // 3])  # as kill -9 leaves it
    run, of_whole = open_torn(torn, SourceError("why")), open_run(whole)
    times = np.concatenate([samples.boot_us for samples in run.samples()]) / 1e6
    assert run.config == of_whole.config
    assert 100 < run.rows == len(times) < of_whole.rows
    options = ["--orders", "2,2,2,1", "--json", "--out"]
    assert main(["replay", str(torn), *options, str(tmp_path / "again")]) == 130
    again = printed("replay", capsys.readouterr().out)
    main(["replay", str(whole), "--to", str(times[-1]), *options, str(tmp_path / "direct")])
    direct = printed("replay", capsys.readouterr().out)
    assert (tmp_path / "again" / "a.mcap").exists()
    for key in ("estimates", "manoeuvres"):
        assert again[key] == direct[key]
    first = again["verdict"]["reasons"][0]
    assert (first["id"], again["verdict"]["usable"]) == ("interrupted", False)
    assert f"a.mcap.part was cut off or is damaged: it has {run.rows} samples" in first["text"]

    ends = chunk_ends(whole)  # one that is damaged in its middle is read up to there
    bad.write_bytes(flipped(data, (ends[6] + ends[7]) // 2))
    assert main(["replay", str(bad), "--out", str(tmp_path / "out")]) == 130
    assert "interrupted: bad.mcap was cut off or is damaged" in capsys.readouterr().out
    assert 60 < open_torn(bad, SourceError("why")).rows < of_whole.rows / 2

    to = {"report": ["-o", "r.html"], "view": ["--out", "v.rrd"], "export": ["-o", "r.csv"]}
    for command in (*to, "damper"):
        words = (tmp_path / word if "." in word else word for word in to.get(command, []))
        assert main([command, str(torn), *map(str, words)]) == 6
        [line] = capsys.readouterr().err.splitlines()
        assert "yawid replay of this file reads what is left of it" in line
    # Without a sample, or without what they are, only the log can help.
    for content in (data[:2000], flipped(data[: 2 * len(data) // 3], data.index(b"configuration"))):
        bad.write_bytes(content)
        assert main(["replay", str(bad), "--out", str(tmp_path / "none")]) == 6
        [line] = capsys.readouterr().err.splitlines()
        assert "replay its log again" in line
    assert {path.name for path in tmp_path.iterdir()} == {
        "a.mcap.part", "bad.mcap", "again", "direct", "out",
    }  # fmt: skip
