"""The index at the end of a long run's file: complete, and never kept in memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from mcap.reader import make_reader

from yawid.sinks.mcap.chunks import ChunkWriter

SECOND_NS = 1_000_000_000
CHUNKS = 3_000


def write_chunks(path: Path, chunks: int) -> list[int]:
    """Write a chunk of two messages each second; return the memory taken at four moments."""
    memory = []
    with path.open("wb") as stream:
        writer = ChunkWriter(stream, SECOND_NS)
        writer.start("test")
        schema = writer.register_schema("none", "", b"")
        channel = writer.register_channel("/tick", "text", schema, {})
        tracemalloc.start()
        for second in range(chunks):
            for part in (0, 500_000_000):
                writer.add_message(channel, second * SECOND_NS + part, b"%d" % second)
            writer.end_chunk()
            if second * 4 % (3 * chunks // 2) == 0 or second == chunks - 1:
                memory.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        writer.finish()
    return memory


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int]]:
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    return path, write_chunks(path, CHUNKS)


def test_every_chunk_of_a_long_run_is_in_the_index_and_found_by_its_time(
    written: tuple[Path, list[int]],
) -> None:
    with written[0].open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert (summary.statistics.chunk_count, summary.statistics.message_count) == (
            CHUNKS,
            2 * CHUNKS,
        )
        starts = [chunk.message_start_time for chunk in summary.chunk_indexes]
        assert starts == [second * SECOND_NS for second in range(CHUNKS)]
        for second in (0, 1_234, CHUNKS - 1):
            begin = second * SECOND_NS
            found = reader.iter_messages(starting_at=begin, ending_before=begin + SECOND_NS)
            assert [message.data for _, _, message in found] == [b"%d" % second] * 2


def test_the_index_takes_the_memory_of_a_few_megabytes_a_day(
    written: tuple[Path, list[int]],
) -> None:
    *_, after_two_thirds, at_the_end = written[1]
    assert at_the_end - after_two_thirds < CHUNKS / 3 * 400


def test_nothing_is_left_beside_the_file(written: tuple[Path, list[int]]) -> None:
    assert [path.name for path in written[0].parent.iterdir()] == ["long.mcap"]
