from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.reader import make_reader
from sinks.mcap.mcap_reading import column, decoded, open_sink, write_file
from sinks.sink_blocks import (
    GRID,
    PARAMETERS,
    START_NS,
    SUMMARY,
    make_blocks,
    make_manoeuvre,
    rows_of,
    unanswered,
)

from yawid.blocks import Held, Status
from yawid.sinks.base import Done, Found, LogLine, RunRows
from yawid.sinks.mcap.answers import NAMES, schema_of
from yawid.sinks.mcap.messages import modes_rows
from yawid.sinks.mcap.sink import McapSink
from yawid.version import __version__


def assert_held(messages: list[Any], held: Any) -> None:
    np.testing.assert_array_equal(column(messages, "held"), held)
    for flag in Held:
        bits = [getattr(p.held_reasons, flag.name.lower()) for _, p in messages]
        np.testing.assert_array_equal(bits, held & flag.value != 0)


@pytest.mark.parametrize("n_inputs", [1, 2])
def test_every_field_of_a_sample_reads_back_by_the_schema_in_the_file(
    tmp_path: Path, n_inputs: int
) -> None:
    samples, estimates, modes = make_blocks(n_inputs=n_inputs)
    path = write_file(tmp_path / "a.mcap", (samples, estimates, modes))
    messages = decoded(path)["/yawid/sample"]
    np.testing.assert_array_equal([m.log_time for m, _ in messages], samples.unix_ns)
    np.testing.assert_array_equal([m.publish_time for m, _ in messages], samples.received_us * 1000)
    np.testing.assert_array_equal(column(messages, "boot_time"), samples.boot_us / 1e6)
    np.testing.assert_array_equal(
        np.round(column(messages, "received_time") * 1e6), samples.received_us
    )
    for field in ("k", "epoch", "u", "yaw", "roll", "aileron", "mode", "altitude"):
        np.testing.assert_array_equal(column(messages, field), getattr(samples, field))
    np.testing.assert_array_equal(column(messages, "yaw_rate"), samples.y)
    np.testing.assert_array_equal(column(messages, "rudder"), samples.u[:, 0])
    assert_held(messages, samples.held)


def test_every_field_of_an_estimate_reads_back_for_each_method(tmp_path: Path) -> None:
    samples, estimates, modes = make_blocks()
    topics = decoded(write_file(tmp_path / "a.mcap", (samples, estimates, modes)))
    for topic, method in (("/yawid/estimate", "els"), ("/yawid/estimate/rml", "rml")):
        messages, estimate = topics[topic], estimates[method]
        np.testing.assert_array_equal([m.log_time for m, _ in messages], samples.unix_ns)
        np.testing.assert_array_equal(column(messages, "boot_time"), samples.boot_us / 1e6)
        for field in ("theta", "theta_std", "y_hat", "innovation", "residual", "noise_std"):
            np.testing.assert_array_equal(column(messages, field), getattr(estimate, field))
        np.testing.assert_array_equal(column(messages, "status"), estimate.status)
        assert_held(messages, samples.held)
        by_name = [f.name for f in messages[0][1].parameters.DESCRIPTOR.fields]
        assert by_name == list(PARAMETERS)
        named = [[getattr(each.parameters, name) for name in by_name] for _, each in messages]
        np.testing.assert_array_equal(named, estimate.theta)
    names = messages[0][1].DESCRIPTOR.fields_by_name["status"].enum_type.values_by_name
    assert {name: value.number for name, value in names.items()} == {s.name: s for s in Status}


def test_every_field_of_the_modes_reads_back(tmp_path: Path) -> None:
    samples, estimates, modes = make_blocks()
    messages = decoded(write_file(tmp_path / "a.mcap", (samples, estimates, modes)))["/yawid/modes"]
    np.testing.assert_array_equal(column(messages, "boot_time"), samples.boot_us / 1e6)
    np.testing.assert_array_equal(column(messages, "pole_re"), modes.poles.real)
    np.testing.assert_array_equal(column(messages, "pole_im"), modes.poles.imag)
    for i, field in enumerate(("wn", "wn_std", "zeta", "zeta_std")):
        np.testing.assert_array_equal(column(messages, field), getattr(modes, field))
        np.testing.assert_array_equal(
            column(messages, f"dutch_roll_{field}"), modes.dutch_roll[:, i]
        )


