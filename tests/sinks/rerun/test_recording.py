"""What a saved recording shows: every line, lane, bar and text of a run, on both clocks."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.components import AggregationPolicy
from sinks.rerun.rerun_reading import VIEWER, fail, recorded, statics, values
from sinks.sink_blocks import (
    FLIGHT,
    GRID,
    SAMPLE_TIME_S,
    START_NS,
    SUMMARY,
    Blocks,
    make_blocks,
    make_manoeuvre,
    unanswered,
)

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, DutchRoll
from yawid.blocks import Held, Noted, Status
from yawid.errors import SinkError
from yawid.sinks.base import Done, Event, Found, FoundBare, LogLine, RunRows
from yawid.sinks.palette import BAD, BARE, METHODS, RUDDER
from yawid.sinks.rerun.sink import RerunSink

ROWS, SPANS = 1200, [(20, 60), (80, 130), (140, 180)]
"""More rows than one batch; the first and last row of each manoeuvre."""
POLE = 0.8 + 0.3j
OF_RML = np.exp(2.0 * np.exp(1j * np.arccos(-0.3)) * SAMPLE_TIME_S)
"""The pole in the z plane of wn 2 rad/s and zeta 0.3."""
KNOWN = Bare(
    dutch_roll=DutchRoll(wn_rad_s=10.0, wn_std=0.3, zeta=0.6, zeta_std=0.02),
    used=[1], verdict=Verdict(usable=True, reasons=[]),
)  # fmt: skip
WHY = Reason("bare_unknown", "the aileron is a copy", weight="warning")
UNKNOWN = Bare(used=[2], verdict=Verdict(usable=False, reasons=[WHY]))


class Flown(NamedTuple):
    """A recording, its columns by entity, and what was written."""

    path: Path
    entities: dict[str, dict[str, Any]]
    blocks: Blocks


def flown_blocks() -> Blocks:
    """Blocks with known parameters and Dutch roll, but for two stretches; with lanes and poles."""
    samples, estimates, modes = make_blocks(n=ROWS)
    held, noted, mode = (np.zeros(ROWS, kind) for kind in (np.int64, np.int64, float))
    held[10:13] = Held.GAP | Held.ON_GROUND
    noted[24:26], noted[26:28] = Noted.NOT_EXCITED, Noted.NOT_EXCITED | Noted.AIRSPEED_CHANGED
    mode[:2], mode[5:20] = np.nan, 10.0
    for method, z in (("els", POLE), ("rml", OF_RML)):
        rows = estimates[method].rows.copy()
        rows[:, :4] = -2.0 * z.real, abs(z) ** 2, 0.5, 0.3
        estimates[method] = replace(estimates[method], rows=rows)
        estimates[method].theta_std[:] *= 1e-9
    wn = 2.0 + np.arange(ROWS) / ROWS
    roll = np.column_stack([wn, 0.05 * wn, 0.1 * wn, 0.02 * wn])
    roll[20:30, 1], roll[40:50, 3] = wn[20:30], 0.5
    samples = replace(samples, held=held, noted=noted, mode=mode)
    return samples, estimates, replace(modes, dutch_roll=roll)


def save(path: Path, *events: Event) -> Path:
    sink = RerunSink("save", name="flight", warn=fail, path=path)
    for event in events:
        sink.take(event)
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Manoeuvres: one with a known bare airframe, one without an answer, one not usable."""
    blocks = flown_blocks()
    found, spans_ns = zip(
        *(make_manoeuvre(blocks[0], *span, n) for n, span in enumerate(SPANS, 1)), strict=True
    )
    bad = msgspec.structs.replace(found[2].verdict, usable=False)
    every = [found[0], unanswered(found[1]), msgspec.structs.replace(found[2], verdict=bad)]
    of = {"manoeuvres": every, "flight": FLIGHT, "verdict": FLIGHT.verdict}
    path = save(
        tmp_path_factory.mktemp("flown") / "a.rrd",
        LogLine(START_NS, "info", "before the grid is known"), GRID, RunRows(*blocks),
        *map(Found, every, spans_ns),
        FoundBare(1, KNOWN, spans_ns[0]), FoundBare(2, UNKNOWN, spans_ns[1]),
        LogLine(int(blocks[0].unix_ns[5]), "warning", "gap of 3 s"),
        Done(msgspec.structs.replace(SUMMARY, **of), {}),
    )  # fmt: skip
    return Flown(path, recorded(path), blocks)


