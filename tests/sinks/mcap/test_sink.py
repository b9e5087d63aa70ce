"""In which order and chunks a file is written: rows, manoeuvres, lateral motion, and its index."""

from __future__ import annotations

import contextlib
import time
import tracemalloc
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from finished_runs import replayed
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from places import C172P
from sinks.mcap.mcap_reading import decoded, open_sink, raw, spans_ns, summary_of, write_file
from sinks.sink_blocks import SUMMARY, cut, make_blocks, make_manoeuvre

from yawid.blocks import MotionBlock, SampleBlock
from yawid.sinks.base import Abort, Done, Flush, Found, RunRows
from yawid.sinks.mcap.chunks import ChunkWriter
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.mcap.schemas import MOTION

ROW = ("/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes", "/yawid/sample")


def test_the_flight_mode_stands_by_name_wherever_it_changes(tmp_path: Path) -> None:
    """It is not known at first."""
    samples, *_ = blocks = make_blocks(n=60)
    samples.mode[:] = 0.0
    samples.mode[:2], samples.mode[20:41], samples.mode[50] = np.nan, 10.0, 77.0
    found = decoded(write_file(tmp_path / "a.mcap", blocks))["/yawid/mode"]
    names = ["unknown", "MANUAL", "AUTO", "MANUAL", "mode 77", "MANUAL"]
    rows = [0, 2, 20, 41, 50, 51]
    told = [(round(1e6 * each.boot_time), each.name) for _, each in found]
    assert told == list(zip(samples.boot_us[rows].tolist(), names, strict=True))
    assert [m.log_time for m, _ in found] == samples.unix_ns[rows].tolist()
    assert [each.custom_mode for _, each in found][1:] == [0, 10, 0, 77, 0]
    assert max(spans_ns(tmp_path / "a.mcap")) < 1_000_000_000


def test_no_chunk_is_longer_than_a_second_none_is_one_sample_and_a_topic_is_together_in_it(
    tmp_path: Path,
) -> None:
    path = write_file(tmp_path / "a.mcap", make_blocks(n=204))
    chunks, kept = summary_of(path).chunk_indexes, raw(path)
    row = ["/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes"]
    of_a_second, last = ([topic for topic in row for _ in range(n)] for n in (20, 4))
    assert [topic for topic, *_ in kept][-4 * 24 - 1 :] == [
        *of_a_second, "/yawid/verdict", *last,
    ]  # fmt: skip
    assert [n for topic, *_, n, _ in kept if topic == "/yawid/modes"] == list(range(204))
    assert max(spans_ns(path)) < 1_000_000_000
    assert (len(chunks), {c.compression for c in chunks}) == (11, {"zstd"})
    topics = {channel.topic for channel in summary_of(path).channels.values()}
    assert "/yawid/manoeuvre" not in topics


def test_a_manoeuvre_told_late_stands_behind_newer_samples_and_is_read_at_its_own_time(
    tmp_path: Path,
) -> None:
    path, blocks = tmp_path / "a.mcap", make_blocks(n=100)
    sink, sample_ns = open_sink(path), blocks[0].unix_ns
    for n, (block, rows) in enumerate(zip(cut(blocks, [70]), [(5, 30), (30, 50)], strict=True), 1):
        sink.take(RunRows(*block))
        sink.take(Found(*make_manoeuvre(blocks[0], *rows, n)))  # 2 s late, as in a live session
    sink.take(Done(SUMMARY, {}))
    rows, end_ns = raw(path), int(sample_ns[30])
    ends_ns = [time for topic, time, *_ in rows if topic == "/yawid/manoeuvre"]
    assert ends_ns == [end_ns, sample_ns[50]]
    assert [topic for topic, *_ in rows].index("/yawid/manoeuvre") == 1 + 4 * 70
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        times = [m.log_time for _, _, m in reader.iter_messages()]
        at_its_time = reader.iter_messages(starting_at=end_ns, ending_before=end_ns + 1)
        found = sorted(channel.topic for _, channel, _ in at_its_time)
    assert (times, len(times)) == (sorted(times), len(rows))
    assert found == sorted([*ROW, "/yawid/manoeuvre"])
    assert max(spans_ns(path)) < 1_000_000_000
    assert spans_ns(path).count(0) == 3  # each manoeuvre has a chunk of its own, as the verdict
    statistics = summary_of(path).statistics
    span_ns = statistics.message_start_time, statistics.message_end_time
    assert span_ns == (sample_ns[0], sample_ns[-1])


def test_flush_makes_the_last_sample_readable_and_not_a_chunk_of_each(tmp_path: Path) -> None:
    sink, found, begin_s = open_sink(tmp_path / "a.mcap"), [], time.monotonic()
    for n, block in enumerate(cut(make_blocks(n=200), list(range(200)))):
        sink.take(RunRows(*block))
        sink.take(Flush())
        if n == 0:
            part = (tmp_path / "a.mcap.part").open("rb")
            with part as stream, contextlib.suppress(EndOfFile):
                for _, channel, _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    found.append(channel.topic)
    sink.take(Abort())
    by_wall_time = (time.monotonic() - begin_s) / 0.5 + 1
    assert set(ROW) <= set(found)
    assert len(summary_of(tmp_path / "a.mcap.part").chunk_indexes) <= 10 + by_wall_time + 1


SECOND_NS = 1_000_000_000
CHUNKS = 1_500


def test_the_index_of_a_long_run_that_waits_in_memory_takes_a_few_megabytes_a_day(
    tmp_path: Path,
) -> None:
    memory = []
    with (tmp_path / "long.mcap").open("wb") as stream:
        writer = ChunkWriter(stream, SECOND_NS)
        channel = writer.register_channel("/tick", "text", 0, {})
        tracemalloc.start()
        for second in range(CHUNKS):
            writer.add_message(channel, second * SECOND_NS, b"%d" % second)
            writer.end_chunk()
            memory.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert 0 < memory[-1] - memory[2 * CHUNKS // 3] < CHUNKS / 3 * 400


def test_motion_is_in_short_chunks_before_the_samples_it_is_for(tmp_path: Path) -> None:
    """That it is read back to the bit shows in a replay of the run (runs/test_run_files.py)."""
    path, known_us = replayed(C172P, tmp_path, "--rate", 10), 0
    for each in open_run(path).samples_and_motion():
        if isinstance(each, MotionBlock) and len(each.commands):
            known_us = int(each.commands.t_us[-1])
        elif isinstance(each, SampleBlock):
            assert each.boot_us[-1] + 20_000 <= known_us
    counts = Counter(topic for topic, *_ in raw(path))
    assert min(counts[topic] for topic in MOTION[:2]) > 1000
    assert max(spans_ns(path)) < 2.5e9
    assert len(spans_ns(path)) < 2 * 120


def test_motion_before_from_and_after_to_is_left_out_but_for_a_second(tmp_path: Path) -> None:
    path = replayed(C172P, tmp_path, "--rate", 10, "--from", "50", "--to", "140")
    t_s = open_run(path).motion().attitude.t_us / 1e6

    assert (t_s[0], t_s[-1]) == (pytest.approx(49.0, abs=0.05), pytest.approx(141.0, abs=0.05))
    assert (t_s[0] >= 49.0, t_s[-1] <= 141.0) == (True, True)
