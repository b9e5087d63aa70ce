"""What a file holds: every field of every event, read back by the schema in the file."""

from __future__ import annotations

import json
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
from rerun.chunk import RrdReader
from sinks.mcap.mcap_reading import (
    column,
    decoded,
    open_sink,
    raw,
    records_of,
    summary_of,
)
from sinks.sink_blocks import (
    GRID,
    PARAMETERS,
    START_NS,
    SUMMARY,
    cut,
    make_blocks,
    make_manoeuvre,
    unanswered,
)

from yawid.blocks import Held, Status
from yawid.quantities.table import YAW_CHANNEL
from yawid.sinks.base import Done, Found, LogLine, RunRows
from yawid.sinks.mcap.answers import NAMES, schema_of
from yawid.sinks.mcap.messages import modes_rows
from yawid.sinks.mcap.sink import McapSink
from yawid.version import __version__

BLOCKS = SAMPLES, ESTIMATES, MODES = make_blocks(n_inputs=2)
FOUND, SPAN_NS = make_manoeuvre(SAMPLES, 10, 60)
ATTACHED = {"summary.json": b"{}", "configuration.toml": b"rate = 20\n", "parameters": b"\0"}
LINE = LogLine(START_NS + 1_234_567_891, "warning", "gap of 3 s, gültig")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of two inputs with all that a run writes."""
    path = tmp_path_factory.mktemp("written") / "a.mcap"
    sink = open_sink(path, 2)
    for event in (
        LINE, RunRows(*BLOCKS), Found(FOUND, SPAN_NS), Found(unanswered(FOUND), SPAN_NS),
        Done(SUMMARY, ATTACHED),
    ):  # fmt: skip
        sink.take(event)
    return path


@pytest.fixture(scope="module")
def topics(written: Path) -> dict[str, list[Any]]:
    return decoded(written)


def of_estimate(method: str) -> dict[str, Any]:
    names = ("theta", "theta_std", "y_hat", "innovation", "residual", "noise_std", "status")
    return {name: getattr(ESTIMATES[method], name) for name in names} | {"held": SAMPLES.held}


SAME = ("k", "epoch", "u", "yaw", "roll", "aileron", "mode", "altitude", "held")
WIDTHS = ("wn", "wn_std", "zeta", "zeta_std")
FIELDS: dict[str, dict[str, Any]] = {
    "/yawid/sample": {name: getattr(SAMPLES, name) for name in SAME}
    | {"yaw_rate": SAMPLES.y, "rudder": SAMPLES.u[:, 0]}
    | {"received_time": SAMPLES.received_us / 1e6},
    "/yawid/estimate": of_estimate("els"),
    "/yawid/estimate/rml": of_estimate("rml"),
    "/yawid/modes": {"pole_re": MODES.poles.real, "pole_im": MODES.poles.imag}
    | {name: getattr(MODES, name) for name in WIDTHS}
    | {f"dutch_roll_{name}": MODES.dutch_roll[:, i] for i, name in enumerate(WIDTHS)}
    | {name: MODES.yaw[:, i] for i, name in enumerate(YAW_CHANNEL)}
    | {f"{name}_std": MODES.yaw_std[:, i] for i, name in enumerate(YAW_CHANNEL)},
}


@pytest.mark.parametrize("topic", FIELDS)
def test_every_field_of_a_row_reads_back_by_the_schema_in_the_file_and_there_is_no_other(
    topic: str, topics: dict[str, list[Any]]
) -> None:
    messages = topics[topic]
    assert [m.log_time for m, _ in messages] == SAMPLES.unix_ns.tolist()
    assert [m.publish_time for m, _ in messages] == (SAMPLES.received_us * 1000).tolist()
    for field, values in (FIELDS[topic] | {"boot_time": SAMPLES.boot_us / 1e6}).items():
        np.testing.assert_array_equal(column(messages, field), values, err_msg=field)
    for flag in Held if "held" in FIELDS[topic] else ():
        bits = [getattr(p.held_reasons, flag.name.lower()) for _, p in messages]
        np.testing.assert_array_equal(bits, SAMPLES.held & flag.value != 0)
    for _, payload in messages:
        inner = getattr(payload, "held_reasons", payload)
        assert len(UnknownFieldSet(payload)) == len(UnknownFieldSet(inner)) == 0


def test_parameters_and_states_have_their_names_in_the_schema(topics: dict[str, list[Any]]) -> None:
    for topic, method in (("/yawid/estimate", "els"), ("/yawid/estimate/rml", "rml")):
        kept = [each for _, each in topics[topic]]
        assert [f.name for f in kept[0].parameters.DESCRIPTOR.fields] == list(PARAMETERS)
        named = [[getattr(each.parameters, name) for name in PARAMETERS] for each in kept]
        np.testing.assert_array_equal(named, ESTIMATES[method].theta)
    names = kept[0].DESCRIPTOR.fields_by_name["status"].enum_type.values_by_name
    assert {name: value.number for name, value in names.items()} == {s.name: s for s in Status}


@pytest.mark.parametrize("p", [0, 15, 16, 17, 40, 2100])
def test_any_number_of_parameters_is_possible(tmp_path: Path, p: int) -> None:
    """The length of a packed field takes one byte below 128, two below 16 384, then three."""
    samples, estimates, modes = make_blocks(n=3, p=p, na=0)
    sink = open_sink(tmp_path / "a.mcap", parameters=tuple(f"a{i}" for i in range(p)))
    sink.take(RunRows(samples, estimates, modes))
    sink.take(Done(SUMMARY, {}))
    messages = decoded(tmp_path / "a.mcap")["/yawid/estimate"]
    np.testing.assert_array_equal(column(messages, "theta"), estimates["els"].theta)


JUMP_NS = np.where(np.arange(60) // 20 == 1, -600_000_000, 0) + make_blocks(n=60)[0].unix_ns


@pytest.mark.parametrize("times_ns", [JUMP_NS, np.array([-7, -5, 20])], ids=["back", "before 1970"])
def test_log_time_never_decreases_on_a_topic_and_is_never_negative(
    times_ns: Any, tmp_path: Path
) -> None:
    """A ground station without a clock stamps from zero, and the vehicle may have booted before."""
    samples, estimates, modes = make_blocks(n=len(times_ns))
    samples.unix_ns[:] = times_ns
    samples.received_us[0] = -1
    sink = open_sink(tmp_path / "a.mcap")
    for block in cut(
        (samples, estimates, modes), [len(times_ns) // 2]
    ):  # once within a block, once between two
        sink.take(RunRows(*block))
    for number, row in enumerate((2, 1), start=1):
        sink.take(Found(*make_manoeuvre(samples, 0, row, number)))
    for since_ns in (0, -5):
        sink.take(LogLine(START_NS + since_ns, "info", "later, then earlier"))
    sink.take(Done(SUMMARY, {}))
    found = decoded(tmp_path / "a.mcap")
    expected = np.maximum.accumulate(np.maximum(times_ns, 0)).tolist()
    for topic in FIELDS:
        assert [m.log_time for m, _ in found[topic]] == expected
    assert [m.log_time for m, _ in found["/yawid/log"]] == [START_NS, START_NS]
    assert [(m.log_time, of.n) for m, of in found["/yawid/manoeuvre"]] == [
        (expected[2], 1), (expected[2], 2),
    ]  # fmt: skip
    assert found["/yawid/sample"][0][0].publish_time == 0


def test_lines_for_people_are_foxglove_logs_and_the_verdict_stands_at_the_end(
    topics: dict[str, list[Any]],
) -> None:
    [(message, log)] = topics["/yawid/log"]
    assert log.DESCRIPTOR.full_name == "foxglove.Log"
    assert log.timestamp.ToNanoseconds() == message.log_time == LINE.unix_ns
    level = log.DESCRIPTOR.fields_by_name["level"].enum_type.values_by_number[log.level].name
    assert (log.message, log.name, level) == (LINE.text, "yawid", "WARNING")
    [(message, verdict)] = topics["/yawid/verdict"]
    assert (message.log_time, verdict.usable) == (SAMPLES.unix_ns[-1], False)
    reasons = [{"id": r.id, "weight": r.weight, "text": r.text} for r in verdict.reasons]
    assert reasons == [each.to_json() for each in SUMMARY.verdict.reasons]


def test_every_field_of_a_manoeuvre_is_json_by_the_schema_and_what_is_not_known_is_left_out(
    topics: dict[str, list[Any]],
) -> None:
    (message, full), (_, bare) = topics["/yawid/manoeuvre"]
    shape = full.SHAPE
    assert (message.log_time, message.publish_time) == (SPAN_NS[1], SPAN_NS[1])
    jsonschema.Draft202012Validator(shape).validate(json.loads(message.data))
    assert vars(full).keys() - {"SHAPE"} == shape["properties"].keys()
    assert shape["properties"]["wn_rad_s"] == {
        "type": "number", "description": "rad/s, natural frequency",
    }  # fmt: skip
    direct = [name for name in shape["properties"] if hasattr(FOUND, name)]
    assert len(direct) == 14
    expected = {name: getattr(FOUND, name) for name in direct} | {
        "method": "ct", "structure": "2L", "usable": True, "simulation_pct": 87.0,
        "wn_rad_s": 10.2, "wn_std": 0.2, "zeta": 0.62, "zeta_std": 0.03, "K": -1.5, "K_std": 0.1,
        "yaw_acceleration": -40.0, "yaw_acceleration_std": 2.0, "wn_std_noise": 0.05,
        "zeta_std_noise": 0.01, "reasons": [each.to_json() for each in FOUND.verdict.reasons],
    }  # fmt: skip
    assert {name: getattr(full, name) for name in expected} == expected
    assert shape["properties"].keys() - vars(bare).keys() == {
        "airspeed_m_s", "airspeed_std_m_s", "altitude_m", "wn_rad_s", "wn_std", "zeta", "zeta_std",
        "K", "K_std", "yaw_acceleration", "yaw_acceleration_std", "simulation_pct",
        "wn_std_noise", "zeta_std_noise", "mode", "airspeed_source", "airspeed_kind", "structure",
        "method",
    }  # fmt: skip
    ids = [reason["id"] for reason in bare.reasons]
    assert (bare.usable, ids) == (False, ["not_excited", "rudder_assumed"])


FLAT = {"boolean", "string", "number", "integer"}


def understood(shape: dict[str, Any]) -> bool:
    """Whether the schema check of Foxglove's open viewers takes a schema: no reference, no null."""
    if shape["type"] == "array":
        return shape["items"]["type"] != "array" and understood(shape["items"])
    if shape["type"] == "object":
        return all(understood(each) for each in shape["properties"].values())
    return shape["type"] in FLAT