@pytest.fixture(scope="module")
def in_rad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two inputs without a manoeuvre, which is not usable."""
    grid = replace(GRID, inputs=("rudder", "aileron"), rudder_unit="rad")
    rows = RunRows(*make_blocks(n=30, n_inputs=2))
    return save(tmp_path_factory.mktemp("rad") / "b.rrd", grid, rows, Done(SUMMARY, {}))


def colours_of(path: Path, entity: str) -> list[str]:
    [colours] = statics(path, entity, "SeriesLines:colors")
    return [f"#{colour >> 8:06x}" for colour in colours]


def text_of(path: Path, entity: str) -> list[str]:
    return [text for [text] in statics(path, entity, "TextDocument:text")]


def test_every_sample_is_there_on_both_clocks_with_bands_of_two_sigma(flown: Flown) -> None:
    _, entities, (samples, estimates, modes) = flown
    els, wn = estimates["els"], modes.dutch_roll[:, 0]
    live = els.status != Status.WARMING_UP
    theta = np.where(live[:, None], els.theta, np.nan)
    a, b, c = (values(entities, f"/parameters/{letter}") for letter in "abc")
    # PARAMETERS: a1 a2 b1 b2 c1 bias; the bias is drawn with b.
    drawn = np.hstack([a[:, :2], b[:, :2], c[:, :1], b[:, 2:3]])
    lines = {
        "input": (values(entities, "/input"), samples.u),
        # Measured last, so that it lies above.
        "yaw rate": (
            values(entities, "/yaw_rate"),
            np.column_stack([np.where(live, els.y_hat, np.nan), samples.y]),
        ),
        "theta": (drawn, theta),
        "innovation": (
            values(entities, "/innovation"),
            np.column_stack([els.innovation, np.outer(els.noise_std, [-2, 2])]),
        ),
        "unix": (sorted(entities["/input"]["unix_time"]), samples.unix_ns),
        "boot": (np.sort(entities["/input"]["boot_time"]) // 1000, samples.boot_us),
    }
    for name, (found, expected) in lines.items():
        np.testing.assert_array_equal(found, expected, err_msg=name)
    for place, value in (("wn", wn), ("zeta", modes.dutch_roll[:, 2])):
        line, lower, upper = values(entities, f"/dutch_roll/{place}").T
        std = modes.dutch_roll[:, 1 if place == "wn" else 3]
        unknown = [*range(20, 30), *range(40, 50)]  # its lines are left open there
        assert np.flatnonzero(np.isnan(line)).tolist() == unknown
        expected = np.column_stack([value, value - 2 * std, value + 2 * std])
        known = ~np.isnan(line)
        np.testing.assert_allclose(np.column_stack([line, lower, upper])[known], expected[known])


def test_the_other_method_s_dutch_roll_is_drawn_over_time_in_its_own_colour(flown: Flown) -> None:
    path, entities, (samples, estimates, _) = flown
    times = samples.k % round(0.5 / SAMPLE_TIME_S) == 0
    times &= estimates["rml"].status != Status.WARMING_UP
    for name, value in (("wn", 2.0), ("zeta", 0.3)):
        line = np.array(entities[f"/dutch_roll/{name}/rml"]["Scalars:scalars"])
        assert len(line) == times.sum() > 30
        np.testing.assert_allclose(line[~np.isnan(line)], value, rtol=1e-9)
        own = [colours_of(path, f"/dutch_roll/{name}{of}")[0] for of in ("", "/rml")]
        assert own == [METHODS["els"], METHODS["rml"]]


def test_lines_have_a_name_a_colour_a_unit_and_show_the_extremes_within_a_pixel(
    flown: Flown, in_rad: Path
) -> None:
    """The viewer's own way is the mean of a pixel: a doublet would be half as large."""
    [names] = statics(flown.path, "/parameters/b", "SeriesLines:names")
    assert names == ["b1", "b2", "bias", *["2 sigma of noise"] * 6]
    assert statics(flown.path, "/input", "SeriesLines:names") == [["rudder [half-travel]"]]
    named = statics(in_rad, "/input", "SeriesLines:names")
    assert named == [["rudder [rad]", "aileron [half-travel]"]]
    drawn = {name: each for name, each in flown.entities.items() if "Scalars:scalars" in each}
    assert {"/input", "/innovation", "/dutch_roll/wn/rml", "/dutch_roll/wn/refused"} <= drawn.keys()
    for entity, columns in drawn.items():
        assert len(colours_of(flown.path, entity)) == len(columns["Scalars:scalars"][0])
        policy = statics(flown.path, entity, "SeriesLines:aggregation_policy")
        assert policy == [[AggregationPolicy.MinMax.value]], entity


