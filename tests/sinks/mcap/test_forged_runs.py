"""An MCAP that anybody may have written: replayed, shown and reported, or refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from forged_runs import forge
from hostile import FLIGHT
from mcap.writer import CompressionType, Writer

from yawid.cli.main import main
from yawid.sinks.mcap.messages import RowLayout
from yawid.sinks.mcap.schemas import descriptor

COMMANDS = (
    ("replay", "--out", "OUT"),
    ("view", "--out", "OUT.rrd"),
    ("report", "--out", "OUT.html"),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    (folder / "a.tlog").write_bytes(FLIGHT)
    return replayed(folder / "a.tlog", folder, "--rate", 10)


def codes(mcap: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> list[int]:
    """What each command ends with; one that refuses says so in one line and leaves nothing."""
    found = []
    for name, option, out in COMMANDS:
        target = out.replace("OUT", str(folder / "out"))
        found.append(main([name, str(mcap), option, target]))
        said = capsys.readouterr().err
        if found[-1] == 6:
            assert said.startswith(f"yawid: {mcap}")
            assert said.count("\n") == 1
            assert "what is left" not in said  # what was forged is not torn
            assert not list(folder.glob("out*"))
    return found


def with_(path: str, value: Any) -> Callable[[Any], Any]:
    """A summary with another value at a dotted path."""

    def change(summary: Any) -> Any:
        *before, last = path.split(".")
        inner = summary
        for name in before:
            inner = inner[int(name)] if isinstance(inner, list) else inner[name]
        inner[last] = value
        return summary

    return change


@pytest.mark.parametrize(
    "summary",
    [
        lambda summary: [],
        lambda summary: b"[" * 100_000,
        lambda summary: b"\xff",
        with_("verdict.usable", "yes"),
        with_("verdict.reasons", 3),
        with_("verdict.reasons", [{"id": "x"}]),
        with_("verdict.reasons.0.text", 1),
        with_("channels", []),
        with_("channels.yaw", "ATTITUDE"),
        with_("channels.yaw.rate_hz", "fast"),
        with_("channels.rudder.source", None),
        with_("link", 7),
        with_("source", "a.tlog"),
        with_("duration_s", float("nan")),
        with_("duration_s", 10**400),
        with_("estimates", []),
        with_("estimates.els.fit", None),
        with_("estimates.els.fit.one_step_pct", "good"),
        with_("estimates.els.orders", {}),
        with_("estimates.els.sample_time_s", 0),
        with_("estimates.els.theta", {"a1": "x"}),
        with_("estimates.els.dutch_roll", {"wn_rad_s": 0.0, "zeta": 0.1}),
        with_("estimates.els.modes", [{"kind": 1}]),
        with_("manoeuvres", {}),
        with_("manoeuvres", [{"n": 1}]),
        with_("flight", {"used": [1]}),
    ],
)
def test_a_summary_of_other_types_is_refused(
    run: Path, summary: Callable[[Any], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forged = forge(run, tmp_path / "f.mcap", summary=summary)
    assert codes(forged, tmp_path, capsys) == [6, 6, 6]


def test_a_refusal_names_the_key_and_what_it_must_be(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forged = forge(run, tmp_path / "f.mcap", summary=with_("channels.yaw.rate_hz", "fast"))
    assert main(["replay", str(forged), "--out", str(tmp_path)]) == 6
    assert "channels[...].rate_hz: Expected `float | null`, got `str`" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "unknown = 3",
        "orders = [1e400, 1, 1, 1]",
        "orders = [2, 2, 2, 1]",
        'inputs = ["rudder", "aileron"]',
        'method = "rml"',
        "from_s = " + "9" * 400,
        "band = " + "[" * 3000 + "]" * 3000,
        "what",
    ],
)
def test_a_configuration_that_is_not_the_runs_is_refused(
    run: Path, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(toml: str) -> str:
        kept = [old for old in toml.splitlines() if old.split(" =")[0] != line.split(" =")[0]]
        return "\n".join([*kept, line])

    assert codes(forge(run, tmp_path / "f.mcap", toml=change), tmp_path, capsys) == [6, 6, 6]


@pytest.mark.parametrize(
    ("name", "text"),
    [("inputs", "rudder aileron"), ("parameters", "a1"), ("methods", "els"), ("inputs", ""),
     ("sample_time_s", "nan"), ("sample_time_s", "1e-300"), ("sample_time_s", "x")],
)  # fmt: skip
def test_a_grid_that_does_not_fit_is_refused(
    run: Path, name: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(record: str, values: dict[str, str]) -> dict[str, str]:
        return values | {name: text} if record == "grid" else values

    assert codes(forge(run, tmp_path / "f.mcap", metadata=change), tmp_path, capsys) == [6, 6, 6]


def altered(field: str, value: float, row: int) -> Callable[[str, int, bytes], bytes]:
    """One sample's message with another value."""

    def change(topic: str, number: int, data: bytes) -> bytes:
        if topic != "/yawid/sample" or number != row:
            return data
        message = np.frombuffer(data, RowLayout(descriptor("yawid.Sample"), {"u": 1}).dtype).copy()
        message[field] = value
        return message.tobytes()

    return change


