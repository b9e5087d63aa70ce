"""A run's file of another version: its answers are not used, and its samples not misread."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from finished_runs import replayed
from google.protobuf import descriptor_pb2
from mcap.reader import make_reader
from mcap.writer import Writer
from places import C172P

from yawid.cli.main import main
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.mcap.schemas import schema_data


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("run"))


def rewritten(run: Path, out: Path, *, form: str | None = "0", change=None, verdict=None) -> Path:
    """Copy a run's file as another version would have written it.

    ``form`` is that of its answers, ``change`` edits the schema of samples, ``verdict`` the reasons
    in its summary.
    """
    parameters = open_run(run).grid.parameters
    files = descriptor_pb2.FileDescriptorSet.FromString(schema_data("yawid.Sample", parameters))
    if change is not None:
        change(next(m for m in files.file[-1].message_type if m.name == "Sample"))
    with run.open("rb") as stream, out.open("wb") as to:
        reader, writer = make_reader(stream), Writer(to)
        writer.start()
        ids: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in ids:
                data = files.SerializeToString() if schema.name == "yawid.Sample" else schema.data
                of = writer.register_schema(schema.name, schema.encoding, data)
                ids[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, of
                )
            writer.add_message(
                ids[channel.id], message.log_time, message.data, message.publish_time
            )
        for each in reader.iter_metadata():
            if each.name != "answers":
                writer.add_metadata(each.name, dict(each.metadata))
        if form is not None:
            writer.add_metadata("answers", {"form": form})
        for each in reader.iter_attachments():
            data = each.data
            if each.name == "summary.json" and verdict is not None:
                told = msgspec.json.decode(data)
                told["verdict"]["reasons"] += verdict
                told["flight"] = {"another": "form"}
                data = msgspec.json.encode(told)
            writer.add_attachment(each.create_time, each.log_time, each.name, each.media_type, data)
        writer.finish()
    return out


GONE = {"id": "els_rml_disagree", "weight": "fatal", "text": "they disagree"}


@pytest.mark.parametrize("form", [None, "0"])
def test_a_replay_answers_its_samples_again_and_then_it_is_of_this_version(form, run, tmp_path):
    other = rewritten(run, tmp_path / "other.mcap", form=form, verdict=[GONE])

    assert open_run(other).summary.flight is None
    summary = replay(other, {}, Outputs(tmp_path, "again"), StopFlag())

    assert summary.flight == open_run(run).summary.flight
    assert summary.manoeuvres == open_run(run).summary.manoeuvres
    assert summary.verdict.exit_code == 0
    assert main(["export", str(tmp_path / "again.mcap"), "-o", str(tmp_path / "out.csv")]) == 0


def test_a_reason_that_this_version_does_not_know_is_no_small_thing_in_its_own_form(run, tmp_path):
    forged = rewritten(run, tmp_path / "forged.mcap", form="1", verdict=[GONE])
    data = forged.read_bytes().replace(b'{"another":"form"}', b"null              ")
    forged.write_bytes(data)

    assert main(["replay", str(forged), "--out", str(tmp_path)]) == 6


@pytest.mark.parametrize(
    "command",
    [
        ("report", "RUN", "--out", "OUT.html"), ("export", "RUN", "-o", "OUT.csv"),
        ("diff", "RUN", "RUN"), ("damper", "RUN"),
        ("export", "RUN", "--what", "model", "-o", "OUT.json"),
    ],
)  # fmt: skip
def test_its_answer_is_not_used_until_it_is_replayed(command, run, tmp_path, capsys):
    other = rewritten(run, tmp_path / "other.mcap")
    capsys.readouterr()
    words = [w.replace("RUN", str(other)).replace("OUT", str(tmp_path / "o")) for w in command]

    assert main(words) == 6
    said = capsys.readouterr().err
    assert said == f"yawid: {other} is of another version of yawid: replay it first\n"
    assert list(tmp_path.iterdir()) == [other]


def cut(message):
    del message.field[-1]


def rename(message):
    message.field[2].name = "index"


def retype(message):
    message.field[2].type = descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE


def append(message):
    message.field.add(name="further", number=99, type=1, label=1)


@pytest.mark.parametrize("change", [cut, rename, retype, append])
def test_samples_with_other_columns_are_refused_and_not_misread(change, run, tmp_path, capsys):
    other = rewritten(run, tmp_path / "other.mcap", change=change)
    capsys.readouterr()

    assert main(["replay", str(other), "--out", str(tmp_path / "out")]) == 6
    said = capsys.readouterr().err
    assert f"{other}: yawid.Sample is of another version of yawid: replay the log itself" in said
    assert not list((tmp_path / "out").glob("*"))