def test_every_answers_schema_is_one_that_viewers_understand() -> None:
    shapes = {topic: json.loads(schema_of(topic)) for topic in NAMES}
    assert {topic for topic, each in shapes.items() if each["type"] != "object"} == set()
    assert {topic for topic, each in shapes.items() if not understood(each)} == set()


def test_header_metadata_and_attachments_say_where_the_numbers_come_from(
    written: Path, topics: dict[str, list[Any]]
) -> None:
    with written.open("rb") as stream:
        header = make_reader(stream).get_header()
    metadata, attached = records_of(written)
    records = dict(metadata)
    assert (header.profile, header.library) == ("", f"yawid {__version__}")
    assert len(records) == len(metadata)
    expected = {
        "configuration": {"rate": "20.0", "method": "els"},
        "note": {"text": "by hand"},
        "source": {"log": "/flights/a.tlog", "sha256": "ab" * 32},
        "channels": {
            "rudder.source": "servo 4", "rudder.reversed": "true", "rudder.rate_hz": "50.0",
        },
    }  # fmt: skip
    assert {name: records[name] for name in expected} == expected
    grid = {"parameters": "a1 a2 b1 b2 c1 bias", "inputs": "rudder aileron"}
    assert grid.items() <= records["grid"].items()
    types = ("application/json", "application/toml", "application/octet-stream")
    assert attached == {
        name: (kind, data) for kind, (name, data) in zip(types, ATTACHED.items(), strict=True)
    }
    channels = {c.topic: c.metadata for c in summary_of(written).channels.values()}
    of_rml = {"method": "rml", "parameters": "a1 a2 b1 b2 c1 bias"}
    assert channels["/yawid/estimate/rml"] == of_rml
    file = topics["/yawid/sample"][0][1].DESCRIPTOR.file
    known = {f"{m.name}.{f.name}" for m in file.message_types_by_name.values() for f in m.fields}
    fields = {name for name in records["units"] if not name.startswith("Reason.")}
    assert {"Sample.yaw_rate", "Estimate.noise_std", "Modes.dutch_roll_wn"} <= fields <= known


