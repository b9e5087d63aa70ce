"""A finished run of an older version is read: what its file lacks is unknown, nothing is misread.

``run_of_0_1_0.mcap`` was written by version 0.1.0 as of 2026-11-21, before samples had mode, ground
contact and altitude: the first 30 s of replay_logs/c172p_3211 at 10 Hz, forgetting 1.
"""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from finished_runs import replayed
from google.protobuf import descriptor_pb2
from hand_flights import NOT_CONVERGED, four_of_a_flight, manoeuvre, none_usable, plain_summary
from mcap.reader import make_reader
from mcap.writer import Writer
from places import C172P
from printed import why_invalid

from yawid.answers.model_parts import Fit
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import MethodSummary
from yawid.cli.main import main
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sinks.mcap.reader import open_answered, open_run
from yawid.sinks.mcap.schemas import descriptor, descriptor_in, is_older, schema_data
from yawid.sinks.terminal.summary_table import print_summary

OLD_RUN = Path(__file__).with_name("run_of_0_1_0.mcap")


def test_its_samples_are_there_and_what_it_lacks_is_unknown():
    run = open_run(OLD_RUN)
    blocks = list(run.blocks())

    samples = [block.samples for block in blocks]
    assert sum(len(block) for block in samples) == run.rows > 200
    for name in ("aileron", "mode", "on_ground", "altitude"):
        assert all(np.isnan(getattr(block, name)).all() for block in samples)
    assert all(np.isfinite(block.y[block.held == 0]).all() for block in samples)
    assert run.grid is not None
    assert run.summary.manoeuvres is run.summary.flight is None
    assert (run.grid.rudder_unit, run.grid.autopilot, run.grid.vehicle_type) == (
        "half-travel",
        0,
        0,
    )
    assert (run.grid.mode_name(np.nan), run.grid.mode_name(10.0)) == ("unknown", "mode 10")


def test_what_its_sigmas_say_of_noise_is_unknown_and_it_is_shown_as_noise():
    summary = open_run(OLD_RUN).summary
    estimates = (summary.estimates or {}).values()
    out = io.StringIO()
    print_summary(summary, out)

    rolls = [each.dutch_roll for each in estimates if each.dutch_roll is not None]
    gains = [value for each in estimates for value in (each.physics or {}).values()]
    assert rolls
    assert gains
    assert all(roll.wn_std is not None and roll.wn_std_noise is None for roll in rolls)
    assert all(roll.zeta_std_noise is None for roll in rolls)
    assert all(value.std_noise is None for value in gains)
    assert "± is one sigma of noise" in out.getvalue()


def test_it_is_estimated_again_to_what_it_said(tmp_path):
    summary = replay(OLD_RUN, {}, Outputs(tmp_path, "again"), StopFlag())

    before = json.loads(open_run(OLD_RUN).attachments["summary.json"])
    assert why_invalid("replay", summary.to_json()) == ""
    for method in ("els", "rml"):
        assert summary.estimates[method].theta == before["estimates"][method]["theta"]
    assert [block.samples for block in open_run(tmp_path / "again.mcap").blocks()]


@pytest.mark.parametrize(
    "command",
    [
        ("report", "RUN", "--out", "OUT.html"), ("export", "RUN", "-o", "OUT.csv"),
        ("diff", "RUN", "RUN"), ("damper", "RUN"),
        ("export", "RUN", "--what", "model", "-o", "OUT.json"),
    ],
)  # fmt: skip
def test_its_answer_is_not_used_until_it_is_replayed(command, tmp_path, capsys):
    places = {"RUN": str(OLD_RUN), "OUT": str(tmp_path / "out")}
    words = list(command)
    for name, place in places.items():
        words = [each.replace(name, place) for each in words]

    assert main(words) == 6
    said = capsys.readouterr().err
    assert said == f"yawid: {OLD_RUN} is of an older version of yawid: replay it first\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("summary", "older"),
    [
        (four_of_a_flight(), False),
        (none_usable(), False),
        (plain_summary(verdict=None), False),
        (plain_summary(verdict=Verdict.of([Reason("no_rudder", "")])), False),
        (plain_summary(estimates={"rml": MethodSummary(method="rml", sample_time_s=0.1, fit=Fit())},
                       verdict=Verdict(method="rml", usable=False, reasons=[])), True),
        (plain_summary(manoeuvres=[manoeuvre(1, verdict=Verdict.of([], "els"))],
                       verdict=Verdict.of([NOT_CONVERGED])), True),
        (plain_summary(verdict=Verdict.of([])), True),  # usable, without a flight
    ],
)  # fmt: skip
def test_an_answer_by_a_recursive_method_is_of_an_older_version(summary, older):
    assert summary.is_older is older


