from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun_cli
from rerun.chunk import RrdReader
from sinks.sink_blocks import (
    METHODS,
    PARAMETERS,
    SAMPLE_TIME_S,
    START_NS,
    VERDICT,
    Blocks,
    cut,
    make_blocks,
)

from yawid.blocks import Status
from yawid.errors import SinkError
from yawid.sinks.rerun_sink import RerunSink

SUMMARY = {"verdict": VERDICT}
# The command beside the interpreter is a script that waits for this one.
VIEWER = str(Path(rerun_cli.__file__).with_name("rerun"))


def run(sink: RerunSink, blocks: Blocks, edges: list[int] | None = None) -> None:
    sink.log(START_NS, "info", "before the grid is known")
    sink.start(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S)
    for block in cut(blocks, edges or []):
        sink.write(*block)
        sink.flush()
    sink.log(int(blocks[0].unix_ns[5]), "warning", "gap of 3 s")
    sink.finish(SUMMARY, {})


def fail(text: str) -> None:
    pytest.fail(f"warned: {text}")


def save(path: Path, blocks: Blocks, edges: list[int] | None = None) -> Path:
    run(RerunSink("save", name="flight", warn=fail, path=path), blocks, edges)
    return path


def recorded(path: Path) -> dict[str, dict[str, Any]]:
    """Columns of each entity over time, its chunks joined in order of boot time."""
    entities: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if not chunk.is_static:
            columns = chunk.to_record_batch().to_pydict()
            entity = entities.setdefault(chunk.entity_path, {})
            for name, values in columns.items():
                entity.setdefault(name, []).extend(values)
    return entities


def statics(path: Path, entity: str, component: str) -> list[Any]:
    return [
        chunk.to_record_batch().to_pydict()[component][-1]
        for chunk in RrdReader(path).stream().to_chunks()
        if chunk.is_static and chunk.entity_path == entity
    ]


def values(entities: dict[str, dict[str, Any]], entity: str) -> Any:
    columns = entities[entity]
    order = np.argsort(columns["boot_time"], kind="stable")
    return np.array(columns["Scalars:scalars"])[order]


def test_the_saved_recording_holds_every_sample_on_both_clocks(tmp_path: Path) -> None:
    samples, estimates, modes = make_blocks(n=2500)
    entities = recorded(save(tmp_path / "a.rrd", (samples, estimates, modes)))
    els = estimates["els"]
    live = els.status != Status.WARMING_UP
    yaw_rate = np.column_stack([samples.y, np.where(live, els.y_hat, np.nan)])
    np.testing.assert_array_equal(values(entities, "/input"), samples.u)
    np.testing.assert_array_equal(values(entities, "/yaw_rate"), yaw_rate)
    theta = np.where(live[:, None], els.theta, np.nan)
    np.testing.assert_array_equal(values(entities, "/parameters/theta"), theta)
    np.testing.assert_array_equal(values(entities, "/dutch_roll/wn")[:, 0], modes.dutch_roll[:, 0])
    status = np.column_stack([samples.held != 0, els.status])
    np.testing.assert_array_equal(values(entities, "/status"), status)
    boot = np.sort(np.array(entities["/input"]["boot_time"], "timedelta64[us]").astype(np.int64))
    np.testing.assert_array_equal(boot, samples.boot_us)
    unix = sorted(time.value for time in entities["/input"]["unix_time"])
    assert unix == samples.unix_ns.tolist()


def test_bands_are_two_sigma_on_either_side(tmp_path: Path) -> None:
    blocks = make_blocks(n=50)
    entities = recorded(save(tmp_path / "a.rrd", blocks))
    els = blocks[1]["els"]
    innovation = values(entities, "/innovation")
    np.testing.assert_array_equal(innovation[:, 0], els.innovation)
    np.testing.assert_allclose(innovation[:, 1:], np.outer(els.noise_std, [-2, 2]))
    wn, lower, upper = values(entities, "/dutch_roll/wn").T
    drawn = ~np.isnan(lower)
    np.testing.assert_allclose((upper - lower)[drawn], 4 * blocks[2].dutch_roll[drawn, 1])
    assert drawn.sum() > 10
    assert (lower[drawn] >= -wn[drawn]).all()


