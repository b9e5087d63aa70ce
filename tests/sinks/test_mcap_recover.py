from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from sinks.mcap_reading import decoded, raw
from sinks.sink_blocks import (
    METHODS,
    PARAMETERS,
    SAMPLE_TIME_S,
    VERDICT,
    make_blocks,
    script_environment,
)

from yawid.errors import SinkError
from yawid.sinks.mcap_file import McapSink
from yawid.sinks.recover import recover

Row = tuple[str, int, int, int, bytes]
PER_SAMPLE = 4  # messages: sample, two estimates, modes


def write_file(path: Path, n: int = 100) -> Path:
    sink = McapSink(path, {"configuration": {"rate": 20.0}})
    sink.start(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S)
    sink.write(*make_blocks(n=n))
    sink.finish({"verdict": VERDICT}, {"summary.json": b"{}"})
    return path


def chunk_places(path: Path) -> list[tuple[int, int]]:
    """Start and end of each chunk record in the file."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [
        (c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in summary.chunk_indexes
    ]


WRITER = """
import sys
from pathlib import Path
from sinks.sink_blocks import METHODS, PARAMETERS, SAMPLE_TIME_S, cut, make_blocks
from yawid.sinks.mcap_file import McapSink
sink = McapSink(Path(sys.argv[1]), {"configuration": {"rate": 20.0}})
sink.start(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S)
n = int(sys.argv[2])
for block in cut(make_blocks(n=n), list(range(n))):
    sink.write(*block)
print("written", flush=True)
sys.stdin.read()
"""


def test_kill_9_loses_at_most_a_second(tmp_path: Path) -> None:
    n = 317
    path = tmp_path / "a.mcap"
    with subprocess.Popen(
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
    counts = recover(part, path)  # the natural name: its own .part is the file to be recovered
    written = make_blocks(n=n)[0].unix_ns
    found = [message.log_time for message, _ in decoded(path)["/yawid/sample"]]
    assert found == written[: len(found)].tolist()
    assert written[-1] - found[-1] <= 1_000_000_000
    topics = ("/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes")
    assert counts == dict.fromkeys(topics, len(found))
    assert part.exists()


@settings(max_examples=40, deadline=None)
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
        with pytest.raises(SinkError, match="nothing recovered"):
            recover(folder / "torn.mcap", folder / "out.mcap")
        assert not (folder / "out.mcap").exists()
        return
    recover(folder / "torn.mcap", folder / "out.mcap")
    expected = min(complete * 20 * PER_SAMPLE, len(rows))
    found = raw(folder / "out.mcap")
    assert len(found) >= expected - (complete == 5)  # the verdict is in the last chunk
    assert found == rows[: len(found)]


def test_a_damaged_chunk_is_left_out_and_the_others_stay(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap")
    rows, data = raw(whole), bytearray(whole.read_bytes())
    start, end = chunk_places(whole)[2]
    data[(start + end) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)
    recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    chunk = 20 * PER_SAMPLE
    assert raw(tmp_path / "out.mcap") == rows[: 2 * chunk] + rows[3 * chunk :]


@pytest.mark.parametrize("at", [-1, -8], ids=["a letter of its topic", "its number"])
def test_a_channel_whose_record_is_damaged_costs_messages_and_makes_no_false_ones(
    tmp_path: Path, at: int
) -> None:
    whole = write_file(tmp_path / "whole.mcap")
    rows, data = raw(whole), bytearray(whole.read_bytes())
    topic = data.index(b"/yawid/estimate/rml")
    data[topic + (at if at == -8 else len("/yawid/estimate/rml") + at)] ^= 1  # number 5 becomes 4
    (tmp_path / "bad.mcap").write_bytes(data)
    recover(tmp_path / "bad.mcap", tmp_path / "out.mcap")
    found = raw(tmp_path / "out.mcap")
    assert found
    lost = {"/yawid/estimate/rml"} if at == -1 else {"/yawid/estimate/rml", "/yawid/estimate"}
    assert found == [row for row in rows if row[0] not in lost]


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0.0, 1.0, exclude_max=True), value=st.integers(1, 255))
def test_one_flipped_byte_anywhere_never_makes_a_false_message(
    share: float, value: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("flipped")
    whole = write_file(folder / "whole.mcap")
    rows, data = raw(whole), bytearray(whole.read_bytes())
    data[int(share * len(data))] ^= value
    (folder / "bad.mcap").write_bytes(data)
    with contextlib.suppress(SinkError):
        recover(folder / "bad.mcap", folder / "out.mcap")
        assert Counter(raw(folder / "out.mcap")) <= Counter(rows)


def test_a_sound_file_is_copied_whole(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.mcap")
    counts = recover(whole, tmp_path / "out.mcap")
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
    with pytest.raises(SinkError, match="nothing recovered") as caught:
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
