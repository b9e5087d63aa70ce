from __future__ import annotations

import errno
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.components import AggregationPolicy
from sinks.rerun.rerun_reading import VIEWER, fail, recorded, save, statics, values
from sinks.sink_blocks import (
    FLIGHT,
    GRID,
    SAMPLE_TIME_S,
    SUMMARY,
    Blocks,
    make_blocks,
    make_manoeuvre,
    run_script,
    unanswered,
)

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, DutchRoll
from yawid.blocks import Held, Noted, Status
from yawid.errors import SinkError
from yawid.sinks.base import Abort, Done, Found, FoundBare, RunRows
from yawid.sinks.palette import BAD, BARE, METHODS, RUDDER
from yawid.sinks.rerun.sink import RerunSink


def known(blocks: Blocks) -> Blocks:
    """The blocks with parameters and a Dutch roll known well enough to be drawn."""
    samples, estimates, modes = blocks
    for each in estimates.values():
        each.theta_std[:] *= 1e-9
    wn = 2.0 + np.arange(len(samples)) / len(samples)
    roll = np.column_stack([wn, 0.05 * wn, 0.1 * wn, 0.02 * wn])
    return samples, estimates, replace(modes, dutch_roll=roll)


def test_the_saved_recording_holds_every_sample_on_both_clocks(tmp_path: Path) -> None:
    samples, estimates, modes = known(make_blocks(n=2500))
    entities = recorded(save(tmp_path / "a.rrd", (samples, estimates, modes)))
    els = estimates["els"]
    live = els.status != Status.WARMING_UP
    # Measured last, so that it lies above.
    yaw_rate = np.column_stack([np.where(live, els.y_hat, np.nan), samples.y])
    np.testing.assert_array_equal(values(entities, "/input"), samples.u)
    np.testing.assert_array_equal(values(entities, "/yaw_rate"), yaw_rate)
    theta = np.where(live[:, None], els.theta, np.nan)
    drawn = [values(entities, f"/parameters/{letter}") for letter in "abc"]
    a, b, c = (each[:, : each.shape[1] // 3] for each in drawn)
    # PARAMETERS: a1 a2 b1 b2 c1 bias; the bias is drawn with b.
    np.testing.assert_array_equal(np.hstack([a, b[:, :2], c, b[:, 2:]]), theta)
    np.testing.assert_array_equal(values(entities, "/dutch_roll/wn")[:, 0], modes.dutch_roll[:, 0])
    boot = np.sort(entities["/input"]["boot_time"]) // 1000
    np.testing.assert_array_equal(boot, samples.boot_us)
    unix = sorted(entities["/input"]["unix_time"])
    assert unix == samples.unix_ns.tolist()


def test_bands_are_two_sigma_on_either_side(tmp_path: Path) -> None:
    blocks = known(make_blocks(n=50))
    entities = recorded(save(tmp_path / "a.rrd", blocks))
    els = blocks[1]["els"]
    innovation = values(entities, "/innovation")
    np.testing.assert_array_equal(innovation[:, 0], els.innovation)
    np.testing.assert_allclose(innovation[:, 1:], np.outer(els.noise_std, [-2, 2]))
    wn, lower, upper = values(entities, "/dutch_roll/wn").T
    np.testing.assert_allclose(upper - lower, 4 * blocks[2].dutch_roll[:, 1])
    np.testing.assert_allclose(upper - wn, wn - lower)


def test_a_dutch_roll_that_is_not_known_leaves_its_lines_open(tmp_path: Path) -> None:
    samples, estimates, modes = known(make_blocks(n=50))
    modes.dutch_roll[20:30, 1] = modes.dutch_roll[20:30, 0]
    modes.dutch_roll[40:, 3] = 0.5
    entities = recorded(save(tmp_path / "a.rrd", (samples, estimates, modes)))
    for name in ("wn", "zeta"):
        line = values(entities, f"/dutch_roll/{name}")
        assert np.flatnonzero(np.isnan(line[:, 0])).tolist() == [*range(20, 30), *range(40, 50)]


def test_the_other_method_s_dutch_roll_is_drawn_over_time_in_its_own_colour(
    tmp_path: Path,
) -> None:
    samples, estimates, modes = known(make_blocks(n=100))
    rml = estimates["rml"]
    s = 2.0 * np.exp(1j * np.arccos(-0.3))
    z = np.exp(s * SAMPLE_TIME_S)
    rows = rml.rows.copy()
    rows[:, :4] = -2.0 * z.real, abs(z) ** 2, 0.5, 0.3
    estimates = estimates | {"rml": replace(rml, rows=rows)}
    path = save(tmp_path / "a.rrd", (samples, estimates, modes))
    entities = recorded(path)
    twice_a_second = samples.k % round(0.5 / SAMPLE_TIME_S) == 0
    live = rml.status != Status.WARMING_UP
    for name, value in (("wn", 2.0), ("zeta", 0.3)):
        line = np.array(entities[f"/dutch_roll/{name}/rml"]["Scalars:scalars"])
        assert len(line) == (twice_a_second & live).sum() > 3
        np.testing.assert_allclose(line, value, rtol=1e-9)
        colours = [
            statics(path, f"/dutch_roll/{name}{method}", "SeriesLines:colors")[0][0]
            for method in ("", "/rml")
        ]
        assert [f"#{colour >> 8:06x}" for colour in colours] == [METHODS["els"], METHODS["rml"]]


def test_lines_have_a_name_a_colour_and_a_unit(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=10))
    [names] = statics(path, "/parameters/b", "SeriesLines:names")
    assert names == ["b1", "b2", "bias", *["2 sigma of noise"] * 6]
    assert statics(path, "/input", "SeriesLines:names") == [["rudder [half-travel]"]]
    in_rad = RerunSink("save", name="flight", warn=fail, path=tmp_path / "b.rrd")
    in_rad.take(replace(GRID, inputs=("rudder", "aileron"), rudder_unit="rad"))
    in_rad.take(Done(SUMMARY, {}))
    named = statics(tmp_path / "b.rrd", "/input", "SeriesLines:names")
    assert named == [["rudder [rad]", "aileron [half-travel]"]]
    for entity, columns in recorded(path).items():
        if "Scalars:scalars" in columns:
            [colours] = statics(path, entity, "SeriesLines:colors")
            assert len(colours) == len(columns["Scalars:scalars"][0])


def test_every_line_is_drawn_from_its_least_to_its_greatest_value_within_a_pixel(
    tmp_path: Path,
) -> None:
    """The viewer's own way is the mean of a pixel: a doublet would be half as large."""
    samples, estimates, modes = known(make_blocks(n=200))
    sink = RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    sink.take(GRID)
    sink.take(RunRows(samples, estimates, modes))
    for usable in (True, False):
        found, span_ns = make_manoeuvre(samples, 20, 60)
        verdict = msgspec.structs.replace(found.verdict, usable=usable)
        sink.take(Found(msgspec.structs.replace(found, verdict=verdict), span_ns))
    sink.take(Done(SUMMARY, {}))

    drawn = {
        entity
        for entity, columns in recorded(tmp_path / "a.rrd").items()
        if "Scalars:scalars" in columns
    }
    assert {"/input", "/innovation", "/dutch_roll/wn/rml", "/dutch_roll/wn/refused"} <= drawn
    for entity in drawn:
        policy = statics(tmp_path / "a.rrd", entity, "SeriesLines:aggregation_policy")
        assert policy == [[AggregationPolicy.MinMax.value]], entity


def test_held_stretches_status_and_mode_changes_are_lanes_over_time(tmp_path: Path) -> None:
    samples, estimates, modes = make_blocks(n=30)
    held = np.zeros(30, np.int64)
    held[10:13] = Held.GAP | Held.ON_GROUND
    noted = np.zeros(30, np.int64)
    noted[24:26], noted[26:28] = Noted.NOT_EXCITED, Noted.NOT_EXCITED | Noted.AIRSPEED_CHANGED
    mode = np.zeros(30)
    mode[:2], mode[5:20] = np.nan, 10.0
    samples = replace(samples, held=held, noted=noted, mode=mode)
    entities = recorded(save(tmp_path / "a.rrd", (samples, estimates, modes)))

    def lane(name: str) -> list[tuple[int, str]]:
        columns = entities[f"/state/{name}"]
        times = (t // 1000 for t in columns["boot_time"])
        states = (state for [state] in columns["StateChange:state"])
        found = sorted(zip(times, states, strict=True))
        return [(samples.boot_us.tolist().index(t), state) for t, state in found]

    assert lane("samples") == [
        (0, "used"),
        (10, "held: gap, on ground"),
        (13, "used"),
        (24, "used, not excited"),
        (26, "used, airspeed changed, not excited"),
        (28, "used"),
    ]
    assert lane("flight_mode") == [(0, "unknown"), (2, "MANUAL"), (5, "AUTO"), (20, "MANUAL")]
    assert lane("estimator")[0] == (0, "warming up")


def test_poles_are_drawn_where_the_roots_of_a_lie_with_the_imaginary_axis_up(
    tmp_path: Path,
) -> None:
    samples, estimates, modes = make_blocks(n=100)
    els = estimates["els"]
    z = 0.8 + 0.3j
    rows = els.rows.copy()
    rows[:, :2] = -2.0 * z.real, abs(z) ** 2
    estimates = estimates | {"els": replace(els, rows=rows)}
    columns = recorded(save(tmp_path / "a.rrd", (samples, estimates, modes)))["/z_plane/poles"]
    every_other = samples.k % round(2.0 / SAMPLE_TIME_S) == 0
    live = els.status != Status.WARMING_UP
    assert len(columns["LineStrips2D:strips"]) == (every_other & live).sum() > 1
    for strips in columns["LineStrips2D:strips"]:
        centres = {tuple(np.round(np.array(strip)[2], 5)) for strip in strips}
        assert centres == {(0.8, -0.3), (0.8, 0.3)}


def test_log_and_verdict_are_there_to_be_read(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=30))
    log = recorded(path)["/log"]
    assert log["TextLog:text"] == [["before the grid is known"], ["gap of 3 s"]]
    assert log["TextLog:level"] == [["INFO"], ["WARN"]]
    verdict = statics(path, "/verdict", "TextDocument:text")[-1][0]
    assert verdict.startswith("```\nverdict  NOT USABLE\n")
    for reason in SUMMARY.verdict.reasons:
        assert reason.text in verdict


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two manoeuvres, the second without an answer, told when all samples were there."""
    blocks = make_blocks(n=200)
    path = tmp_path_factory.mktemp("flown") / "a.rrd"
    sink = RerunSink("save", name="flight", warn=fail, path=path)
    sink.take(GRID)
    sink.take(RunRows(*blocks))
    first, second = make_manoeuvre(blocks[0], 20, 60), make_manoeuvre(blocks[0], 80, 130, n=2)
    sink.take(Found(*first))
    sink.take(Found(unanswered(second[0]), second[1]))
    found = [first[0], unanswered(second[0])]
    of = {"manoeuvres": found, "flight": FLIGHT, "verdict": FLIGHT.verdict}
    sink.take(Done(msgspec.structs.replace(SUMMARY, **of), {}))
    return path


def test_a_manoeuvre_is_a_state_of_its_lane_from_its_first_sample_to_its_last(flown: Path) -> None:
    samples, *_ = make_blocks(n=200)
    lane = recorded(flown)["/state/manoeuvre"]
    assert lane["StateChange:state"] == [["1 usable"], [""], ["2 not usable"], [""]]
    [*_, names] = statics(flown, "/state/manoeuvre", "StateConfiguration:values")
    [*_, colours] = statics(flown, "/state/manoeuvre", "StateConfiguration:colors")
    assert names == ["1 usable", "2 not usable"]
    assert [f"#{colour >> 8:06x}" for colour in colours] == [RUDDER, BAD]
    rows = [20, 60, 80, 130]
    assert [t // 1000 for t in lane["boot_time"]] == samples.boot_us[rows].tolist()
    assert lane["unix_time"] == samples.unix_ns[rows].tolist()


def test_the_dutch_roll_of_a_manoeuvre_is_a_bar_with_its_band_and_ends_with_it(
    flown: Path,
) -> None:
    samples, *_ = make_blocks(n=200)
    entities = recorded(flown)
    wn, zeta = (entities[f"/dutch_roll/{name}/manoeuvre"] for name in ("wn", "zeta"))
    for found, bar in ((wn, [10.2, 9.8, 10.6]), (zeta, [0.62, 0.56, 0.68])):
        np.testing.assert_allclose(found["Scalars:scalars"], [bar, bar, [np.nan] * 3])
        assert [t // 1000 for t in found["boot_time"][:2]] == samples.boot_us[[20, 60]].tolist()
        assert samples.unix_ns[60] < found["unix_time"][2] < samples.unix_ns[61]


def test_the_bar_of_a_manoeuvre_that_is_not_usable_is_of_one_colour_and_has_no_band(
    tmp_path: Path,
) -> None:
    samples, *_ = make_blocks(n=200)
    found, span_ns = make_manoeuvre(samples, 20, 60)
    verdict = msgspec.structs.replace(found.verdict, usable=False)
    sink = RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    sink.take(Found(msgspec.structs.replace(found, verdict=verdict), span_ns))
    sink.take(Done(SUMMARY, {}))
    entities = recorded(tmp_path / "a.rrd")
    assert "/dutch_roll/wn/manoeuvre" not in entities
    bar = entities["/dutch_roll/wn/refused"]["Scalars:scalars"]
    np.testing.assert_allclose(bar, [[10.2], [10.2], [np.nan]])
    [[colour]] = statics(tmp_path / "a.rrd", "/dutch_roll/wn/refused", "SeriesLines:colors")
    assert f"#{colour >> 8:06x}" == BAD


KNOWN = Bare(
    dutch_roll=DutchRoll(wn_rad_s=10.0, wn_std=0.3, zeta=0.6, zeta_std=0.02),
    used=[1], verdict=Verdict(usable=True, reasons=[]),
)  # fmt: skip
WHY = Reason("bare_unknown", "the aileron is a copy", weight="warning")
UNKNOWN = Bare(used=[2], verdict=Verdict(usable=False, reasons=[WHY]))


def test_the_bare_airframe_is_a_bar_next_to_its_manoeuvre_and_poles_and_cells(
    tmp_path: Path,
) -> None:
    """s = -6 +- 8i at 10 rad/s and 0.6, so that z = exp(-6 Ts) (cos 8 Ts +- i sin 8 Ts)."""
    samples, *rest = make_blocks(n=400)
    sink = RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    sink.take(GRID)
    sink.take(RunRows(samples, *rest))
    for n, known in ((1, KNOWN), (2, UNKNOWN)):
        found, span_ns = make_manoeuvre(samples, 100 * n, 100 * n + 60, n)
        sink.take(Found(found, span_ns))
        sink.take(FoundBare(n, known, span_ns))
    sink.take(Abort())

    path = tmp_path / "a.rrd.part"
    entities = recorded(path)
    line = entities["/dutch_roll/wn/bare"]
    np.testing.assert_allclose(line["Scalars:scalars"][:2], [[10.0, 9.4, 10.6]] * 2)
    assert np.isnan(line["Scalars:scalars"][2]).all()
    edges = [samples.boot_us[at] for at in (100, 160)]
    assert [t // 1000 for t in line["boot_time"]][:2] == edges
    assert len(line["boot_time"]) == 3  # of the second there is no number
    [colours] = statics(path, "/dutch_roll/wn/bare", "SeriesLines:colors")
    assert f"#{colours[0] >> 8:06x}" == BARE
    [crosses] = entities["/z_plane/bare"]["LineStrips2D:strips"]
    size, angle = np.exp(-6 * SAMPLE_TIME_S), 8 * SAMPLE_TIME_S
    middles = [np.mean(np.asarray(cross)[[0, 1]], axis=0) for cross in crosses]
    expected = [size * np.array([np.cos(angle), -side * np.sin(angle)]) for side in (1.0, -1.0)]
    np.testing.assert_allclose(middles, expected, atol=1e-6)
    [table] = statics(path, "/manoeuvres", "TextDocument:text")[-1]
    assert "\n1: the bare airframe: wn 10.00 ± 0.30 rad/s, zeta 0.600 ± 0.020\n" in table
    assert table.endswith("\n2: the bare airframe is not known: the aileron is a copy\n```\n")


def test_manoeuvres_are_a_table_and_the_verdict_is_the_terminals_page(flown: Path) -> None:
    [table] = statics(flown, "/manoeuvres", "TextDocument:text")[-1]
    assert [" ".join(line.split()) for line in table.splitlines()[:4]] == [
        "```",
        "n from-to s mode loop V m/s alt m wn rad/s zeta result",
        "1 6-8 FBWA roll 21.5 120 10.20±0.20 0.620±0.030 used",
        "2 9-12 - roll - - none none not_excited",
    ]
    assert "± is one sigma: noise, structure, scatter of manoeuvres" in table
    [verdict] = statics(flown, "/verdict", "TextDocument:text")[-1]
    assert verdict.startswith(
        "```\nverdict  usable\n  flight  wn 10.10 ± 0.15 rad/s, zeta 0.630 ± 0.020\n"
        "          noise alone: wn ± 0.02, zeta ± 0.003\n"
    )
    assert table.splitlines()[1] in verdict


def test_a_run_without_manoeuvres_has_no_table(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=30))
    assert statics(path, "/manoeuvres", "TextDocument:text")[-1] == ["```\nNo manoeuvre.\n```\n"]
    assert not any("manoeuvre" in entity for entity in recorded(path))


def test_an_aborted_recording_keeps_the_table_of_what_was_found(tmp_path: Path) -> None:
    samples, *_ = make_blocks(n=200)
    sink = RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    for n in (1, 2):
        sink.take(Found(*make_manoeuvre(samples, 50 * n, 50 * n + 20, n)))
    sink.take(Abort())
    [table] = statics(tmp_path / "a.rrd.part", "/manoeuvres", "TextDocument:text")[-1]
    assert table.count(" FBWA ") == 2


def test_the_recording_brings_its_picture_along_and_rerun_accepts_it(tmp_path: Path) -> None:
    path = save(tmp_path / "a.rrd", make_blocks(n=30))
    reader = RrdReader(path)
    [blueprint] = reader.blueprints()
    origins = {
        origin
        for chunk in reader.stream(store=blueprint).to_chunks()
        for batch in [chunk.to_record_batch()]
        if "ViewBlueprint:space_origin" in batch.schema.names
        for [origin] in batch.column("ViewBlueprint:space_origin").to_pylist()
    }
    flight = {"/input", "/yaw_rate", "/innovation", "/state"}
    learnt = {"/dutch_roll/wn", "/dutch_roll/zeta", *(f"/parameters/{x}" for x in "abc")}
    worth = {"/verdict", "/manoeuvres", "/log", "/z_plane"}
    hidden = {"/none"}  # holds the time range that all time axes share
    assert origins == flight | learnt | worth | hidden
    verify = [VIEWER, "rrd", "verify", str(path)]
    subprocess.run(verify, check=True, capture_output=True, timeout=60)


def test_an_aborted_recording_keeps_what_it_had(tmp_path: Path) -> None:
    sink = RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    sink.take(GRID)
    sink.take(RunRows(*make_blocks(n=30)))
    sink.take(Abort())
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
from sinks.sink_blocks import GRID, SUMMARY, make_blocks
from yawid.errors import SinkError
from yawid.sinks.rerun.sink import RerunSink
from yawid.sinks.base import Abort, Done, Found, FoundBare, RunRows
sink = RerunSink("save", name="flight", warn=print, path=Path(sys.argv[1]))
sink.take(GRID)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
try:
    sink.take(RunRows(*make_blocks(n=3000)))
    sink.take(Done(SUMMARY, {}))
except SinkError as error:
    print(error)
sink.take(Abort())
"""


def test_a_disk_that_fills_up_is_one_line_with_the_systems_reason(tmp_path: Path) -> None:
    """Rerun's own writer said that a flush had timed out, and the process then never ended"""
    path = tmp_path / "a.rrd"
    done = run_script(DISK_FILLS_UP, str(path))
    assert done.stdout == f"cannot write {path}.part: {os.strerror(errno.EFBIG)}\n"
    assert done.stderr == ""
    assert not path.exists()


def test_a_recording_that_rerun_refuses_is_one_line_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(SinkError, match="switched off"):
        RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    assert list(tmp_path.iterdir()) == []
