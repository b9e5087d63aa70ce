"""One list of checks over every sink: what the protocol promises, whatever the results go to."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from drawn import examples
from hypothesis import given
from hypothesis import strategies as st
from sinks.mcap.mcap_reading import raw
from sinks.rerun.rerun_reading import fail, recorded
from sinks.sink_blocks import ROWS, START_NS, SUMMARY, Blocks, make_blocks, run, run_script

from yawid.errors import SinkError
from yawid.runs.live.guarded_sink import Guarded
from yawid.sinks.base import Abort, Done, Flush, LogLine
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.rerun.sink import RerunSink


class Kind(NamedTuple):
    """A sink to be checked: how it is opened on a file, and what it holds when finished."""

    open: Callable[..., Any]
    contents: Callable[[Path], Any]


def open_guarded(path: Path) -> Guarded:
    return Guarded(McapSink(path, {}), part_of(path), fail)


def open_rerun(path: Path, **options: bool) -> RerunSink:
    return RerunSink("save", name="flight", warn=fail, path=path, **options)


def rows_of_recording(path: Path) -> list[Any]:
    """Rows as text, but for the ids and times of writing, which are the recording's own."""
    found = []
    for entity, columns in recorded(path).items():
        names = sorted(name for name in columns if ":" in name or name == "unix_time")
        rows = zip(*(columns[name] for name in names), strict=True)
        found.append((entity, sorted(str(row) for row in rows)))
    return sorted(found)


def by_topic(path: Path) -> list[Any]:
    """What was written; the order is kept on each topic, a flush changes it among topics."""
    return sorted(raw(path), key=lambda message: message[0])


KINDS = {
    "mcap": Kind(lambda path, **more: McapSink(path, {}, **more), by_topic),
    "rerun": Kind(open_rerun, rows_of_recording),
    "guarded mcap": Kind(open_guarded, by_topic),
}
FILES = ["mcap", "rerun"]
every_sink = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
every_file = pytest.mark.parametrize("kind", [KINDS[name] for name in FILES], ids=FILES)


def part_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.part")


def finished(kind: Kind, path: Path, blocks: Blocks, *where: Any) -> Any:
    """Give a new sink a run to its end; return what it holds."""
    sink = kind.open(path)
    run(sink, blocks, *where)
    sink.take(Done(SUMMARY, {}))
    return kind.contents(path)


