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
from mcap.reader import make_reader
from mcap.records import Metadata
from printed import printed
from sinks.mcap.mcap_reading import raw
from sinks.sink_blocks import GRID, PARAMETERS, SUMMARY, make_blocks, script_environment

from yawid.cli.main import main
from yawid.errors import SourceError
from yawid.runs.finished_run import FinishedRun
from yawid.sinks.base import Done, RunRows
from yawid.sinks.mcap.reader import open_run, open_torn
from yawid.sinks.mcap.records import intact
from yawid.sinks.mcap.schemas import TOPICS, schema_data
from yawid.sinks.mcap.sink import McapSink

PER_SAMPLE = 4  # messages: sample, two estimates, modes
WRITER = """
import sys
from pathlib import Path
from sinks.sink_blocks import GRID, cut, make_blocks
from yawid.sinks.base import RunRows
from yawid.sinks.mcap.sink import McapSink
sink = McapSink(Path(sys.argv[1]), {"configuration": {"rate": 20.0}})
sink.take(GRID)
n = int(sys.argv[2])
for block in cut(make_blocks(n=n), list(range(n))):
    sink.take(RunRows(*block))
print("written", flush=True)
sys.stdin.read()
"""


def write_file(path: Path, n: int = 100) -> Path:
    sink = McapSink(path, {"configuration": {"rate": 20.0}})
    sink.take(GRID)
    sink.take(RunRows(*make_blocks(n=n)))
    sink.take(Done(SUMMARY, {"summary.json": b"{}"}))
    return path


