from __future__ import annotations

import contextlib
import os
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
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.reader import make_reader
from sinks.mcap.mcap_reading import decoded, raw
from sinks.sink_blocks import (
    GRID,
    PARAMETERS,
    SUMMARY,
    cut,
    make_blocks,
    make_manoeuvre,
    script_environment,
)

from yawid.errors import SinkError
from yawid.sinks.base import Done, Found, RunRows
from yawid.sinks.mcap.recover import recover
from yawid.sinks.mcap.schemas import TOPICS, schema_data
from yawid.sinks.mcap.sink import McapSink

Row = tuple[str, int, int, int, bytes]
PER_SAMPLE = 4  # messages: sample, two estimates, modes


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


def chunk_topics(path: Path) -> list[set[str]]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    names = {number: channel.topic for number, channel in summary.channels.items()}
    return [{names[n] for n in chunk.message_index_offsets} for chunk in summary.chunk_indexes]


WRITER = """
import sys
from pathlib import Path
from sinks.sink_blocks import GRID, cut, make_blocks
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.base import Done, Found, RunRows
sink = McapSink(Path(sys.argv[1]), {"configuration": {"rate": 20.0}})
sink.take(GRID)
n = int(sys.argv[2])
for block in cut(make_blocks(n=n), list(range(n))):
    sink.take(RunRows(*block))
print("written", flush=True)
sys.stdin.read()
"""


