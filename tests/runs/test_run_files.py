"""A run's file: replayed, viewed, replaced by another or not, whatever stands in its way."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from finished_runs import replayed
from forged_runs import forge
from places import C172P, REPLAY_LOGS, SRC
from sinks.mcap.mcap_reading import decoded, raw
from sinks.rerun.rerun_reading import recorded, statics
from sinks.sink_blocks import FLIGHT, make_manoeuvre

import yawid
from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.palette import DATA, MODEL, RUDDER

OPTIONS = ("--rate", "10", "--rerun", "save", "--ordinary", "off", "--lateral", "off")
OTHER = ("--orders", "4,4,2,1", "--memory", "100")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("run"), *OPTIONS)


@pytest.mark.parametrize(
    "options",
    [(), (*OTHER, "--method", "rml", "--also", "none"), ("--from", "50", "--to", "140")],
    ids=lambda options: " ".join(options) or "as it was",
)
def test_a_replay_of_a_run_equals_a_replay_of_its_log_to_the_bit(
    run: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    direct = replayed(C172P, tmp_path / "direct", *OPTIONS, *options)
    again = replayed(run, tmp_path / "again", *options)

    assert [(*each[:2], each[4]) for each in raw(again)] == [
        (*each[:2], each[4]) for each in raw(direct)
    ]
    ours, theirs = (open_run(each).summary.to_json() for each in (again, direct))
    for key in ("estimates", "verdict", "channels", "link", "vehicle", "duration_s", "flight"):
        assert ours[key] == theirs[key], key
    assert ours["manoeuvres"] == theirs["manoeuvres"] != []


def test_through_any_number_of_replays_the_log_is_named_and_an_option_takes_the_place_of_the_runs(
    run: Path, tmp_path: Path
) -> None:
    second = replayed(run, tmp_path / "second", "--memory", "10", "--manoeuvres", "off")
    third = replayed(second, tmp_path / "third")
    fourth = replayed(third, tmp_path / "fourth", "--memory", "60")
    one, two, three, four = (open_run(each).summary for each in (run, second, third, fourth))

    assert (three.source.log, three.source.sha256) == (one.log, one.sha256)
    assert three.log == str(second)
    assert three.estimates == two.estimates != one.estimates
    assert four.estimates == one.estimates


FOXGLOVE, PLOTJUGGLER = (SRC / "layouts" / name for name in ("foxglove.json", "plotjuggler.xml"))


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


OTHER = REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog"
WN = re.compile(r"^  flight  wn (\d\.\d+)", re.MULTILINE)
QUICK = ("flight.tlog", "--rate", "5", "--manoeuvres", "off")
PART = ("--to", "80")
"""Of a manoeuvre that lasts to the log's end: its answer takes a third of the time."""
RUN = Path("yawid-out/flight.mcap")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """The folder of the runs; next to it lie a log, flight.tlog, and another one of that name."""
    monkeypatch.chdir(tmp_path)
    Path("other").mkdir()
    shutil.copy(C172P, "flight.tlog")
    shutil.copy(OTHER, "other/flight.tlog")
    return tmp_path / "yawid-out"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_same_log_with_the_same_options_is_replaced_with_its_recording_and_its_report_alone(
    folder: Path, capsys
) -> None:
    assert main(["replay", *QUICK]) in (0, 5)
    made = list[dict[str, int]]()
    for more in ([], ["--json"]):
        assert main(["replay", *QUICK, "--rerun", "save", *more]) in (0, 5)
        assert main(["report", str(RUN)]) == 0
        made.append({name: (folder / name).stat().st_ino for name in names(folder)})
    assert list(made[0]) == list(made[1]) == ["flight.html", "flight.mcap", "flight.rrd"]
    assert all(made[1][name] != inode for name, inode in made[0].items())
    assert capsys.readouterr().err == ""

    assert main(["replay", *QUICK, "--memory", "30"]) in (0, 5)
    kept = (folder / "flight.html").read_bytes()
    other = ["report", "yawid-out/flight-2.mcap", "-o", "yawid-out/flight.html"]
    assert main(other) == 6
    assert "flight.html exists: --force overwrites it" in capsys.readouterr().err
    assert (folder / "flight.html").read_bytes() == kept