def chunk_places(path: Path) -> list[tuple[int, int]]:
    """Start and end of each chunk record in the file."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [
        (c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in summary.chunk_indexes
    ]


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
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Any], list[int]]:
    """A file, its messages, and the ends of its chunks."""
    path = write_file(tmp_path_factory.mktemp("sound") / "whole.mcap")
    return path.read_bytes(), raw(path), [end for _, end in chunk_places(path)]


def test_kill_9_loses_at_most_a_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with child(
        [sys.executable, "-c", WRITER, str(path), "317"],
        env=script_environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"written\n"
        writer.send_signal(signal.SIGKILL)
    counts = Counter(topic for topic, *_ in left(path.with_name("a.mcap.part")))
    rows = counts["/yawid/sample"]
    found = [at for topic, at, *_ in left(path.with_name("a.mcap.part")) if "sample" in topic]
    written = make_blocks(n=317)[0].unix_ns
    assert found == written[:rows].tolist()
    assert written[-1] - found[-1] <= 1_000_000_000
    topics = ("/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes")
    assert counts == dict.fromkeys(topics, rows) | {"/yawid/mode": 1}


@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_a_file_cut_anywhere_has_all_its_complete_chunks(
    share: float, sound: tuple[bytes, list[Any], list[int]], tmp_path_factory: Any
) -> None:
    data, rows, ends = sound
    size = int(share * len(data))
    path = tmp_path_factory.mktemp("torn") / "torn.mcap"
    path.write_bytes(data[:size])
    complete = sum(end <= size for end in ends)
    found = left(path)
    assert len(found) >= min(complete * 20 * PER_SAMPLE, len(rows)) - (complete == 5)
    assert found == rows[: len(found)]


@given(share=st.floats(0.0, 1.0, exclude_max=True), value=st.integers(1, 255), torn=st.booleans())
@example(share=0.08625533546313657, value=1, torn=False)  # the topic of a channel record
@example(share=0.08625533546313657, value=1, torn=True)
@examples(25)
def test_one_flipped_byte_anywhere_never_makes_a_false_message(
    share: float, value: int, torn: bool, sound: tuple[bytes, list[Any], list[int]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:  # fmt: skip
    data = bytearray(sound[0])
    data[int(share * len(data))] ^= value
    path = tmp_path_factory.mktemp("flipped") / "flipped.mcap"
    path.write_bytes(data[: len(data) - torn])
    found = left(path)
    assert found == sound[1][: len(found)]


@pytest.mark.long
def test_no_byte_of_a_torn_file_makes_a_false_message_when_flipped(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap", n=3)
    rows, data = raw(whole), whole.read_bytes()
    stop = chunk_places(whole)[-1][1]  # the summary is lost: nothing settles what a number means
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
    sound: tuple[bytes, list[Any], list[int]], tmp_path: Path
) -> None:
    data = bytearray(sound[0])
    numbers = {}
    for topic in (b"/yawid/sample", b"/yawid/modes"):
        name = len(topic).to_bytes(4, "little") + topic
        numbers[topic] = slice(data.index(name) - 4, data.index(name) - 2)
    data[numbers[b"/yawid/modes"]] = data[numbers[b"/yawid/sample"]]
    (tmp_path / "a.mcap").write_bytes(data)
    assert left(tmp_path / "a.mcap") == []


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    (folder / "a.tlog").write_bytes(FLIGHT)
    return replayed(folder / "a.tlog", folder, "--rate", 10, "--memory", "inf")


@pytest.fixture(scope="module")
def torn(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two thirds of the run, as kill -9 leaves it."""
    data = whole.read_bytes()
    path = tmp_path_factory.mktemp("torn") / "a.mcap.part"
    path.write_bytes(data[: 2 * len(data) // 3])
    return path


def test_it_is_replayed_as_the_same_stretch_of_the_whole_run_and_is_no_answer(
    whole: Path, torn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = open_torn(torn, SourceError("why"))
    times = np.concatenate([samples.boot_us for samples in run.samples()]) / 1e6
    assert run.config == open_run(whole).config
    assert 100 < run.rows == len(times) < open_run(whole).rows
    order = ["replay", str(torn), "--orders", "2,2,2,1", "--out", str(tmp_path), "--json"]

    assert main(order) == 130
    again = printed("replay", capsys.readouterr().out)
    assert (tmp_path / "a.mcap").exists()
    to = [order[0], str(whole), *order[2:], "--to", str(times[-1]), "--force"]
    main([*to[:5], str(tmp_path / "direct"), *to[6:]])
    direct = printed("replay", capsys.readouterr().out)

    assert again["estimates"] == direct["estimates"]
    assert again["manoeuvres"] == direct["manoeuvres"]
    first = again["verdict"]["reasons"][0]
    assert (first["id"], again["verdict"]["usable"]) == ("interrupted", False)
    assert f"a.mcap.part was cut off or is damaged: it has {run.rows} samples" in first["text"]


def test_a_run_damaged_in_its_middle_is_read_up_to_there(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(whole.read_bytes())
    start, end = chunk_places(whole)[7]
    data[(start + end) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)

    assert main(["replay", str(tmp_path / "bad.mcap"), "--out", str(tmp_path / "out")]) == 130
    assert "interrupted: bad.mcap was cut off or is damaged" in capsys.readouterr().out
    rows = open_torn(tmp_path / "bad.mcap", SourceError("why")).rows
    assert 60 < rows < open_run(whole).rows / 2


@pytest.mark.parametrize("command", ["report", "view", "export", "damper"])
def test_other_commands_send_to_a_replay(
    torn: Path, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = {"view": ["--out", str(tmp_path / "v.rrd")], "damper": [],
          "export": ["-o", str(tmp_path / "r.csv")]}  # fmt: skip
    assert main([command, str(torn), *to.get(command, ["-o", str(tmp_path / "r.html")])]) == 6
    [line] = capsys.readouterr().err.splitlines()
    assert "yawid replay of this file reads what is left of it" in line
    assert not list(tmp_path.iterdir())


def test_a_file_without_a_sample_is_one_line_that_sends_to_the_log(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = whole.read_bytes()
    at = data.index(b"configuration")
    for content in (data[:2000], data[:at] + b"X" + data[at + 1 : 2 * len(data) // 3]):
        (tmp_path / "bad.mcap").write_bytes(content)
        assert main(["replay", str(tmp_path / "bad.mcap"), "--out", str(tmp_path / "out")]) == 6
        [line] = capsys.readouterr().err.splitlines()
        assert "replay its log again" in line
    with pytest.raises(SourceError):
        FinishedRun(tmp_path / "none.mcap")