@every_sink
@examples(6)
@given(edges=st.lists(st.integers(1, ROWS - 1), max_size=ROWS), known=st.integers(56, ROWS))
def test_the_contents_do_not_depend_on_how_the_stream_was_cut_or_how_late_a_manoeuvre_is_known(
    kind: Kind, edges: list[int], known: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, blocks = tmp_path_factory.mktemp("cuts"), make_blocks(n=ROWS)
    whole = finished(kind, folder / "whole", blocks, [])
    assert len(whole)
    assert finished(kind, folder / "parts", blocks, edges, known) == whole
    assert {path.suffix for path in folder.iterdir()} <= {""}
    for own, kept in zip(arrays(blocks), arrays(make_blocks(n=ROWS)), strict=True):
        np.testing.assert_array_equal(own, kept)  # the blocks are not changed


def arrays(blocks: Blocks) -> list[Any]:
    samples, estimates, modes = blocks
    found = [getattr(part, name) for part in (samples, modes) for name in part.__slots__]
    return [*found, *(estimate.rows for estimate in estimates.values())]


@every_sink
def test_a_run_that_never_came_to_a_grid_is_finished_or_aborted_without_one(
    kind: Kind, tmp_path: Path
) -> None:
    kind.open(tmp_path / "none").take(Abort())
    sink = kind.open(tmp_path / "a")
    sink.take(LogLine(START_NS, "error", "no rudder"))
    sink.take(Flush())
    sink.take(Done(SUMMARY, {"summary.json": b"{}"}))
    names = [path.name for path in tmp_path.iterdir()]
    assert sorted(names) == ["a", "none.part"]


@pytest.mark.parametrize(
    ("name", "discard"), [*((each, False) for each in KINDS), *((each, True) for each in FILES)]
)
def test_aborting_twice_does_no_harm_and_keeps_nothing_or_all_but_the_verdict_under_no_final_name(
    name: str, discard: bool, tmp_path: Path
) -> None:
    kind = KINDS[name]
    sink, blocks = kind.open(tmp_path / "a"), make_blocks(n=ROWS)
    run(sink, blocks, [7])
    for event in (Flush(), Abort(discard), Abort(discard)):
        sink.take(event)
        stays = not (discard and isinstance(event, Abort))
        assert [path.name for path in tmp_path.iterdir()] == ["a.part"] * stays
    if stays:
        kept = kind.contents(part_of(tmp_path / "a"))
        lost = [each for each in finished(kind, tmp_path / "b", blocks, []) if each not in kept]
        assert [each[0] for each in lost] in ([], ["/yawid/verdict"])


IN_THE_WAY = {
    "a": lambda path: path.write_bytes(b"precious"),
    "a.part": lambda path: path.write_bytes(b"precious"),
    "a/": Path.mkdir,
    "missing/a": lambda path: None,
    "file/a": lambda path: path.parent.write_bytes(b"precious"),
}
"""What is in the way of a file, by the name that it is to have."""


@every_file
@pytest.mark.parametrize("what", IN_THE_WAY)
def test_a_path_that_cannot_be_written_is_one_line_and_costs_nothing_unless_forced(
    kind: Kind, what: str, tmp_path: Path
) -> None:
    IN_THE_WAY[what](tmp_path / what)
    path = tmp_path / what.removesuffix(".part")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(SinkError, match=str(path)) as caught:
        kind.open(path)
    assert "\n" not in str(caught.value)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    if what in ("a", "a.part"):
        sink = kind.open(path, force=True)
        assert what != "a" or path.read_bytes() == b"precious"  # until it is finished
        sink.take(Done(SUMMARY, {}))
        assert b"precious" != path.read_bytes() != b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_disk_that_is_full_from_the_start_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.part").symlink_to("/dev/full")
    with pytest.raises(SinkError, match=r"a\.mcap\.part: No space left on device$"):
        McapSink(tmp_path / "a.mcap", {}, force=True)
    assert list(tmp_path.iterdir()) == []


DISK_FILLS_UP = """
import sys
from pathlib import Path
from resource import RLIM_INFINITY, RLIMIT_FSIZE, setrlimit
from sinks.sink_blocks import GRID, SUMMARY, make_blocks
from yawid.errors import SinkError
from yawid.sinks.base import Abort, Done, Flush, RunRows
from yawid.sinks.mcap.sink import McapSink
from yawid.sinks.rerun.sink import RerunSink
EVENTS = {"rows": RunRows(*make_blocks(n=1200)), "flush": Flush(), "done": Done(SUMMARY, {})}
for name in sys.argv[2:]:
    path, (kind, last) = Path(sys.argv[1], name), name.split()
    to_viewer = {"name": "flight", "warn": print, "path": path}
    sink = McapSink(path, {}) if kind == "mcap" else RerunSink("save", **to_viewer)
    sink.take(GRID)
    setrlimit(RLIMIT_FSIZE, (8000, RLIM_INFINITY))
    try:
        sink.take(RunRows(*make_blocks(n=19)))
        sink.take(EVENTS[last])
    except SinkError as error:
        print(error)
    sink.take(Abort())
    setrlimit(RLIMIT_FSIZE, (RLIM_INFINITY, RLIM_INFINITY))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit there")
def test_a_disk_that_fills_up_is_one_line_and_abort_is_quiet(tmp_path: Path) -> None:
    """A process may not write more than 8 kB to a file: the system refuses as a full disk does.

    Rerun's own writer said that a flush had timed out, and the process then never ended.
    """
    moments = ["mcap rows", "mcap flush", "mcap done", "rerun rows", "rerun done"]
    done = run_script(DISK_FILLS_UP, str(tmp_path), *moments)
    said = [f"cannot write {tmp_path}/{name}.part: File too large" for name in moments]
    assert (done.stdout.splitlines(), done.stderr) == (said, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(f"{n}.part" for n in moments)
