"""One list of checks over every sink: what the protocol promises, whatever the results go to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from case_table import TableSink
from drawn import examples
from hypothesis import given
from hypothesis import strategies as st
from sinks.mcap.mcap_reading import raw
from sinks.rerun.rerun_reading import fail, recorded
from sinks.sink_blocks import (
    GRID,
    START_NS,
    SUMMARY,
    Blocks,
    cut,
    make_blocks,
    make_manoeuvre,
)

from yawid.runs.live.guarded_sink import Guarded
from yawid.sinks.base import Abort, Done, Flush, Found, LogLine, RunRows, Sink
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.rerun.sink import RerunSink

ROWS = 60


class Kind(NamedTuple):
    """A sink to be checked: how it is opened on a file, and what it holds when finished."""

    open: Callable[[Path], Any]
    contents: Callable[[Any, Path], Any]
    writes_file: bool = True


def open_guarded(path: Path) -> Guarded:
    return Guarded(McapSink(path, {}), path.with_name(f"{path.name}.part"), fail)


def comparable(table: Any) -> list[Any]:
    """Numbers as a list; NaN, which is never equal to itself, as one that there is not."""
    return np.nan_to_num(table, nan=-1e9).tolist()


def rows_of_recording(path: Path) -> dict[str, list[str]]:
    """Rows as text, but for the ids and times of writing, which are the recording's own."""
    found = {}
    for entity, columns in recorded(path).items():
        names = sorted(name for name in columns if ":" in name or name == "unix_time")
        rows = zip(*(columns[name] for name in names), strict=True)
        found[entity] = sorted(str(row) for row in rows)
    return found


def by_topic(path: Path) -> list[Any]:
    """What was written; the order is kept on each topic, a flush changes it among topics."""
    return sorted(raw(path), key=lambda message: message[0])


KINDS = {
    "mcap": Kind(lambda path: McapSink(path, {}), lambda sink, path: by_topic(path)),
    "guarded mcap": Kind(open_guarded, lambda sink, path: by_topic(path)),
    "rerun": Kind(
        lambda path: RerunSink("save", name="flight", warn=fail, path=path),
        lambda sink, path: rows_of_recording(path),
    ),
    "table": Kind(lambda path: TableSink(), lambda sink, path: comparable(sink.rows), False),
}
FILES = [name for name, kind in KINDS.items() if kind.writes_file]
every_sink = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
every_file = pytest.mark.parametrize("kind", [KINDS[name] for name in FILES], ids=FILES)


def part_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.part")


def run(sink: Sink, blocks: Blocks, edges: list[int]) -> None:
    sink.take(LogLine(START_NS, "info", "before the grid is known"))
    sink.take(GRID)
    for block in cut(blocks, edges):
        sink.take(RunRows(*block))
        sink.take(Flush())
    for n, rows in enumerate([(10, 30), (31, 55)], start=1):
        sink.take(Found(*make_manoeuvre(blocks[0], *rows, n)))
    sink.take(LogLine(int(blocks[0].unix_ns[-1]), "warning", "the last line"))


@every_sink
def test_the_blocks_are_not_changed(kind: Kind, tmp_path: Path) -> None:
    blocks, before = make_blocks(n=ROWS), make_blocks(n=ROWS)
    sink = kind.open(tmp_path / "a")
    run(sink, blocks, [])
    sink.take(Done(SUMMARY, {}))
    for own, kept in zip(arrays(blocks), arrays(before), strict=True):
        np.testing.assert_array_equal(own, kept)


def arrays(blocks: Blocks) -> list[Any]:
    samples, estimates, modes = blocks
    parts = [samples, modes]
    found = [getattr(part, name) for part in parts for name in part.__slots__]
    return [*found, *(estimate.rows for estimate in estimates.values())]


@every_sink
@examples(10)
@given(edges=st.lists(st.integers(1, ROWS - 1), max_size=ROWS))
def test_the_contents_do_not_depend_on_how_the_stream_was_cut(
    kind: Kind, edges: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, blocks = tmp_path_factory.mktemp("cuts"), make_blocks(n=ROWS)
    found = []
    for name, where in (("whole", []), ("parts", edges)):
        sink = kind.open(folder / name)
        run(sink, blocks, where)
        sink.take(Done(SUMMARY, {}))
        found.append(kind.contents(sink, folder / name))
    assert found[0] == found[1]
    assert len(found[0])


@every_sink
def test_a_manoeuvre_is_the_same_however_late_it_is_told(kind: Kind, tmp_path: Path) -> None:
    blocks, found = make_blocks(n=ROWS), []
    for name, told in (("replay", 32), ("live", 57)):
        sink = kind.open(tmp_path / name)
        sink.take(GRID)
        for n, block in enumerate(cut(blocks, [told])):
            sink.take(RunRows(*block))
            if n == 0:
                sink.take(Found(*make_manoeuvre(blocks[0], 10, 30)))
        sink.take(Done(SUMMARY, {}))
        contents = kind.contents(sink, tmp_path / name)
        found.append(sorted(contents.items() if isinstance(contents, dict) else contents))
    assert found[0] == found[1]


@every_sink
def test_a_run_that_never_came_to_a_grid_is_finished_without_one(
    kind: Kind, tmp_path: Path
) -> None:
    sink = kind.open(tmp_path / "a")
    sink.take(LogLine(START_NS, "error", "no rudder"))
    sink.take(Flush())
    sink.take(Done(SUMMARY, {"summary.json": b"{}"}))
    assert (tmp_path / "a").exists() == kind.writes_file
    assert not part_of(tmp_path / "a").exists()


@every_sink
def test_aborting_twice_does_no_harm_and_gives_no_final_name(kind: Kind, tmp_path: Path) -> None:
    sink = kind.open(tmp_path / "a")
    run(sink, make_blocks(n=ROWS), [7])
    sink.take(Abort())
    sink.take(Abort())
    assert not (tmp_path / "a").exists()
    assert part_of(tmp_path / "a").exists() == kind.writes_file


@every_sink
def test_it_may_be_aborted_before_anything_was_written(kind: Kind, tmp_path: Path) -> None:
    kind.open(tmp_path / "a").take(Abort())
    assert not (tmp_path / "a").exists()


@every_file
def test_a_file_bears_its_final_name_only_when_finished(kind: Kind, tmp_path: Path) -> None:
    sink = kind.open(tmp_path / "a")
    run(sink, make_blocks(n=ROWS), [])
    assert part_of(tmp_path / "a").exists()
    assert not (tmp_path / "a").exists()
    sink.take(Done(SUMMARY, {}))
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("name", ["mcap", "rerun"])
def test_what_is_discarded_leaves_nothing_behind(name: str, tmp_path: Path) -> None:
    sink = KINDS[name].open(tmp_path / "a")
    run(sink, make_blocks(n=ROWS), [])
    sink.take(Abort(discard=True))
    sink.take(Abort(discard=True))
    assert list(tmp_path.iterdir()) == []