@pytest.mark.parametrize("unit", ["half-travel", "rad"])
def test_units_are_those_that_the_rudder_was_estimated_in_and_no_record_is_written_twice(
    tmp_path: Path, unit: str
) -> None:
    sink = McapSink(tmp_path / "a.mcap", {"channels": {"rudder": "mine"}})
    sink.take(replace(GRID, rudder_unit=unit))
    sink.take(Done(SUMMARY, {}))
    metadata, _ = records_of(tmp_path / "a.mcap")
    units = dict(metadata)["units"]
    assert [each for name, each in metadata if name == "channels"] == [{"rudder": "mine"}]
    assert dict(metadata)["grid"]["rudder_unit"] == unit
    begin = {"Sample.rudder": f"{unit},", "Sample.aileron": "half-travel",
             "Sample.yaw_rate": "rad/s, ", "Modes.K": f"rad/s per {unit},",
             "Modes.a_my_delta_h_std": f"1/s^2 per {unit}, sigma, of noise alone"}  # fmt: skip
    assert {name: units[name][: len(text)] for name, text in begin.items()} == begin
    assert not any("{" in text for text in units.values())


def test_rerun_converts_the_file_and_finds_every_message(written: Path, tmp_path: Path) -> None:
    rerun = Path(sys.executable).with_name("rerun")
    command = [rerun, "mcap", "convert", written, "-o", tmp_path / "a.rrd"]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    rows: Counter[str] = Counter()
    names: set[tuple[str, str]] = set()
    for chunk in RrdReader(tmp_path / "a.rrd").stream().to_chunks():
        if not chunk.is_static:
            rows[chunk.entity_path] += chunk.num_rows
            names |= {(chunk.entity_path, name) for name in chunk.to_record_batch().schema.names}
    own = Counter(topic for topic, *_ in raw(written))
    assert {topic: rows[topic] for topic in own} == own
    assert {("/yawid/sample", "yawid.Sample:message"), ("/yawid/log", "TextLog:text")} <= names


def test_every_nan_is_the_same_in_the_file_whatever_its_sign():
    signs = [replace(MODES, wn=np.full_like(MODES.wn, nan)) for nan in (np.nan, -np.nan)]
    assert signs[0].wn.tobytes() != signs[1].wn.tobytes()
    assert len({modes_rows(SAMPLES, block).tobytes() for block in signs}) == 1