def test_lines_have_a_name_a_colour_and_a_unit(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=10))
    [names] = statics(path, "/parameters/theta", "SeriesLines:names")
    assert names == list(PARAMETERS)
    assert statics(path, "/input", "SeriesLines:names") == [["rudder [half travel]"]]
    for entity, columns in recorded(path).items():
        if "Scalars:scalars" in columns:
            [colours] = statics(path, entity, "SeriesLines:colors")
            assert len(colours) == len(columns["Scalars:scalars"][0])


def test_the_way_a_stream_is_cut_into_blocks_does_not_show(tmp_path: Path) -> None:
    blocks = make_blocks(n=60)
    whole = recorded(save(tmp_path / "a.rrd", blocks))
    parts = recorded(save(tmp_path / "b.rrd", blocks, list(range(60))))
    assert whole.keys() == parts.keys()
    for entity in whole:
        if "Scalars:scalars" in whole[entity]:
            np.testing.assert_array_equal(values(whole, entity), values(parts, entity))


def test_log_and_verdict_are_there_to_be_read(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=30))
    log = recorded(path)["/log"]
    assert log["TextLog:text"] == [["before the grid is known"], ["gap of 3 s"]]
    assert log["TextLog:level"] == [["INFO"], ["WARN"]]
    verdict = statics(path, "/verdict", "TextDocument:text")[-1][0]
    assert verdict.startswith("# Not usable\n")
    for reason in VERDICT["reasons"]:
        assert reason["text"] in verdict


def test_the_recording_brings_its_picture_along_and_rerun_accepts_it(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=30))
    reader = RrdReader(path)
    [blueprint] = reader.blueprints()
    origins = {
        origin
        for chunk in reader.stream(store=blueprint).to_chunks()
        for column in [chunk.to_record_batch().to_pydict()]
        for [origin] in column.get("ViewBlueprint:space_origin", [])
    }
    shown = {"/input", "/yaw_rate", "/innovation", "/parameters", "/status", "/verdict", "/log"}
    assert origins == shown | {"/dutch_roll/wn", "/dutch_roll/zeta"}
    subprocess.run([VIEWER, "rrd", "verify", str(path)], check=True, capture_output=True)


def test_the_file_bears_its_final_name_only_when_finished(tmp_path: Path) -> None:
    path, part = tmp_path / "a.rrd", tmp_path / "a.rrd.part"
    sink = RerunSink("save", name="flight", warn=fail, path=path)
    assert part.exists()
    assert not path.exists()
    sink.finish(SUMMARY, {})
    assert path.exists()
    assert not part.exists()


def test_an_aborted_recording_keeps_what_it_had(tmp_path: Path) -> None:
    sink = RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    sink.start(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S)
    sink.write(*make_blocks(n=30))
    sink.abort()
    assert not (tmp_path / "a.rrd").exists()
    assert len(values(recorded(tmp_path / "a.rrd.part"), "/input")) == 30


@pytest.mark.parametrize("how", ["exists", "no folder"])
def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path, how: str) -> None:
    path = tmp_path / "a.rrd" if how == "exists" else tmp_path / "missing" / "a.rrd"
    if how == "exists":
        path.write_bytes(b"precious")
    with pytest.raises(SinkError, match=str(path)) as caught:
        RerunSink("save", name="flight", warn=fail, path=path)
    assert "\n" not in str(caught.value)


DISK_FILLS_UP = """
import resource, sys
from pathlib import Path
from sinks.sink_blocks import METHODS, PARAMETERS, SAMPLE_TIME_S, VERDICT, make_blocks
from yawid.errors import SinkError
from yawid.sinks.rerun_sink import RerunSink
sink = RerunSink("save", name="flight", warn=print, path=Path(sys.argv[1]))
sink.start(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
try:
    sink.write(*make_blocks(n=3000))
    sink.finish({"verdict": VERDICT}, {})
except SinkError as error:
    print(error)
sink.abort()
"""