def test_kill_9_loses_at_most_a_second(tmp_path: Path) -> None:
    n = 317
    path = tmp_path / "a.mcap"
    with child(
        [sys.executable, "-c", WRITER, str(path), str(n)],
        env=script_environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"written\n"
        writer.send_signal(signal.SIGKILL)
    part = path.with_name("a.mcap.part")
    assert part.exists()
    counts = recover(
        part, path
    ).counts  # the natural name: its own .part is the file to be recovered
    written = make_blocks(n=n)[0].unix_ns
    found = [message.log_time for message, _ in decoded(path)["/yawid/sample"]]
    assert found == written[: len(found)].tolist()
    assert written[-1] - found[-1] <= 1_000_000_000
    topics = ("/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes")
    assert counts == dict.fromkeys(topics, len(found)) | {"/yawid/mode": 1}
    assert part.exists()


@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_a_file_cut_anywhere_gives_all_its_complete_chunks(
    share: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    whole = write_file(folder / "whole.mcap")
    rows, data = raw(whole), whole.read_bytes()
    size = int(share * len(data))
    (folder / "torn.mcap").write_bytes(data[:size])
    complete = sum(end <= size for _, end in chunk_places(whole))
    if complete == 0:
        with pytest.raises(SinkError, match="nothing was recovered"):
            recover(folder / "torn.mcap", folder / "out.mcap")
        assert not (folder / "out.mcap").exists()
        return
    recover(folder / "torn.mcap", folder / "out.mcap")
    expected = min(complete * 20 * PER_SAMPLE, len(rows))
    found = raw(folder / "out.mcap")
    assert len(found) >= expected - (complete == 5)  # the verdict is in the last chunk
    assert found == rows[: len(found)]


def test_the_manoeuvres_of_a_torn_file_are_kept_and_a_damaged_one_is_left_out(
    tmp_path: Path,
) -> None:
    blocks = make_blocks(n=100)
    sink = McapSink(tmp_path / "whole.mcap", {"configuration": {"rate": 20.0}})
    sink.take(GRID)
    for i, block in enumerate(cut(blocks, [50])):
        sink.take(RunRows(*block))
        sink.take(Found(*make_manoeuvre(blocks[0], 40 * i, 40 * i + 35, n=i + 1)))
    sink.take(Done(SUMMARY, {"summary.json": b"{}"}))
    data = bytearray((tmp_path / "whole.mcap").read_bytes())
    first, second = (i for i, each in enumerate(chunk_topics(tmp_path / "whole.mcap"))
                     if each == {"/yawid/manoeuvre"})  # fmt: skip
    places = chunk_places(tmp_path / "whole.mcap")
    (tmp_path / "torn.mcap").write_bytes(data[: places[second][1]])
    recovered = recover(tmp_path / "torn.mcap", tmp_path / "out.mcap")
    assert recovered.counts["/yawid/manoeuvre"] == 2
    assert not recovered.left_out
    assert raw(tmp_path / "out.mcap") == raw(tmp_path / "whole.mcap")[:-1]  # without the verdict

    data[sum(places[first]) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)
    recovered = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap", force=True)
    assert recovered.counts["/yawid/sample"] == 100
    assert recovered.left_out == "1 x damaged chunk"
    [(_, kept)] = decoded(tmp_path / "out.mcap")["/yawid/manoeuvre"]
    assert kept.n == 2


def test_a_damaged_chunk_is_left_out_and_the_others_stay(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap")
    rows, data = raw(whole), bytearray(whole.read_bytes())
    start, end = chunk_places(whole)[2]
    data[(start + end) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)
    recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    chunk = 20 * PER_SAMPLE
    assert (
        raw(tmp_path / "out.mcap") == rows[: 1 + 2 * chunk] + rows[1 + 3 * chunk :]
    )  # first the mode


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    data = bytearray(write_file(tmp_path / "whole.mcap").read_bytes())
    start, end = chunk_places(tmp_path / "whole.mcap")[2]
    data[(start + end) // 2] ^= 0xFF
    at = data.index(b"/yawid/estimate/rml")
    data[at + 1] ^= 1
    (tmp_path / "bad.mcap").write_bytes(data[:-100])  # without the summary that would settle it
    found = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert "/yawid/estimate/rml" in found.counts  # the summary's copy of the record is whole
    data[data.index(b"/yawid/estimate/rml")] ^= 1
    (tmp_path / "bad.mcap").write_bytes(data[:-100])
    found = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap", force=True)
    assert set(found.counts) == {
        "/yawid/sample", "/yawid/estimate", "/yawid/modes", "/yawid/mode", "/yawid/verdict"
    }  # fmt: skip
    assert found.left_out == (
        "1 x damaged chunk, 2 x unknown or damaged channel record, 80 x message of no known channel"
    )


def false_messages(folder: Path, data: bytes, rows: Counter[Row]) -> Counter[Row]:
    """What recovering ``data`` gives that never was in the file."""
    (folder / "bad.mcap").write_bytes(data)
    with contextlib.suppress(SinkError):
        recover(folder / "bad.mcap", folder / "out.mcap", force=True)
        return Counter(raw(folder / "out.mcap")) - rows
    return Counter()


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, Counter[Any]]:
    """A file, and how often it has each of its messages."""
    path = write_file(tmp_path_factory.mktemp("intact") / "whole.mcap")
    return path.read_bytes(), Counter(raw(path))


@given(share=st.floats(0.0, 1.0, exclude_max=True), value=st.integers(1, 255), torn=st.booleans())
@example(share=0.08625533546313657, value=1, torn=False)  # the topic of a channel record
@example(share=0.08625533546313657, value=1, torn=True)
def test_one_flipped_byte_anywhere_never_makes_a_false_message(
    share: float,
    value: int,
    torn: bool,
    intact: tuple[bytes, Counter[Any]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    data, rows = bytearray(intact[0]), intact[1]
    data[int(share * len(data))] ^= value
    folder = tmp_path_factory.mktemp("flipped")
    assert not false_messages(folder, bytes(data[: len(data) - torn]), rows)


@pytest.mark.long
def test_no_byte_of_a_torn_file_makes_a_false_message_when_flipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "yawid.system.part_file.sync", lambda stream: None
    )  # thousands take minutes
    whole = write_file(tmp_path / "whole.mcap", n=3)
    rows, data = Counter(raw(whole)), whole.read_bytes()
    stop = chunk_places(whole)[-1][1]  # the summary is lost: nothing settles what a number means
    inside = np.zeros(stop, bool)  # of a schema, half of the file: each 16th byte will do
    for content in {schema_data(name, PARAMETERS) for name in TOPICS.values()}:
        for found in re.finditer(re.escape(content), data[:stop]):
            inside[slice(*found.span())] = np.arange(len(content)) % 16 > 0
    assert (~inside).sum() > 4000
    for at in np.flatnonzero(~inside).tolist():
        flipped = bytearray(data[:stop])
        flipped[at] ^= 1 << at % 8
        assert not false_messages(tmp_path, bytes(flipped), rows), at


def test_a_torn_file_of_another_version_gives_nothing_and_says_why(tmp_path: Path) -> None:
    data = write_file(tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "old.mcap").write_bytes(data[:-100].replace(b"boot_time", b"long_time"))
    with pytest.raises(SinkError, match=r"of another version of yawid.*nothing was recovered"):
        recover(tmp_path / "old.mcap", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_two_channels_that_claim_one_number_have_neither(tmp_path: Path) -> None:
    data = bytearray(write_file(tmp_path / "whole.mcap").read_bytes())
    stop = chunk_places(tmp_path / "whole.mcap")[-1][1]
    numbers = {}
    for topic in (b"/yawid/estimate/rml", b"/yawid/modes"):
        at = data.index(len(topic).to_bytes(4, "little") + topic)
        numbers[topic] = at - 4  # of the channel: its own and its schema's stand before its topic
    source, target = numbers.values()
    data[source : source + 2] = data[target : target + 2]
    (tmp_path / "bad.mcap").write_bytes(data[:stop])
    found = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    assert found.counts["/yawid/sample"] == 100
    assert found.counts.keys().isdisjoint({"/yawid/estimate/rml", "/yawid/modes"})
    assert found.left_out == "200 x message of no known channel"


def test_what_cannot_be_read_twice_is_refused(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(write)
    with pytest.raises(SinkError, match="must be a file"):
        recover(Path(f"/dev/fd/{read}"), tmp_path / "out.mcap")
    os.close(read)


def test_an_attachment_is_kept_only_as_it_was(tmp_path: Path) -> None:
    data = bytearray(write_file(tmp_path / "whole.mcap").read_bytes())
    data[data.index(b"summary.json") + len(b"summary.json") + 4 + 16 + 8] ^= 1
    (tmp_path / "bad.mcap").write_bytes(data)
    found = recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as stream:
        assert list(make_reader(stream).iter_attachments()) == []
    assert found.left_out == "1 x damaged attachment"


def test_what_was_recovered_can_be_torn_and_recovered_again(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap")
    recover(whole, tmp_path / "once.mcap")
    (tmp_path / "torn.mcap").write_bytes((tmp_path / "once.mcap").read_bytes()[:-20])
    recover(tmp_path / "torn.mcap", tmp_path / "twice.mcap")
    assert raw(tmp_path / "twice.mcap") == raw(whole)


def test_a_sound_file_is_copied_whole(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap")
    counts = recover(whole, tmp_path / "out.mcap").counts
    assert raw(tmp_path / "out.mcap") == raw(whole)
    assert counts["/yawid/verdict"] == 1
    assert sum(counts.values()) == len(raw(whole))
    with (tmp_path / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        assert [a.name for a in reader.iter_attachments()] == ["summary.json"]
        assert reader.get_header().library.endswith("(recovered)")
    assert records["configuration"] == {"rate": "20.0"}
    assert len(chunk_places(tmp_path / "out.mcap")) == len(chunk_places(whole))


@pytest.mark.parametrize(
    "content", [b"", b"not an MCAP at all", bytes(1000), b"\x89MCAP0\r\n" + b"\xff" * 64]
)
def test_what_was_never_an_mcap_is_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad").write_bytes(content)
    with pytest.raises(SinkError, match="nothing was recovered") as caught:
        recover(tmp_path / "bad", tmp_path / "out.mcap")
    assert "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["bad"]


def test_a_missing_file_and_a_folder_are_one_line_each(tmp_path: Path) -> None:
    with pytest.raises(SinkError, match=r"cannot read .*: No such file or directory$"):
        recover(tmp_path / "missing", tmp_path / "out.mcap")
    with pytest.raises(SinkError, match=r"cannot read .*: Is a directory$"):
        recover(tmp_path, tmp_path / "out.mcap")


def test_an_existing_output_is_kept_unless_forced(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap", n=10)
    out = tmp_path / "out.mcap"
    out.write_bytes(b"precious")
    with pytest.raises(SinkError, match=r"out\.mcap exists"):
        recover(whole, out)
    assert out.read_bytes() == b"precious"
    recover(whole, out, force=True)
    assert raw(out) == raw(whole)


def test_a_file_may_be_recovered_onto_itself(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap", n=10)
    rows = raw(whole)
    recover(whole, whole, force=True)
    assert raw(whole) == rows
