"""``yawid view``: a finished MCAP in Rerun, with the picture of the run itself."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from finished_runs import replayed
from forged_runs import forge
from places import C172P, SRC
from sinks.mcap.mcap_reading import decoded
from sinks.rerun.rerun_reading import recorded, statics
from sinks.sink_blocks import FLIGHT, make_manoeuvre

from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.palette import DATA, MODEL, RUDDER

FOXGLOVE, PLOTJUGGLER = (SRC / "layouts" / name for name in ("foxglove.json", "plotjuggler.xml"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    return replayed(C172P, folder, "--rate", 10, "--rerun", "save")


def test_the_view_of_a_run_is_the_recording_the_run_would_have_saved(
    run: Path, tmp_path: Path
) -> None:
    assert main(["view", str(run), "--out", str(tmp_path / "view.rrd")]) == 0

    saved, viewed = recorded(run.with_suffix(".rrd")), recorded(tmp_path / "view.rrd")
    assert saved.keys() == viewed.keys()
    assert len(saved) > 10
    assert saved["/state/manoeuvre"]["StateChange:state"] == [["1 usable"], [""]]
    for entity, columns in saved.items():
        names = [name for name in columns if ":" in name or name in ("boot_time", "unix_time")]
        for name in names:
            rows = [sorted(map(str, side[name])) for side in (columns, viewed[entity])]
            assert rows[0] == rows[1], f"{entity} {name}"
    for path in (run.with_suffix(".rrd"), tmp_path / "view.rrd"):
        [text] = statics(path, "/verdict", "TextDocument:text")[-1]
        assert text.startswith("```\nverdict  usable\n")
        assert "  flight  wn 2.4" in text


def with_manoeuvres(run: Path, out: Path, date: str | None = None) -> Path:
    """The run with two manoeuvres and a flight's answer in its summary."""
    samples = next(open_run(run).samples())
    rows = [(100, 150), (200, 300)]
    found = [make_manoeuvre(samples, *row, n)[0].to_json() for n, row in enumerate(rows, start=1)]
    if date is not None:
        found[0]["date"] = date
    told = {"manoeuvres": found, "flight": FLIGHT.to_json(), "flights": [FLIGHT.to_json()]}
    return forge(run, out, summary=lambda summary: summary | told)


def test_manoeuvres_are_shown_at_the_very_samples_though_their_dates_are_rounded(
    run: Path, tmp_path: Path
) -> None:
    flown = with_manoeuvres(run, tmp_path / "flown.mcap")
    assert main(["view", str(flown), "--out", str(tmp_path / "view.rrd")]) == 0

    samples = next(open_run(run).samples())
    lane = recorded(tmp_path / "view.rrd")["/state/manoeuvre"]
    assert lane["StateChange:state"] == [["1 usable"], [""], ["2 usable"], [""]]
    assert [t // 1000 for t in lane["boot_time"]] == samples.boot_us[[100, 150, 200, 300]].tolist()
    assert lane["unix_time"] == samples.unix_ns[[100, 150, 200, 300]].tolist()
    [table] = statics(tmp_path / "view.rrd", "/manoeuvres", "TextDocument:text")[-1]
    assert table.count(" FBWA ") == 2


def test_a_manoeuvre_whose_samples_are_lost_is_shown_where_its_date_says(
    run: Path, tmp_path: Path
) -> None:
    lost = with_manoeuvres(run, tmp_path / "lost.mcap", date="2001-09-09T01:46:40Z")
    assert main(["view", str(lost), "--out", str(tmp_path / "view.rrd")]) == 0
    lane = recorded(tmp_path / "view.rrd")["/state/manoeuvre"]
    assert lane["unix_time"][:2] == [10**18, 10**18 + 5 * 10**9]


def test_a_manoeuvre_with_a_date_that_is_none_is_one_line(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = with_manoeuvres(run, tmp_path / "bad.mcap", date="yesterday")
    assert main(["view", str(bad), "--out", str(tmp_path / "view.rrd")]) == 6
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "is not a file as yawid writes it: the times of manoeuvre 1" in error
    assert [path.name for path in tmp_path.iterdir()] == ["bad.mcap"]


def test_without_a_screen_it_is_one_line_and_exit_code_6(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(run)]) == 6
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no screen" in error
    assert "--out" in error


def test_a_viewer_that_does_not_listen_is_one_line_and_exit_code_6(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(run), "--to", "rerun+http://127.0.0.1:9/proxy"]) == 6
    assert capsys.readouterr().err.count("\n") == 1