def test_the_rows_hold_nothing_that_the_schema_does_not_name(tmp_path: Path) -> None:
    topics = decoded(write_file(tmp_path / "a.mcap", make_blocks(n=5)))
    for topic in ("/yawid/sample", "/yawid/estimate", "/yawid/modes"):
        for _, payload in topics[topic]:
            assert len(UnknownFieldSet(payload)) == 0
            assert len(UnknownFieldSet(getattr(payload, "held_reasons", payload))) == 0


@pytest.mark.parametrize("p", [0, 15, 16, 17, 40, 2100])
def test_any_number_of_parameters_is_possible(tmp_path: Path, p: int) -> None:
    """The length of a packed field takes one byte below 128, two below 16 384, then three."""
    samples, estimates, modes = make_blocks(n=3, p=p, na=0)
    sink = open_sink(tmp_path / "a.mcap", parameters=tuple(f"a{i}" for i in range(p)))
    sink.take(RunRows(samples, estimates, modes))
    sink.take(Done(SUMMARY, {}))
    messages = decoded(tmp_path / "a.mcap")["/yawid/estimate"]
    np.testing.assert_array_equal(column(messages, "theta"), estimates["els"].theta)


def test_log_time_never_decreases_on_a_topic(tmp_path: Path) -> None:
    samples, estimates, modes = make_blocks(n=60)
    jumping = samples.unix_ns.copy()
    jumping[20:40] -= 600_000_000
    sink = open_sink(tmp_path / "a.mcap")
    for first in range(0, 60, 30):  # once within a block, once between two
        rows = slice(first, first + 30)
        part = rows_of(samples, rows)
        part.unix_ns[:] = jumping[rows]
        sink.take(
            RunRows(part, {m: rows_of(e, rows) for m, e in estimates.items()}, rows_of(modes, rows))
        )
    sink.take(LogLine(START_NS, "info", "later"))
    sink.take(LogLine(START_NS - 5, "info", "earlier"))
    sink.take(Done(SUMMARY, {}))
    expected = np.maximum.accumulate(jumping)
    for topic, messages in decoded(tmp_path / "a.mcap").items():
        log_times = [m.log_time for m, _ in messages]
        if topic == "/yawid/log":
            assert log_times == [START_NS, START_NS]
        elif topic not in ("/yawid/mode", "/yawid/verdict"):
            np.testing.assert_array_equal(log_times, expected)


def test_times_before_1970_do_not_break_the_file(tmp_path: Path) -> None:
    """A ground station without a clock stamps from zero, and the vehicle may have booted before."""
    samples, estimates, modes = make_blocks(n=3)
    samples.unix_ns[:] = [-7, -5, 20]
    samples.received_us[:] = [-1, 0, 1]
    path = write_file(tmp_path / "a.mcap", (samples, estimates, modes))
    messages = [m for m, _ in decoded(path)["/yawid/sample"]]
    assert [m.log_time for m in messages] == [0, 0, 20]
    assert [m.publish_time for m in messages] == [0, 0, 1000]


