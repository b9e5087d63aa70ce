"""Records that never were MAVLink: a flight's by the grid of any log, a step's file by its own."""

from __future__ import annotations

import io
import json
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from hypothesis import given
from hypothesis import strategies as st
from places import ROOT

from yawid.blocks import RecordBlock, SampleBlock
from yawid.channels.stage import Channels
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, SourceError
from yawid.plant.excitation import Excitation
from yawid.plant.simulate import simulate_plant
from yawid.runs.step import read_step
from yawid.sinks.mcap.reader import McapRun, open_run
from yawid.sources.records.find_columns import Asked
from yawid.sources.records.record import Record

GAPS = ROOT / "replay_logs/c172p_gaps/log.tlog"


def samples_of(run: McapRun) -> SampleBlock:
    return SampleBlock.joined(list(run.samples()))


def assert_same(ours: SampleBlock, theirs: SampleBlock, *, but: str = "") -> None:
    for field in fields(SampleBlock):
        if field.name != but:
            columns = getattr(ours, field.name), getattr(theirs, field.name)
            np.testing.assert_array_equal(*columns, err_msg=field.name)


ROWS = st.lists(
    st.tuples(
        st.sampled_from([0.05, 0.05, 0.05, 0.1, 0.4, 0.0, 12.0]),
        st.one_of(st.none(), st.floats(-1.0, 1.0)),
        st.one_of(st.none(), st.floats(-1.0, 1.0)),
        st.sampled_from(["", "", "", "steep", "gap", "rudder_changed"]),
    ),
    min_size=20,
    max_size=150,
)


def channels_fed(blocks: list[RecordBlock]) -> list[SampleBlock]:
    channels = Channels(RunConfig())
    return [each for block in blocks for each in channels.feed_rows(block)] + channels.finish()


@given(
    rows=ROWS,
    told=st.booleans(),
    rudder_is=st.sampled_from(["measured", "commanded"]),
    back=st.sets(st.integers(0, 150), max_size=4),
    cuts=st.sets(st.integers(1, 200)),
)
def test_no_sample_depends_on_how_a_record_was_cut(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[float, float | None, float | None, str]],
    told: bool,
    rudder_is: str,
    back: set[int],
    cuts: set[int],
) -> None:
    path = tmp_path_factory.mktemp("cut") / "record.csv"
    lines, t = (
        ["t,rudder,r,roll,held" if told else "t,rudder,r,roll,note", "s,half-travel,rad/s,rad,"],
        10.0,
    )
    for i, (step, u, r, held) in enumerate([(0.05, 0.0, 0.0, "")] * 110 + rows):
        t += -1.5 if i - 110 in back else step
        u, r = (None, None) if told and held else (u, r)
        cells = ("" if each is None else repr(each) for each in (u, r))
        lines.append(f"{t:.3f},{','.join(cells)},{0.01 * (i % 7)},{held}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    record = Record(path)
    record.settle(Asked(rudder_is=rudder_is))
    whole = RecordBlock.joined([rows for _, rows in record.read() if rows])

    expected = channels_fed([whole])
    edges = sorted({0, len(whole), *(cut for cut in cuts if cut < len(whole))})
    found = channels_fed([whole.select(slice(a, b)) for a, b in pairwise(edges)])
    assert len(expected) > 0
    assert_same(SampleBlock.joined(found), SampleBlock.joined(expected))


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated flight as a test pilot's tools write it: uneven, in deg, trailing edge left."""
    excitation = Excitation(kind="3211", amplitude=0.05, start_s=5.0, unit_s=0.7, seed=0)
    plant = simulate_plant("yaw", excitation, duration_s=40.0, sample_time_s=0.01, noise_std=0.001)
    kept = np.random.default_rng(1).random(len(plant.t)) < 0.4
    columns = plant.t, -np.rad2deg(plant.u), np.rad2deg(plant.y)
    path = tmp_path_factory.mktemp("flight") / "flight.csv"
    rows = np.column_stack([each[kept] for each in columns])
    np.savetxt(path, rows, "%.6f", ";", header="t;delta_r_deg;YawRate [deg/s]", comments="")
    return path


NAMES = "--columns", "rudder=delta_r_deg,r=YawRate", "--rudder-sign", "nose-left"


def test_any_flight_test_is_answered_as_a_log_is(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(flight), "--out", str(tmp_path), "--json", *NAMES]) == 0

    found = json.loads(capsys.readouterr().out)
    (manoeuvre,) = found["manoeuvres"]
    # The plant's own: a_omega a_z + a_beta = 0.7 * 0.3 + 5.5.
    assert found["flight"]["dutch_roll"]["wn_rad_s"] == pytest.approx(np.sqrt(5.71), rel=0.01)
    assert found["flight"]["dutch_roll"]["zeta"] == pytest.approx(0.5 / np.sqrt(5.71), abs=0.01)
    assert manoeuvre["estimates"]["ct"]["physics"]["a_my_delta_h"]["value"] > 0.0
    assert "vehicle" not in found
    assert set(found["link"]) == {"reboots", "clock_steps", "gaps"}
    assert "date" not in manoeuvre
    rudder = found["channels"]["rudder"]
    assert rudder["source"] == "delta_r_deg [deg]"
    assert "travel is not known, its largest stroke within 5 s is 5.73 deg" in rudder["how"]
    assert found["channels"]["yaw"]["source"] == "YawRate [deg/s]"

    run = replayed(tmp_path / "flight.mcap", tmp_path / "again")
    assert open_run(run).summary.manoeuvres == open_run(tmp_path / "flight.mcap").summary.manoeuvres
    assert open_run(run).grid.rudder_unit == "rad"


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_measured_deflections_are_exported_as_held_means_and_give_the_same_answer_again(
    flight: Path, tmp_path: Path, suffix: str
) -> None:
    options = "--also", "none"
    first = replayed(flight, tmp_path, *NAMES, *options)
    exported = tmp_path / f"means{suffix}"
    assert main(["export", str(first), "-o", str(exported)]) == 0
    again = replayed(exported, tmp_path, *options)

    ours, theirs = open_run(again), open_run(first)
    assert (ours.config.rudder_is, theirs.config.rudder_is) == ("commanded", "measured")
    assert ours.summary.channels["rudder"].measured is False
    assert theirs.summary.channels["rudder"].measured is True
    np.testing.assert_array_equal(samples_of(ours).u[:-1], samples_of(theirs).u[:-1])
    # What is held has one time of movement in a sample, what moves on lines all times of it.
    held, lines = (run.summary.manoeuvres[0].answer.dutch_roll for run in (ours, theirs))
    assert abs(held.wn_rad_s - lines.wn_rad_s) < 0.02 * lines.wn_std
    assert abs(held.zeta - lines.zeta) < 0.02 * lines.zeta_std