def test_a_recording_that_exists_is_refused_without_force(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    path.write_bytes(b"precious")
    assert main(["view", str(run), "--out", str(path)]) == 6
    assert path.read_bytes() == b"precious"
    assert main(["view", str(run), "--out", str(path), "--force"]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["view.rrd"]


@pytest.mark.parametrize("damage", ["torn", "text", "missing", "foreign"])
def test_a_file_that_is_no_finished_run_is_one_line(
    run: Path, tmp_path: Path, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.mcap"
    if damage == "torn":
        path.write_bytes(run.read_bytes()[:50_000])
    elif damage == "text":
        path.write_text("hello", encoding="utf-8")
    elif damage == "foreign":
        from mcap.writer import Writer

        writer = Writer(str(path))
        writer.start()
        writer.finish()
    for command in (["view", str(path), "--out", str(tmp_path / "x.rrd")], ["report", str(path)]):
        assert main(command) == 6
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert str(path) in error
    assert sorted(p.name for p in tmp_path.iterdir()) in ([], ["bad.mcap"])


def read_as_others_do(run: Path) -> dict[str, set[str]]:
    """The fields of each topic by what the file says of itself, a dot before a field's field."""
    return {topic: fields_of(found[0][1]) for topic, found in decoded(run).items()}


def fields_of(message: Any, prefix: str = "") -> set[str]:
    if hasattr(message, "SHAPE"):
        return set(message.SHAPE["properties"])
    found = set()
    for field in message.DESCRIPTOR.fields:
        found.add(prefix + field.name)
        if field.message_type is not None and not field.is_repeated:
            found |= fields_of(getattr(message, field.name), f"{prefix}{field.name}.")
    return found


NOT_DRAWN = {"/yawid/log", "/yawid/mode"}


def test_every_curve_of_the_plotjuggler_layout_is_in_a_run_and_every_topic_is_drawn(run: Path):
    root = ET.parse(PLOTJUGGLER).getroot()
    made = {each.get("name") for each in root.iter("snippet")}
    sources = {each.text for tag in ("linked_source", "v1") for each in root.iter(tag)}
    curves = sources | {each.get("name") for each in root.iter("curve")} - made
    numbers = {
        f"{topic}/{field.replace('.', '/')}"
        for topic, fields in read_as_others_do(run).items()
        for field in fields
    }
    assert len(curves) > 30
    assert curves <= numbers
    topics = {name.partition("/parameters/")[0] + "/" for name in curves}
    for topic in read_as_others_do(run).keys() - NOT_DRAWN:
        assert any(name.startswith(f"{topic}/") for name in topics), topic
    [chosen] = {each.get("selected_topics") for each in root.iter("parameters")}
    assert read_as_others_do(run).keys() - {"/yawid/log"} <= set(chosen.split(";"))


def test_every_field_of_the_foxglove_layout_is_in_a_run_and_every_topic_is_drawn(run: Path):
    layout = json.loads(FOXGLOVE.read_text(encoding="utf-8"))
    paths = re.findall(r'"/yawid/[^"]+"', json.dumps(layout["configById"]))
    told = read_as_others_do(run)
    drawn = [path.strip('"').partition(".") for path in paths]
    assert len(drawn) > 30
    assert {topic for topic, *_ in drawn} == {*told, "/yawid/log"}
    assert all(not field or field in told[topic] for topic, _, field in drawn)
    panels = re.findall(r'"([A-Za-z]+![a-z_]+)"', json.dumps(layout["layout"]))
    assert sorted(panels) == sorted(layout["configById"])


def test_both_layouts_have_the_colours_of_all_pictures():
    foxglove = json.loads(FOXGLOVE.read_text(encoding="utf-8"))["configById"]["Plot!yaw_rate"][
        "paths"
    ]
    assert [path["color"] for path in foxglove] == [DATA, MODEL]
    curves = {each.get("name"): each.get("color") for each in ET.parse(PLOTJUGGLER).iter("curve")}
    assert curves["/yawid/sample/yaw_rate"] == DATA
    assert curves["/yawid/estimate/y_hat"] == MODEL
    assert curves["/yawid/sample/rudder"] == RUDDER