@pytest.mark.parametrize(
    ("field", "value"),
    [("boot_time", np.nan), ("received_time", np.inf), ("u", np.inf), ("yaw_rate", 1e300),
     ("airspeed", -1e300)],
)  # fmt: skip
def test_a_sample_that_no_aircraft_gave_is_refused(
    run: Path, field: str, value: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forged = forge(run, tmp_path / "f.mcap", message=altered(field, value, 100))
    for name, option, out in COMMANDS:
        assert main([name, str(forged), option, out.replace("OUT", str(tmp_path / "out"))]) == 6
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert f"{field} of a sample is impossible" in said


def test_log_lines_without_a_time_are_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = forge(run, tmp_path / "f.mcap", log_time=lambda topic, time: 2**64 - 1)
    assert main(["replay", str(late), "--out", str(tmp_path)]) == 6
    assert capsys.readouterr().err.count("\n") == 1


def test_a_run_without_its_samples_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forged = forge(run, tmp_path / "f.mcap", keeps=lambda topic: "log" in topic)
    assert main(["replay", str(forged), "--out", str(tmp_path / "out")]) == 6
    assert "holds no sample: replay the log itself" in capsys.readouterr().err


def test_a_file_that_counts_no_samples_is_read_all_the_same(run: Path, tmp_path: Path) -> None:
    mute = tmp_path / "mute.mcap"
    with mute.open("wb") as target:
        # Without statistics nobody knows how many there are before they are read.
        forge(run, tmp_path / "f.mcap")
        target.write(without_statistics((tmp_path / "f.mcap").read_bytes()))
    before = summary_of(replayed(run, tmp_path / "direct"))
    assert summary_of(replayed(mute, tmp_path / "mute"))["estimates"] == before["estimates"]


def without_statistics(data: bytes) -> bytes:
    """The file with its statistics record under an opcode that readers have to skip."""
    start = int.from_bytes(data[-28:-20], "little")
    at = start
    while data[at] != 0x0B:
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    crc = (0).to_bytes(4, "little")  # of the summary: 0 is "not told"
    return data[:at] + b"\x80" + data[at + 1 : -12] + crc + data[-8:]


def summary_of(mcap: Path) -> dict[str, Any]:
    from mcap.reader import make_reader

    with mcap.open("rb") as stream:
        [data] = [a.data for a in make_reader(stream).iter_attachments() if "summary" in a.name]
    summary: dict[str, Any] = json.loads(data)
    return summary


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.NONE])
def test_a_foreign_recording_is_refused_by_its_own_name(
    compression: CompressionType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foreign = tmp_path / "ros.mcap"
    with foreign.open("wb") as target:
        writer = Writer(target, compression=compression)
        writer.start(profile="ros2", library="libmcap")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 1, b"\x00\x01\x00\x00hello", 1)
        writer.add_metadata("rosbag2", {"version": "9"})
        writer.finish()
    assert codes(foreign, tmp_path, capsys) == [6, 6, 6]


def test_a_log_whose_name_is_no_text_is_replayed_and_so_is_its_run(tmp_path: Path) -> None:
    log = tmp_path / "caf\udce9.tlog"  # as the system gives a name in Latin 1
    log.write_bytes(FLIGHT)
    first = replayed(log, tmp_path / "first", "--rate", 10)
    second = replayed(first, tmp_path / "second")
    assert summary_of(second)["estimates"] == summary_of(first)["estimates"]


def test_a_reason_that_this_version_does_not_know_is_shown_and_not_judged_again(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forged = forge(run, tmp_path / "f.mcap", summary=with_("verdict.reasons.0.id", "too_hot"))
    assert main(["replay", str(forged), "--out", str(tmp_path / "out")]) == 6
    assert "that this version does not know: too_hot" in capsys.readouterr().err
    assert main(["view", str(forged), "--out", str(tmp_path / "v.rrd")]) == 0