def test_once_replayed_its_answer_is_of_this_version(tmp_path):
    summary = replay(OLD_RUN, {}, Outputs(tmp_path, "again"), StopFlag())

    assert open_run(OLD_RUN).summary.is_older
    assert not summary.is_older
    assert not open_answered(tmp_path / "again.mcap").summary.is_older


def changed_schema(change) -> bytes:
    files = descriptor_pb2.FileDescriptorSet.FromString(schema_data("yawid.Sample"))
    message = next(m for m in files.file[-1].message_type if m.name == "Sample")
    change(message)
    return files.SerializeToString()


@pytest.mark.parametrize("last", range(1, 5))
def test_a_schema_with_fewer_fields_at_its_end_is_older(last):
    def cut(message):
        del message.field[-last:]

    written = descriptor_in("yawid.Sample", changed_schema(cut))

    assert is_older(written, descriptor("yawid.Sample"))
    assert not is_older(descriptor("yawid.Sample"), written)


def rename(message):
    message.field[2].name = "index"


def retype(message):
    message.field[2].type = descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE


def append(message):
    message.field.add(name="further", number=99, type=1, label=1)


@pytest.mark.parametrize("change", [rename, retype, append])
def test_a_schema_that_says_otherwise_is_another_format(change):
    written = descriptor_in("yawid.Sample", changed_schema(change))

    assert not is_older(written, descriptor("yawid.Sample"))


def test_bytes_that_are_no_schema_are_refused():
    with pytest.raises(ValueError, match=r"yawid\.Sample"):
        descriptor_in("yawid.Sample", b"\xff\xffnothing")


def without_rudder_moves(run: Path, out: Path) -> None:
    """Copy a run's file as the version before that column would have written it."""

    def cut(message):
        assert message.field[-1].name == "rudder_moves"
        del message.field[-1]

    old, size = changed_schema(cut), 10  # a tag of two bytes and a double, the last in each row
    with run.open("rb") as stream, out.open("wb") as to:
        reader, writer = make_reader(stream), Writer(to)
        writer.start()
        ids: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            is_sample, data = schema.name == "yawid.Sample", message.data
            if channel.id not in ids:
                of = writer.register_schema(schema.name, schema.encoding,
                                            old if is_sample else schema.data)  # fmt: skip
                ids[channel.id] = writer.register_channel(channel.topic, "protobuf", of)
            data = data[:-size] if is_sample else data
            writer.add_message(ids[channel.id], message.log_time, data, message.publish_time)
        for each in reader.iter_metadata():
            writer.add_metadata(each.name, dict(each.metadata))
        for each in reader.iter_attachments():
            writer.add_attachment(
                each.create_time, each.log_time, each.name, each.media_type, each.data
            )
        writer.finish()


def test_a_file_that_does_not_say_when_the_rudder_moved_is_replayed_with_a_line(tmp_path, capsys):
    old = tmp_path / "old.mcap"
    without_rudder_moves(replayed(C172P, tmp_path), old)

    summary = replay(old, {}, Outputs(tmp_path, "again"), StopFlag())

    said = capsys.readouterr().err
    assert "old.mcap is of an older version: it does not say when the rudder moved" in said
    assert summary.flight.dutch_roll.wn_rad_s == pytest.approx(2.39, rel=0.01)