def test_other_options_get_a_number_each_and_a_line_says_so(folder: Path, capsys) -> None:
    for options, number in (
        ("", ""), ("--rate 10", "-2"), ("--memory 30", "-3"), ("--rate 10", "-2"), ("", ""),
    ):  # fmt: skip
        assert main(["replay", "flight.tlog", *PART, *options.split()]) == 0
        said = capsys.readouterr()
        assert WN.search(said.out)
        assert f"{folder / f'flight{number}.mcap'}\n" in said.out
        assert (f"this is flight{number}.mcap" in said.err) == bool(number)

    assert names(folder) == ["flight-2.mcap", "flight-3.mcap", "flight.mcap"]
    runs = [yawid.load(folder / name).config for name in names(folder)]
    assert [(each.rate, each.memory) for each in runs[:2]] == [(10.0, 60.0), (runs[2].rate, 30.0)]


def test_frames_that_a_key_leaves_out_are_another_option(folder: Path) -> None:
    shutil.copy(REPLAY_LOGS / "c172p_signed" / "log.tlog", "flight.tlog")
    Path("key").write_text("00" * 32, encoding="utf-8")
    for _ in range(2):
        main(["replay", "flight.tlog", *PART])
        assert main(["replay", "flight.tlog", *PART, "--signing-key-file", "key"]) == 3

    assert names(folder) == ["flight-2.mcap", "flight.mcap"]


def test_another_log_is_answered_and_not_written_unless_forced(folder: Path, capsys) -> None:
    main(["replay", "flight.tlog", *PART, "--rerun", "save"])
    kept, first = RUN.read_bytes(), WN.search(capsys.readouterr().out)[1]
    for more in ([], ["--report"]):
        assert main(["replay", "other/flight.tlog", *PART, *more]) == 6
        said = capsys.readouterr()
        assert WN.search(said.out)[1] != first
        assert "mcap  " not in said.out
        assert "flight.mcap exists and is of another log: --force overwrites it" in said.err
        assert (RUN.read_bytes(), names(folder)) == (kept, ["flight.mcap", "flight.rrd"])

    assert main(["replay", "other/flight.tlog", *PART, "--force"]) == 0
    said = "of another run than flight.mcap will be, and kept: flight.rrd"
    assert said in capsys.readouterr().err
    assert yawid.load(RUN).summary.log.endswith("other/flight.tlog")


def test_a_file_that_is_no_run_stays_and_the_answer_is_printed_as_json_too(
    folder: Path, capsys
) -> None:
    folder.mkdir()
    RUN.write_text("mine", encoding="utf-8")

    assert main(["replay", "flight.tlog", *PART, "--json"]) == 6

    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert (answer["verdict"]["usable"], "files" in answer) == (True, False)
    assert "flight.mcap exists and is no run of this log: --force overwrites it" in said.err
    assert RUN.read_text(encoding="utf-8") == "mine"


def test_a_run_that_is_replayed_is_not_replaced_by_itself_but_may_have_another_next_to_it(
    folder: Path, capsys
) -> None:
    main(["replay", "flight.tlog", *PART])
    kept = RUN.read_bytes()
    for options, code in (([], 6), (["--force"], 6), (["--orders", "2,2,2,1"], 0)):
        capsys.readouterr()
        assert main(["replay", str(RUN), *options]) == code
        said = capsys.readouterr()
        assert "wn " in said.out
        assert ("choose another --out" in said.err) == (code == 6)

    assert names(folder) == ["flight-2.mcap", "flight.mcap"]
    assert RUN.read_bytes() == kept
