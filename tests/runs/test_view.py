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
    own, view = run.with_suffix(".rrd"), tmp_path / "view.rrd"
    assert main(["view", str(run), "--out", str(view)]) == 0

    saved, viewed = recorded(own), recorded(view)
    assert saved.keys() == viewed.keys()
    assert len(saved) > 10
    assert saved["/state/manoeuvre"]["StateChange:state"] == [["1 usable"], [""]]
    for entity, columns in saved.items():
        for name in columns:
            if ":" in name or name in ("boot_time", "unix_time"):
                rows = [sorted(map(str, side[name])) for side in (columns, viewed[entity])]
                assert rows[0] == rows[1], f"{entity} {name}"
    texts = [statics(path, "/verdict", "TextDocument:text")[-1] for path in (own, view)]
    assert texts[0] == texts[1]
    assert re.match("```\nverdict  usable\n  flight  wn 2.4", texts[0][0])


ROWS = [100, 150, 200, 300]


@pytest.mark.parametrize("date", [None, "2001-09-09T01:46:40Z", "yesterday"])
def test_manoeuvres_are_shown_at_their_samples_else_where_their_date_says_or_not_at_all(
    date: str | None, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples, view = next(open_run(run).samples()), tmp_path / "view.rrd"
    found = [make_manoeuvre(samples, *ROWS[n : n + 2], n // 2 + 1)[0].to_json() for n in (0, 2)]
    found[0]["date"] = date or found[0]["date"]  # which is rounded
    told = {"manoeuvres": found, "flight": FLIGHT.to_json(), "flights": [FLIGHT.to_json()]}
    flown = forge(run, tmp_path / "flown.mcap", summary=lambda summary: summary | told)
    code = main(["view", str(flown), "--out", str(view)])
    if date == "yesterday":
        [error] = capsys.readouterr().err.splitlines()
        assert "is not a file as yawid writes it: the times of manoeuvre 1" in error
        assert (code, [path.name for path in tmp_path.iterdir()]) == (6, ["flown.mcap"])
        return
    lane = recorded(view)["/state/manoeuvre"]
    assert lane["StateChange:state"] == [["1 usable"], [""], ["2 usable"], [""]]
    assert [t // 1000 for t in lane["boot_time"]] == samples.boot_us[ROWS].tolist()
    dated = samples.unix_ns[ROWS].tolist()
    if date:  # its samples are lost
        dated[:2] = [10**18, 10**18 + 5 * 10**9]
    assert lane["unix_time"] == dated
    [table] = statics(view, "/manoeuvres", "TextDocument:text")[-1]
    assert table.count(" FBWA ") == 2


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("view RUN", "no screen"),
        ("view RUN --to rerun+http://127.0.0.1:9/proxy", "127.0.0.1:9"),
        ("view RUN --out mine", "mine exists: --force overwrites it"),
        ("view text.mcap --out x.rrd", "text.mcap"),
        ("report text.mcap", "text.mcap"),
        ("view missing.mcap --out x.rrd", "missing.mcap"),
        ("report missing.mcap", "missing.mcap"),
    ],
)
def test_what_cannot_be_shown_is_one_line_and_exit_code_6(
    command: str, said: str, run: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name in ("text.mcap", "mine"):
        Path(name).write_text("hello", encoding="utf-8")
    assert main(command.replace("RUN", str(run)).split()) == 6
    [error] = capsys.readouterr().err.splitlines()
    assert said in error
    assert {path.read_text(encoding="utf-8") for path in Path().iterdir()} == {"hello"}


@pytest.fixture(scope="module")
def told(run: Path) -> dict[str, set[str]]:
    """The fields of each topic by what the file says of itself, a slash before a field's field."""
    return {topic: fields_of(found[0][1]) for topic, found in decoded(run).items()}


def fields_of(message: Any, prefix: str = "") -> set[str]:
    if hasattr(message, "SHAPE"):
        return set(message.SHAPE["properties"])
    found = set()
    for field in message.DESCRIPTOR.fields:
        found.add(prefix + field.name)
        if field.message_type is not None and not field.is_repeated:
            found |= fields_of(getattr(message, field.name), f"{prefix}{field.name}/")
    return found


def test_every_curve_of_the_plotjuggler_layout_is_in_a_run_every_topic_is_drawn_in_our_colours(
    told: dict[str, set[str]],
):
    root = ET.parse(PLOTJUGGLER).getroot()
    made = {each.get("name") for each in root.iter("snippet")}
    sources = {each.text for tag in ("linked_source", "v1") for each in root.iter(tag)}
    colours = {each.get("name"): each.get("color") for each in root.iter("curve")}
    curves = sources | colours.keys() - made
    assert len(curves) > 30
    assert curves <= {f"{topic}/{field}" for topic, fields in told.items() for field in fields}
    drawn = {topic for topic in told if any(name.startswith(f"{topic}/") for name in curves)}
    assert told.keys() - drawn <= {"/yawid/log", "/yawid/mode"}
    [chosen] = {each.get("selected_topics") for each in root.iter("parameters")}
    assert told.keys() - {"/yawid/log"} <= set(chosen.split(";"))
    names = ("sample/yaw_rate", "estimate/y_hat", "sample/rudder")
    assert [colours[f"/yawid/{name}"] for name in names] == [DATA, MODEL, RUDDER]


def test_every_field_of_the_foxglove_layout_is_in_a_run_every_topic_is_drawn_in_our_colours(
    told: dict[str, set[str]],
):
    layout = json.loads(FOXGLOVE.read_text(encoding="utf-8"))
    paths = re.findall(r'"/yawid/[^"]+"', json.dumps(layout["configById"]))
    drawn = [path.strip('"').partition(".") for path in paths]
    assert len(drawn) > 30
    assert {topic for topic, *_ in drawn} == {*told, "/yawid/log"}
    assert all(not field or field.replace(".", "/") in told[topic] for topic, _, field in drawn)
    panels = re.findall(r'"([A-Za-z]+![a-z_]+)"', json.dumps(layout["layout"]))
    assert sorted(panels) == sorted(layout["configById"])
    lines = layout["configById"]["Plot!yaw_rate"]["paths"]
    assert [path["color"] for path in lines] == [DATA, MODEL]