def test_held_stretches_status_and_mode_changes_are_lanes_over_time(flown: Flown) -> None:
    boot_us = flown.blocks[0].boot_us.tolist()

    def lane(name: str) -> list[tuple[int, str]]:
        columns = flown.entities[f"/state/{name}"]
        times = (boot_us.index(t // 1000) for t in columns["boot_time"])
        states = (state for [state] in columns["StateChange:state"])
        return sorted(zip(times, states, strict=True))

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


def test_poles_are_drawn_where_the_roots_of_a_lie_with_the_imaginary_axis_up(flown: Flown) -> None:
    samples, estimates, _ = flown.blocks
    every_other = samples.k % round(2.0 / SAMPLE_TIME_S) == 0
    live = estimates["els"].status != Status.WARMING_UP
    strips = flown.entities["/z_plane/poles"]["LineStrips2D:strips"]
    assert len(strips) == (every_other & live).sum() > 1
    for crosses in strips:
        centres = {tuple(np.round(np.array(strip)[2], 5)) for strip in crosses}
        assert centres == {(0.8, -0.3), (0.8, 0.3)}


def test_a_manoeuvre_is_a_state_of_its_lane_from_its_first_sample_to_its_last(flown: Flown) -> None:
    samples, lane = flown.blocks[0], flown.entities["/state/manoeuvre"]
    said = [["1 usable"], [""], ["2 not usable"], [""], ["3 not usable"], [""]]
    assert lane["StateChange:state"] == said
    [*_, names] = statics(flown.path, "/state/manoeuvre", "StateConfiguration:values")
    [*_, colours] = statics(flown.path, "/state/manoeuvre", "StateConfiguration:colors")
    assert names == [name for [name] in said if name]
    assert [f"#{colour >> 8:06x}" for colour in colours] == [RUDDER, BAD, BAD]
    rows = np.ravel(SPANS)
    assert [t // 1000 for t in lane["boot_time"]] == samples.boot_us[rows].tolist()
    assert lane["unix_time"] == samples.unix_ns[rows].tolist()


@pytest.mark.parametrize(
    ("entity", "span", "bar", "colour"),
    [
        ("wn/manoeuvre", SPANS[0], [10.2, 9.8, 10.6], None),
        ("zeta/manoeuvre", SPANS[0], [0.62, 0.56, 0.68], None),
        ("wn/refused", SPANS[2], [10.2], BAD),  # of one colour, and without a band
        ("wn/bare", SPANS[0], [10.0, 9.4, 10.6], BARE),
    ],
)
def test_the_dutch_roll_of_a_manoeuvre_is_a_bar_with_its_band_and_ends_with_it(
    entity: str, span: tuple[int, int], bar: list[float], colour: str | None, flown: Flown
) -> None:
    samples, found = flown.blocks[0], flown.entities[f"/dutch_roll/{entity}"]
    np.testing.assert_allclose(found["Scalars:scalars"], [bar, bar, [np.nan] * len(bar)])
    assert [t // 1000 for t in found["boot_time"][:2]] == samples.boot_us[list(span)].tolist()
    assert samples.unix_ns[span[1]] < found["unix_time"][2] < samples.unix_ns[span[1] + 1]
    assert colour in (None, colours_of(flown.path, f"/dutch_roll/{entity}")[0])


def test_the_bare_airframe_has_its_poles_and_a_line_below_the_table(flown: Flown) -> None:
    """s = -6 +- 8i at 10 rad/s and 0.6, so that z = exp(-6 Ts) (cos 8 Ts +- i sin 8 Ts)."""
    [crosses] = flown.entities["/z_plane/bare"]["LineStrips2D:strips"]
    size, angle = np.exp(-6 * SAMPLE_TIME_S), 8 * SAMPLE_TIME_S
    middles = [np.mean(np.asarray(cross)[[0, 1]], axis=0) for cross in crosses]
    expected = [size * np.array([np.cos(angle), -side * np.sin(angle)]) for side in (1.0, -1.0)]
    np.testing.assert_allclose(middles, expected, atol=1e-6)
    table = text_of(flown.path, "/manoeuvres")[-2]  # before the run's end
    assert "\n1: the bare airframe: wn 10.00 ± 0.30 rad/s, zeta 0.600 ± 0.020\n" in table
    assert table.endswith("\n2: the bare airframe is not known: the aileron is a copy\n```\n")


def test_log_manoeuvres_and_verdict_are_there_to_be_read(flown: Flown, in_rad: Path) -> None:
    log = flown.entities["/log"]
    assert log["TextLog:text"] == [["before the grid is known"], ["gap of 3 s"]]
    assert log["TextLog:level"] == [["INFO"], ["WARN"]]
    table, verdict = (text_of(flown.path, each)[-1] for each in ("/manoeuvres", "/verdict"))
    assert [" ".join(line.split()) for line in table.splitlines()[:4]] == [
        "```",
        "n from-to s mode loop V m/s alt m wn rad/s zeta result",
        "1 6-8 FBWA roll 21.5 120 10.20±0.20 0.620±0.030 used",
        "2 9-12 - roll - - none none not_excited",
    ]
    assert "± is one sigma: noise, structure, scatter of manoeuvres" in table
    assert verdict.startswith(
        "```\nverdict  usable\n  flight  wn 10.10 ± 0.15 rad/s, zeta 0.630 ± 0.020\n"
        "          noise alone: wn ± 0.02, zeta ± 0.003\n"
    )
    assert table.splitlines()[1] in verdict
    refused = text_of(in_rad, "/verdict")[-1]
    assert refused.startswith("```\nverdict  NOT USABLE\n")
    assert all(reason.text in refused for reason in SUMMARY.verdict.reasons)
    assert text_of(in_rad, "/manoeuvres")[-1] == "```\nNo manoeuvre.\n```\n"
    assert not any("manoeuvre" in entity for entity in recorded(in_rad))


def test_the_recording_brings_its_picture_along_and_rerun_accepts_it(flown: Flown) -> None:
    reader = RrdReader(flown.path)
    [blueprint] = reader.blueprints()
    origins = {
        origin
        for chunk in reader.stream(store=blueprint).to_chunks()
        for batch in [chunk.to_record_batch()]
        if "ViewBlueprint:space_origin" in batch.schema.names
        for [origin] in batch.column("ViewBlueprint:space_origin").to_pylist()
    }
    assert origins == {
        "/input", "/yaw_rate", "/innovation", "/state", "/dutch_roll/wn", "/dutch_roll/zeta",
        "/parameters/a", "/parameters/b", "/parameters/c", "/verdict", "/manoeuvres", "/log",
        "/z_plane", "/none",  # holds the time range that all time axes share
    }  # fmt: skip
    verify = [VIEWER, "rrd", "verify", str(flown.path)]
    subprocess.run(verify, check=True, capture_output=True, timeout=60)


def test_a_recording_that_rerun_refuses_is_one_line_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(SinkError, match="switched off"):
        RerunSink("save", name="flight", warn=fail, path=tmp_path / "a.rrd")
    assert list(tmp_path.iterdir()) == []
