"""An aircraft slower than 5 m/s: on the ground or not, by height and by its fastest speed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from printed import printed

from yawid.channels.flight_state import SlowFlight
from yawid.cli.main import main

CLIMB = np.concatenate([np.full(20, 300.0), np.linspace(300.0, 340.0, 41), np.full(20, 340.0)])


def slow_flight(altitude: np.ndarray, speed: float) -> np.ndarray:
    speeds = np.full(len(altitude), speed)
    return SlowFlight().shows(altitude, speeds, np.full(len(altitude), np.nan))


def test_it_flies_from_15_m_above_its_lowest_place_on():
    np.testing.assert_array_equal(slow_flight(CLIMB, 3.0), CLIMB >= 315.0)


@pytest.mark.parametrize("speed", [0.5, 12.0])
def test_what_stands_or_is_a_fast_aircraft_does_not(speed: float):
    assert not slow_flight(CLIMB, speed).any()
    after_a_fast_flight = SlowFlight()
    after_a_fast_flight.shows(CLIMB[:1], np.array([12.0]), np.array([12.0]))
    assert not after_a_fast_flight.shows(CLIMB, np.full(81, 3.0), np.full(81, 3.0)).any()


def test_an_altitude_that_leaps_to_its_first_fix_is_no_climb():
    assert not slow_flight(np.concatenate([np.zeros(9), np.full(30, 690.0)]), 3.0).any()
    assert not slow_flight(np.full(30, np.nan), 3.0).any()


@given(
    altitude=st.lists(st.one_of(st.just(np.nan), st.floats(0.0, 100.0)), min_size=1, max_size=40),
    cut=st.integers(0, 40),
)
def test_no_row_depends_on_how_they_were_cut(altitude: list[float], cut: int):
    rows = np.array(altitude)
    speeds = np.linspace(0.0, 11.0, len(rows))
    whole, parts = SlowFlight().shows(rows, speeds, speeds), SlowFlight()
    pieces = [slice(0, cut), slice(cut, None)]
    found = [parts.shows(rows[p], speeds[p], speeds[p]) for p in pieces if len(rows[p])]
    np.testing.assert_array_equal(np.concatenate(found), whole)


def record(path: Path, altitude: str = "") -> Path:
    """Write a flight at 3 m/s whose rudder moves by 80 % of half its travel."""
    t = np.arange(0.0, 60.0, 0.05)
    rudder = 0.4 * np.sign(np.sin(1.1 * t)) * (t > 20)
    kernel = np.exp(-0.5 * t[:200]) * np.sin(2.0 * t[:200])
    rate = 0.05 * np.convolve(rudder, kernel)[: len(t)]
    height = 100.0 + 2.0 * np.minimum(t, 15.0)
    columns = [t, rudder, rate, np.full(len(t), 3.0), *([height] if altitude else [])]
    header = f"t,rudder [half-travel],r [rad/s],airspeed [m/s]{altitude}"
    np.savetxt(path, np.column_stack(columns), "%.6f", ",", header=header, comments="")
    return path


def test_the_refusal_of_a_slow_record_says_that_it_is_held_as_on_the_ground(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    flat = record(tmp_path / "flat.csv")
    replay = ["replay", str(flat), "--json", "--out"]
    assert main([*replay, str(tmp_path / "a")]) == 5
    (reason, *_) = printed("replay", capsys.readouterr().out)["verdict"]["reasons"]
    assert reason["id"] == "not_excited"
    assert "every sample is held: on ground" in reason["text"]
    assert "--airborne all" in reason["text"]

    main([*replay, str(tmp_path / "b"), "--airborne", "all"])
    taken = printed("replay", capsys.readouterr().out)
    high = record(tmp_path / "high.csv", ",altitude [m]")
    main(["replay", str(high), "--json", "--out", str(tmp_path / "c")])
    climbed = printed("replay", capsys.readouterr().out)
    for found in (taken, climbed):
        reasons = [each["id"] for each in found["verdict"]["reasons"]]
        assert "not_excited" not in reasons