def test_a_disk_that_fills_up_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    done = subprocess.run(
        [sys.executable, "-c", DISK_FILLS_UP, str(path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith(f"cannot write {path}.part: ")
    assert len(done.stdout.splitlines()) == 1
    assert done.stderr == ""
    assert not path.exists()


@contextmanager
def viewer(*options: str) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Rerun's own receiver, without a window, on a free port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with subprocess.Popen(
        [VIEWER, *options, "--bind", "127.0.0.1", "--port", str(port)],
        env={**os.environ, "RUST_LOG": "info"},
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stderr is not None
        while b"Listening for gRPC" not in process.stderr.readline():
            assert process.poll() is None
        try:
            yield f"rerun+http://127.0.0.1:{port}/proxy", process
        finally:
            process.send_signal(signal.SIGINT)


def wait_for_rows(path: Path, n: int) -> dict[str, dict[str, Any]]:
    """What the other process has written once it holds ``n`` rows: it gives no sign of its own."""
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        try:
            entities = recorded(path)
        except (RuntimeError, ValueError):  # half a message at the end
            continue
        last = entities.get("/log", {}).get("TextLog:text", [])
        if len(last) == 2 and len(entities["/input"]["boot_time"]) == n:
            return entities
    pytest.fail(f"{path} does not hold {n} rows")


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # a receiver that still runs
def test_a_viewer_that_runs_already_gets_everything(tmp_path: Path) -> None:
    blocks = make_blocks(n=300)
    with viewer("--save", str(tmp_path / "got.rrd")) as (address, _):
        run(RerunSink(address, name="flight", warn=fail), blocks, [100, 101])
        entities = wait_for_rows(tmp_path / "got.rrd", 300)
    np.testing.assert_array_equal(values(entities, "/input"), blocks[0].u)
    assert entities["/log"]["TextLog:text"][-1] == ["gap of 3 s"]


def test_a_viewer_that_dies_is_one_warning_and_the_run_goes_on() -> None:
    warnings: list[str] = []
    blocks = make_blocks(n=300)
    with viewer("--serve-grpc") as (address, process):
        sink = RerunSink(address, name="flight", warn=warnings.append)
        sink.start(PARAMETERS, ("rudder",), METHODS, SAMPLE_TIME_S)
        sink.write(*blocks)
        sink.flush()
        assert warnings == []
        process.kill()
        process.wait()
        sink.write(*blocks)
        sink.log(START_NS, "info", "still flying")
        sink.finish(SUMMARY, {})
    [warning] = warnings
    assert "no Rerun viewer" in warning
    assert "\n" not in warning


def test_a_viewer_that_is_not_there_is_one_warning() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    warnings: list[str] = []
    sink = RerunSink(f"rerun+http://127.0.0.1:{port}/proxy", name="flight", warn=warnings.append)
    run(sink, make_blocks(n=30))
    sink.abort()
    assert len(warnings) == 1
    assert "Connection refused" in warnings[0]


def test_an_address_that_is_none_is_one_warning() -> None:
    warnings: list[str] = []
    run(RerunSink("somewhere", name="flight", warn=warnings.append), make_blocks(n=30))
    assert len(warnings) == 1


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
def test_a_machine_without_a_screen_is_one_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    warnings: list[str] = []
    run(RerunSink("spawn", name="flight", warn=warnings.append), make_blocks(n=30))
    assert len(warnings) == 1
    assert "no screen" in warnings[0]


def test_rerun_and_mcap_are_loaded_only_by_those_who_use_them() -> None:
    script = (
        "import sys, yawid.sinks.base, yawid.sinks.rerun_sink\n"
        "assert not {'rerun', 'mcap', 'google.protobuf'} & sys.modules.keys()\n"
        "import yawid.sinks.mcap_file, yawid.sinks.recover\n"
        "assert 'rerun' not in sys.modules"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", script], env=environment, check=True)