def test_its_sign_is_the_options_inspect_says_the_command_and_a_log_has_other_options(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inspected, out = ["inspect", str(flight), "--json", *NAMES], ["--out", str(tmp_path)]
    assert main(inspected) == main([*inspected[:-1], "nose-right"]) == 0
    left, right = map(json.loads, capsys.readouterr().out.splitlines())
    assert "--columns rudder=delta_r_deg,r=YawRate" in left["command"]
    assert "--rudder-sign nose-left" in left["command"]
    assert "wrong_sign" in [reason["id"] for reason in right["verdict"]["reasons"]]

    assert main(["replay", str(GAPS), "--units", "deg", *out]) == 2
    assert main(["replay", str(flight), "--rudder", "servo:4", *out]) == 2
    of_log, of_record = capsys.readouterr().err.splitlines()
    assert "--units is for CSV and Parquet" in of_log
    assert "--columns rudder=COLUMN" in of_record
    assert list(tmp_path.iterdir()) == []


def test_a_rudder_at_rest_is_not_excited_whatever_its_travel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.column_stack([np.arange(0.0, 30.0, 0.05), np.full(600, 2.0), np.sin(np.arange(600))])
    np.savetxt(tmp_path / "a.txt", rows, "%.4f", header="t rudder_deg r_deg_s")
    replay = ["replay", str(tmp_path / "a.txt"), "--out", str(tmp_path), "--rudder-sign"]

    assert main([*replay, "nose-right", "--json"]) == 5
    reason = json.loads(capsys.readouterr().out)["verdict"]["reasons"][0]
    assert reason["id"] == "not_excited"
    assert "its travel is not known" in reason["text"]


@pytest.mark.parametrize(
    ("header", "assumed"),
    [("r", "r"), ("r [rad/s]", ""), ("r,roll", "r, roll"), ("r [rad/s],roll", "roll")],
)
def test_a_unit_that_nothing_says_is_rad_and_a_warning_that_stays(
    header: str, assumed: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(0.0, 30.0, 0.05)
    rows = np.column_stack([t, np.sin(3.0 * t), *[0.2 * np.cos(3.0 * t)] * len(header.split(","))])
    names = f"t,rudder [half-travel],{header}"
    np.savetxt(tmp_path / "a.csv", rows, "%.4f", ",", header=names, comments="")

    for log in ("a.csv", "a.mcap"):  # the run's own file says it too
        out = tmp_path if log == "a.csv" else tmp_path / "again"
        assert main(["replay", str(tmp_path / log), "--out", str(out), "--json"]) in (0, 5)
        reasons = json.loads(capsys.readouterr().out)["verdict"]["reasons"]
        texts = [each["text"] for each in reasons if each["id"] == "unit_assumed"]
        expected = f"the unit of {assumed} is not given: rad and rad/s are assumed"
        assert texts == ([expected] if assumed else [])


def test_who_names_the_unit_of_a_yaw_rate_that_could_be_either_is_answered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same numbers by both readings: K differs by 180/pi, as arithmetic says."""
    t = np.arange(0.0, 30.0, 0.05)
    u = np.sign(np.sin(2.5 * t)) * ((t > 8) & (t < 20))
    r = np.convolve(u, 0.02 * np.exp(-t) * np.sin(2.4 * t))[: len(t)]
    r *= 2.0 / np.abs(r).max()
    table = np.column_stack([t, u, r])
    np.savetxt(tmp_path / "a.csv", table, "%.6f", ",", header="t,rudder,r", comments="")
    replay = ["replay", str(tmp_path / "a.csv"), "--rudder-unit", "half-travel", "--json"]

    assert main([*replay, "--out", str(tmp_path / "none")]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert "'r=r[deg/s]'" in said.err
    gains = []
    for unit in ("rad/s", "deg/s"):
        main([*replay, "--out", str(tmp_path / unit[:3]), "--columns", f"r=r[{unit}]"])
        told = json.loads(capsys.readouterr().out)
        assert "unit_assumed" not in [each["id"] for each in told["verdict"]["reasons"]]
        gains.append(told["estimates"]["els"]["theta"]["b1"])
    assert gains[0] / gains[1] == pytest.approx(180.0 / np.pi, rel=1e-4)


STEP = "t,u,y\n0,0,0\n1,0,0\n2,0.1,0\n3,0.1,1\n"
T, Y = [0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        (STEP, {}, (T, Y, 0.1, 2.0)),
        (STEP, {"u0": 2.0}, (T, Y, 2.0, 2.0)),
        # By name, in any spelling, with a note, a byte order mark, an empty line and a gap.
        (
            "\ufeff y , note, T\r\n1.5,a,0\r\n\r\n,b,0.1\r\n-2e-3,c,0.2\r\n", {"u0": 1.0},
            ([0.0, 0.1, 0.2], [1.5, np.nan, -2e-3], 1.0),
        ),
        (
            "# flown today\nt;y\ns;rad/s\n0;0,5\n0,1;0,25\n", {"u0": 1.0},
            ([0.0, 0.1], [0.5, 0.25], 1.0),
        ),
    ],
)  # fmt: skip
def test_t_and_y_are_read_by_name_and_u_says_the_height_and_time_of_its_step(
    text: str, options: dict[str, float], expected: tuple[Any, ...], tmp_path: Path, monkeypatch
):
    (tmp_path / "step.csv").write_text(text, encoding="utf-8", newline="")
    stdin = io.TextIOWrapper(io.BytesIO(text.encode()), encoding="utf-8")
    monkeypatch.setattr("sys.stdin", stdin)
    for place in (tmp_path / "step.csv", Path("-")):  # a dash is standard input
        found = read_step(place, **options)
        for ours, theirs in zip(found, expected, strict=False):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no line of numbers below a line with names"),
        ("0,1\n0.1,2\n", "numbers below 0 lines of a header"),
        ("a,b\n0,1\n0.1,2\n", "name one column t and one y"),
        ("t,y,y\n0,1,2\n", "name one column t and one y"),
        ("t,y\n0,1\n0.1,two\n", "line 3, column 2 .y.: 'two' is not a number"),
        ("t,y,u\n0,1,0\n1,1\n", "line 3: 2 cells, the header has 3"),
        ("\0\1\2", "no line of numbers below a line with names"),
        ("t,u,y\n0,0,0\n1,0.1,0\n2,0,0\n", "changes 2 times"),
    ],
)
def test_a_file_that_is_no_step_response_is_refused_with_its_place(
    text: str, message: str, tmp_path: Path
):
    (tmp_path / "step.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_step(tmp_path / "step.csv")
    with pytest.raises(SourceError, match=r"cannot read .*absent\.csv"):
        read_step(tmp_path / "absent.csv")