def test_lines_for_people_are_foxglove_logs(tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.mcap")
    sink.take(LogLine(START_NS + 1_234_567_891, "warning", "gap of 3 s, gültig"))
    sink.take(Done(SUMMARY, {}))
    [(message, log)] = decoded(tmp_path / "a.mcap")["/yawid/log"]
    assert log.DESCRIPTOR.full_name == "foxglove.Log"
    assert log.timestamp.ToNanoseconds() == message.log_time == START_NS + 1_234_567_891
    assert log.DESCRIPTOR.fields_by_name["level"].enum_type.values_by_number[log.level].name == (
        "WARNING"
    )
    assert (log.message, log.name) == ("gap of 3 s, gültig", "yawid")


def test_the_verdict_stands_at_the_end_with_its_reasons(tmp_path: Path) -> None:
    samples, *_ = blocks = make_blocks()
    [(message, verdict)] = decoded(write_file(tmp_path / "a.mcap", blocks))["/yawid/verdict"]
    assert message.log_time == samples.unix_ns[-1]
    assert verdict.usable is False
    reasons = [{"id": r.id, "weight": r.weight, "text": r.text} for r in verdict.reasons]
    assert reasons == [each.to_json() for each in SUMMARY.verdict.reasons]


def test_every_field_of_a_manoeuvre_reads_back_as_json_by_the_schema_in_the_file(
    tmp_path: Path,
) -> None:
    blocks = make_blocks()
    found, span_ns = make_manoeuvre(blocks[0], 10, 60)
    sink = open_sink(tmp_path / "a.mcap")
    sink.take(RunRows(*blocks))
    sink.take(Found(found, span_ns))
    sink.take(Done(SUMMARY, {}))
    [(message, told)] = decoded(tmp_path / "a.mcap")["/yawid/manoeuvre"]
    assert (message.log_time, message.publish_time) == (span_ns[1], span_ns[1])
    jsonschema.Draft202012Validator(told.SHAPE).validate(json.loads(message.data))
    assert vars(told).keys() - {"SHAPE"} == told.SHAPE["properties"].keys()
    assert told.SHAPE["properties"]["wn_rad_s"] == {
        "type": "number", "description": "rad/s, natural frequency",
    }  # fmt: skip
    direct = [name for name in told.SHAPE["properties"] if hasattr(found, name)]
    assert len(direct) == 14
    assert [getattr(told, name) for name in direct] == [getattr(found, name) for name in direct]
    assert (told.method, told.structure, told.usable) == ("ct", "2L", True)
    assert (told.wn_rad_s, told.wn_std, told.zeta, told.zeta_std) == (10.2, 0.2, 0.62, 0.03)
    assert (told.K, told.K_std) == (-1.5, 0.1)
    assert (told.yaw_acceleration, told.yaw_acceleration_std) == (-40.0, 2.0)
    assert (told.wn_std_noise, told.zeta_std_noise) == (0.05, 0.01)
    assert told.simulation_pct == 87.0
    assert told.reasons == [each.to_json() for each in found.verdict.reasons]


def test_what_is_not_known_of_a_manoeuvre_is_left_out(tmp_path: Path) -> None:
    found, span_ns = make_manoeuvre(make_blocks()[0], 10, 60)
    sink = open_sink(tmp_path / "a.mcap")
    sink.take(Found(unanswered(found), span_ns))
    sink.take(Done(SUMMARY, {}))
    [(_, told)] = decoded(tmp_path / "a.mcap")["/yawid/manoeuvre"]
    assert told.SHAPE["properties"].keys() - vars(told).keys() == {
        "airspeed_m_s", "airspeed_std_m_s", "altitude_m", "wn_rad_s", "wn_std", "zeta", "zeta_std",
        "K", "K_std", "yaw_acceleration", "yaw_acceleration_std", "simulation_pct",
        "wn_std_noise", "zeta_std_noise", "mode", "airspeed_source", "airspeed_kind", "structure",
        "method",
    }  # fmt: skip
    assert told.usable is False
    assert [reason["id"] for reason in told.reasons] == ["not_excited", "rudder_assumed"]


FLAT = {"boolean", "string", "number", "integer"}


def understood(shape: dict[str, Any]) -> bool:
    """Whether the schema check of Foxglove's open viewers takes a schema: no reference, no null."""
    if shape["type"] == "array":
        return shape["items"]["type"] in FLAT or (
            shape["items"]["type"] == "object" and understood(shape["items"])
        )
    if shape["type"] == "object":
        return all(understood(each) for each in shape["properties"].values())
    return shape["type"] in FLAT


@pytest.mark.parametrize("topic", NAMES)
def test_every_answers_schema_is_one_that_viewers_understand(topic: str) -> None:
    shape = json.loads(schema_of(topic))
    assert shape["type"] == "object"
    assert understood(shape)


def test_header_metadata_and_attachments_say_where_the_numbers_come_from(tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.mcap", n_inputs=2)
    attachments = {"summary.json": b"{}", "configuration.toml": b"rate = 20\n", "parameters": b"\0"}
    sink.take(Done(SUMMARY, attachments))
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream)
        header = reader.get_header()
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        found = {a.name: (a.media_type, a.data) for a in reader.iter_attachments()}
        summary = reader.get_summary()
    assert (header.profile, header.library) == ("", f"yawid {__version__}")
    assert records["configuration"] == {"rate": "20.0", "method": "els"}
    assert records["note"] == {"text": "by hand"}
    assert records["source"] == {"log": "/flights/a.tlog", "sha256": "ab" * 32}
    assert records["channels"] == {
        "rudder.source": "servo 4",
        "rudder.reversed": "true",
        "rudder.rate_hz": "50.0",
    }
    assert records["grid"]["parameters"] == "a1 a2 b1 b2 c1 bias"
    assert records["grid"]["inputs"] == "rudder aileron"
    assert records["units"]["Sample.yaw_rate"].startswith("rad/s, ")
    assert found["summary.json"] == ("application/json", b"{}")
    assert found["configuration.toml"] == ("application/toml", b"rate = 20\n")
    assert found["parameters"] == ("application/octet-stream", b"\0")
    assert summary is not None
    rml = next(c for c in summary.channels.values() if c.topic == "/yawid/estimate/rml")
    assert rml.metadata == {"method": "rml", "parameters": "a1 a2 b1 b2 c1 bias"}


def test_metadata_given_at_the_start_is_not_written_twice(tmp_path: Path) -> None:
    sink = McapSink(tmp_path / "a.mcap", {"channels": {"rudder": "mine"}})
    sink.take(Done(SUMMARY, {}))
    with (tmp_path / "a.mcap").open("rb") as stream:
        records = [r.metadata for r in make_reader(stream).iter_metadata() if r.name == "channels"]
    assert records == [{"rudder": "mine"}]


def test_metadata_names_every_unit_of_a_field_that_exists(tmp_path: Path) -> None:
    blocks = make_blocks(n=2)
    sink = open_sink(tmp_path / "a.mcap")
    sink.take(RunRows(*blocks))
    sink.take(Done(SUMMARY, {}))
    topics = decoded(tmp_path / "a.mcap")
    sample = topics["/yawid/sample"][0][1].DESCRIPTOR
    known = {
        f"{message.name}.{field.name}"
        for message in sample.file.message_types_by_name.values()
        for field in message.fields
    }
    with (tmp_path / "a.mcap").open("rb") as stream:
        records = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    fields = {name for name in records["units"] if not name.startswith("Reason.")}
    assert fields <= known
    assert {"Sample.yaw_rate", "Estimate.noise_std", "Modes.dutch_roll_wn"} <= fields


@pytest.mark.parametrize("unit", ["half-travel", "rad"])
def test_units_are_those_that_the_rudder_was_estimated_in(tmp_path: Path, unit: str) -> None:
    sink = McapSink(tmp_path / "a.mcap", {})
    sink.take(replace(GRID, rudder_unit=unit))
    sink.take(Done(SUMMARY, {}))
    with (tmp_path / "a.mcap").open("rb") as stream:
        records = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    units = records["units"]
    assert records["grid"]["rudder_unit"] == unit
    assert units["Sample.rudder"].startswith(f"{unit},")
    assert units["Sample.aileron"].startswith("half-travel")
    assert units["Modes.K"].startswith(f"rad/s per {unit},")
    assert units["Modes.a_my_delta_h_std"] == f"1/s^2 per {unit}, sigma, of noise alone"
    assert not any("{" in text for text in units.values())


def rerun_executable() -> str:
    found = shutil.which("rerun", path=str(Path(sys.executable).parent))
    assert found is not None, "rerun-sdk puts its viewer beside the interpreter"
    return found


def test_rerun_converts_the_file_and_finds_every_message(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    sink = open_sink(tmp_path / "a.mcap")
    samples, estimates, modes = make_blocks(n=100)
    sink.take(RunRows(samples, estimates, modes))
    sink.take(LogLine(START_NS, "info", "hello"))
    sink.take(Found(*make_manoeuvre(samples, 10, 60)))
    sink.take(Done(SUMMARY, {}))
    command = [rerun_executable(), "mcap", "convert", "a.mcap", "-o", "a.rrd"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=60)
    rows: Counter[str] = Counter()
    columns: dict[str, set[str]] = {}
    for chunk in RrdReader(tmp_path / "a.rrd").stream().to_chunks():
        if not chunk.is_static:
            rows[chunk.entity_path] += chunk.num_rows
            names = chunk.to_record_batch().schema.names
            columns.setdefault(chunk.entity_path, set()).update(names)
    topics = ("/yawid/sample", "/yawid/estimate", "/yawid/estimate/rml", "/yawid/modes")
    assert [rows[topic] for topic in topics] == [100] * 4
    assert rows["/yawid/manoeuvre"] == 1
    assert "yawid.Sample:message" in columns["/yawid/sample"]
    assert "TextLog:text" in columns["/yawid/log"]


def test_every_nan_is_the_same_in_the_file_whatever_its_sign():
    samples, _, modes = make_blocks(n=5)
    signs = [replace(modes, wn=np.full_like(modes.wn, nan)) for nan in (np.nan, -np.nan)]
    assert signs[0].wn.tobytes() != signs[1].wn.tobytes()
    assert len({modes_rows(samples, block).tobytes() for block in signs}) == 1
