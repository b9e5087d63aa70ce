from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from sinks.mcap.mcap_reading import decoded, open_sink, raw, write_file
from sinks.sink_blocks import (
    SUMMARY,
    cut,
    make_blocks,
    make_manoeuvre,
    run_script,
)

from yawid.errors import SinkError
from yawid.sinks.base import Abort, Done, Flush, Found, RunRows
from yawid.sinks.mcap.sink import McapSink


@given(edges=st.lists(st.integers(1, 59)))
def test_the_way_a_stream_is_cut_into_blocks_does_not_show(
    edges: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("cuts")
    blocks = make_blocks(n=60)
    whole, parts = folder / "whole.mcap", folder / "parts.mcap"
    write_file(whole, blocks)
    write_file(parts, blocks, edges)
    assert parts.read_bytes() == whole.read_bytes()


def test_the_messages_of_a_topic_are_together_in_each_chunk_of_a_second(tmp_path: Path) -> None:
    topics = [topic for topic, *_ in raw(write_file(tmp_path / "a.mcap", make_blocks(n=24)))]
    row = ["/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes"]
    first, second = ([topic for topic in row for _ in range(n)] for n in (20, 4))
    assert topics == [*first, "/yawid/mode", "/yawid/verdict", *second]
    numbers = [n for topic, *_, n, _ in raw(tmp_path / "a.mcap") if topic == "/yawid/modes"]
    assert numbers == list(range(24))


@pytest.mark.parametrize("edges", [[], list(range(60)), [2, 20, 41]])
def test_the_flight_mode_stands_by_name_wherever_it_changes_however_blocks_are_cut(
    tmp_path: Path, edges: list[int]
) -> None:
    samples, estimates, modes = make_blocks(n=60)
    mode = np.zeros(60)
    mode[:2], mode[20:41], mode[50] = np.nan, 10.0, 77.0
    samples = replace(samples, mode=mode)
    found = decoded(write_file(tmp_path / "a.mcap", (samples, estimates, modes), edges))
    told = [(round(1e6 * each.boot_time), each.name) for _, each in found["/yawid/mode"]]
    names = ["unknown", "MANUAL", "AUTO", "MANUAL", "mode 77", "MANUAL"]
    rows = [0, 2, 20, 41, 50, 51]
    assert told == list(zip(samples.boot_us[rows].tolist(), names, strict=True))
    assert [m.log_time for m, _ in found["/yawid/mode"]] == samples.unix_ns[rows].tolist()
    assert [each.custom_mode for _, each in found["/yawid/mode"]][1:] == [0, 10, 0, 77, 0]
    with (tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    spans = [c.message_end_time - c.message_start_time for c in summary.chunk_indexes]
    assert max(spans) < 1_000_000_000
    write_file(tmp_path / "b.mcap", (samples, estimates, modes))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_no_chunk_is_longer_than_a_second_and_none_is_one_sample(tmp_path: Path) -> None:
    n = 205
    path = write_file(tmp_path / "a.mcap", make_blocks(n=n))
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    assert all(c.message_end_time - c.message_start_time < 1_000_000_000 for c in chunks)
    assert len(chunks) == -(-n // 20)
    assert {c.compression for c in chunks} == {"zstd"}


def written_with_manoeuvres(path: Path) -> Path:
    """A hundred samples; the first of two manoeuvres is told 2 s late, as in a live session."""
    blocks = make_blocks(n=100)
    sink = open_sink(path)
    for i, block in enumerate(cut(blocks, [70])):
        sink.take(RunRows(*block))
        rows = (30, 50) if i else (5, 30)
        sink.take(Found(*make_manoeuvre(blocks[0], *rows, n=i + 1)))
    sink.take(Done(SUMMARY, {}))
    return path


def test_a_manoeuvre_told_late_stands_behind_newer_samples_and_is_read_at_its_own_time(
    tmp_path: Path,
) -> None:
    path = written_with_manoeuvres(tmp_path / "a.mcap")
    ends_ns = make_blocks(n=100)[0].unix_ns[[30, 50]].tolist()
    rows = raw(path)
    assert [time for topic, time, *_ in rows if topic == "/yawid/manoeuvre"] == ends_ns
    assert [topic for topic, *_ in rows].index("/yawid/manoeuvre") == 1 + 4 * 70
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        times = [m.log_time for _, _, m in reader.iter_messages()]
        assert times == sorted(times)
        assert len(times) == len(rows)
        at_its_time = reader.iter_messages(starting_at=ends_ns[0], ending_before=ends_ns[0] + 1)
        assert sorted(channel.topic for _, channel, _ in at_its_time) == [
            "/yawid/estimate", "/yawid/estimate/rml", "/yawid/manoeuvre", "/yawid/modes",
            "/yawid/sample",
        ]  # fmt: skip
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    spans = [c.message_end_time - c.message_start_time for c in summary.chunk_indexes]
    assert max(spans) < 1_000_000_000
    assert spans.count(0) == 3  # each manoeuvre has a chunk of its own; the verdict is alone too
    sample_ns = make_blocks(n=100)[0].unix_ns
    found = summary.statistics.message_start_time, summary.statistics.message_end_time
    assert found == (sample_ns[0], sample_ns[-1])


def test_manoeuvres_never_go_back_in_time_though_the_clock_may(tmp_path: Path) -> None:
    samples, *_ = make_blocks()
    sink = open_sink(tmp_path / "a.mcap")
    for n, (first, last) in enumerate([(20, 60), (10, 40), (50, 90)], start=1):
        sink.take(Found(*make_manoeuvre(samples, first, last, n)))
    sink.take(Done(SUMMARY, {}))
    found = decoded(tmp_path / "a.mcap")["/yawid/manoeuvre"]
    assert [m.log_time for m, _ in found] == samples.unix_ns[[60, 60, 90]].tolist()
    assert [each.n for _, each in found] == [1, 2, 3]


def test_a_run_without_manoeuvres_has_no_topic_of_them(tmp_path: Path) -> None:
    with write_file(tmp_path / "a.mcap", make_blocks(n=5)).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert "/yawid/manoeuvre" not in {channel.topic for channel in summary.channels.values()}


def test_a_run_without_a_grid_still_leaves_its_verdict(tmp_path: Path) -> None:
    McapSink(tmp_path / "a.mcap", {}).take(Done(SUMMARY, {}))
    assert decoded(tmp_path / "a.mcap").keys() == {"/yawid/verdict"}


def test_an_aborted_run_leaves_an_indexed_part(tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.mcap")
    sink.take(RunRows(*make_blocks(n=30)))
    sink.take(Abort())
    assert not (tmp_path / "a.mcap").exists()
    assert len(decoded(tmp_path / "a.mcap.part")["/yawid/sample"]) == 30
    sink.take(Abort())  # twice does no harm


def test_flush_makes_the_last_sample_readable_in_the_open_file(tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.mcap")
    sink.take(RunRows(*make_blocks(n=3)))
    sink.take(Flush())
    found = []
    with (tmp_path / "a.mcap.part").open("rb") as stream, contextlib.suppress(EndOfFile):
        for _, channel, _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
            found.append(channel.topic)
    sink.take(Abort())
    assert found.count("/yawid/modes") == 3


def test_flushing_after_every_sample_does_not_make_a_chunk_of_each(tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.mcap")
    begin = time.monotonic()
    for block in cut(make_blocks(n=200), list(range(200))):
        sink.take(RunRows(*block))
        sink.take(Flush())
    sink.take(Done(SUMMARY, {}))
    by_wall_time = (time.monotonic() - begin) / 0.5 + 1
    with (tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) <= 10 + by_wall_time + 1


def occupied(folder: Path, how: str) -> Path:
    """A path that cannot be written, and why."""
    match how:
        case "exists":
            (folder / "a.mcap").write_bytes(b"precious")
        case "part exists":
            (folder / "a.mcap.part").write_bytes(b"precious")
        case "folder":
            (folder / "a.mcap").mkdir()
        case "no folder":
            return folder / "missing" / "a.mcap"
        case "file for folder":
            (folder / "file").write_bytes(b"precious")
            return folder / "file" / "a.mcap"
    return folder / "a.mcap"


@pytest.mark.parametrize("how", ["exists", "part exists", "folder", "no folder", "file for folder"])
def test_a_path_that_cannot_be_written_is_one_line_and_costs_nothing(
    tmp_path: Path, how: str
) -> None:
    path = occupied(tmp_path, how)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(SinkError, match=str(path)) as caught:
        McapSink(path, {})
    assert "\n" not in str(caught.value)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("how", ["exists", "part exists"])
def test_force_overwrites_but_only_when_finished(tmp_path: Path, how: str) -> None:
    path = occupied(tmp_path, how)
    sink = McapSink(path, {}, force=True)
    if how == "exists":
        assert path.read_bytes() == b"precious"
    sink.take(Done(SUMMARY, {}))
    assert decoded(path).keys() == {"/yawid/verdict"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_disk_that_is_full_from_the_start_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.part").symlink_to("/dev/full")
    with pytest.raises(SinkError, match=r"a\.mcap\.part: No space left on device$"):
        McapSink(tmp_path / "a.mcap", {}, force=True)
    assert list(tmp_path.iterdir()) == []


DISK_FILLS_UP = """
import resource, sys
from pathlib import Path
from sinks.sink_blocks import GRID, SUMMARY, make_blocks
from yawid.errors import SinkError
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.base import Abort, Done, Flush, Found, RunRows
sink = McapSink(Path(sys.argv[1]), {})
sink.take(GRID)
resource.setrlimit(resource.RLIMIT_FSIZE, (8000, resource.RLIM_INFINITY))
sink.take(RunRows(*make_blocks(n=19)))
try:
    match sys.argv[2]:
        case "write": sink.take(RunRows(*make_blocks(n=1000)))
        case "flush": sink.take(Flush())
        case "finish": sink.take(Done(SUMMARY, {}))
except SinkError as error:
    print(error)
sink.take(Abort())
"""


@pytest.mark.parametrize("moment", ["write", "flush", "finish"])
def test_a_disk_that_fills_up_is_one_line_and_abort_is_quiet(tmp_path: Path, moment: str) -> None:
    """A process may not write more than 8 kB to a file: the system refuses as a full disk does."""
    path = tmp_path / "a.mcap"
    done = run_script(DISK_FILLS_UP, str(path), moment)
    assert done.stdout == f"cannot write {path}.part: File too large\n"
    assert done.stderr == ""
    assert not path.exists()
