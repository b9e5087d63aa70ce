"""Ordinary flights: each has what its name says, and its truth is that of the aircraft flown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flights import ordinary
from flights.flight import trimmed
from flights.linear import SEVERITY, LinearAircraft
from flights.ordinary import (
    KT,
    LOOP_S,
    STEP_S,
    Ordinary,
    P,
    R,
    flown,
    fly_ordinary,
    roll_law,
)
from flights.plan import FlightPlan, Link, plan_at, sealed
from flights.truth import lateral
from made_logs import columns

T37 = FlightPlan("T37", 200.0, 4000.0, seconds=60.0, manoeuvre="none", roll_rate_gain=0.2)
"""An aircraft that JSBSim trims quickly; its first turn begins at 20 s."""
CALM = Ordinary(T37, Link(10.0, 10.0, seed=3))
UAV = sealed("light_uav")
SMALL = Ordinary(plan_at(("light_uav", 1000.0, 54.0), seconds=8.0), Link(10.0, 10.0))


def test_a_small_aircraft_feels_the_yaw_of_the_field_behind_its_span() -> None:
    small, t = LinearAircraft(UAV, SMALL.plan), np.arange(20_000) * STEP_S
    small.set_dt(STEP_S)
    small["atmosphere/randomseed"], small[SEVERITY] = 5, 2

    felt = []
    for _ in t:
        small.run()
        felt.append(small._x[[9, 10]].tolist())

    gust, rate = np.array(felt).T
    s = 2j * np.pi * np.fft.rfftfreq(len(t), STEP_S)
    lag_s = 3.0 * 2.0 / math.pi / 28.0  # MIL-F-8785C, of a span of 2 m
    behind = np.fft.irfft(s / (1.0 + s * lag_s) * np.fft.rfft(gust), len(t))
    assert np.corrcoef(rate[500:-500], behind[500:-500])[0, 1] > 0.97
    assert rate.std() == pytest.approx(behind.std(), rel=0.1)
    assert gust.std() == pytest.approx(2 * 0.4 / 28.0, rel=0.3)


@pytest.mark.parametrize("flight", [replace(CALM, severity=2), SMALL], ids=["JSBSim", "small"])
def test_the_truth_is_the_linearisation_at_the_speed_and_height_flown(flight: Ordinary) -> None:
    made = fly_ordinary(flight)

    states, _, _ = flown(flight)
    kt, feet = states[501:, KT : KT + 2].mean(0).tolist()
    mean = replace(flight.plan, speed_kt=kt, altitude_ft=feet)
    poles = np.linalg.eigvals(lateral(trimmed(mean))[0])
    pair = poles[np.argmax(poles.imag)]
    mode = made.truth["dutch_roll_open_loop"]
    assert mode["wn_rad_s"] == pytest.approx(abs(pair), rel=1e-4)
    assert mode["zeta"] == pytest.approx(-pair.real / abs(pair), rel=1e-3)


def test_a_flight_turns_holds_height_and_speed_and_mixes_its_rudder() -> None:
    made = fly_ordinary(replace(CALM, mix=0.5))

    roll = columns(made.log, "ATTITUDE", "roll")[:, 0]
    speed, feet = columns(made.log, "VFR_HUD", "airspeed", "alt").T
    aileron, rudder = columns(made.log, "SERVO_OUTPUT_RAW", "servo1_raw", "servo4_raw").T
    assert abs(roll[:190]).max() < 0.05
    assert 0.25 < abs(roll).max() < 0.5
    assert np.ptp(feet) < 30.0
    assert np.ptp(speed) < 0.05 * speed.mean()
    assert np.ptp(aileron) > 20.0
    assert rudder - rudder[0] == pytest.approx(0.5 * (aileron - aileron[0]), abs=1.6)


def test_the_first_law_is_proportional_and_the_autopilots_integrate() -> None:
    plan = FlightPlan(roll_gain=0.8, roll_rate_gain=0.2, speed_kt=100.0)
    hold, px4, arduplane = (roll_law(name, plan) for name in ("hold", "px4", "arduplane"))

    assert hold(0.1, 0.05, 80.0) == pytest.approx(0.8 * 0.1 - 0.2 * 0.05)
    n = 100
    for _ in range(n):
        by_px4, by_arduplane = px4(0.1, 0.0, 100.0), arduplane(0.1, 0.0, 100.0)
    assert by_px4 == pytest.approx(0.08 + 2.0 * 0.2 * (0.1 / 0.4) * n * LOOP_S)
    late_s = 1.0 / (math.tau * 3.0)  # the wanted rate's filter delays the integral
    assert by_arduplane == pytest.approx(
        0.08 + 1.9 * 0.2 * (0.1 / 0.5) * (n * LOOP_S - late_s), rel=0.02
    )
    assert px4(0.1, 0.0, 50.0) - by_px4 > 0.08  # at half the speed, FF twice and P four times


def test_frozen_gusts_blow_from_the_side_as_they_yaw() -> None:
    plan = replace(T37, heading_deg=40.0, seconds=40.0)
    rates = []
    for frozen in (True, False):
        flight = Ordinary(plan, Link(seed=11), severity=3, frozen=frozen, turns_s=None)
        fdm, seen = flight.start(), []
        for _ in range(4000):
            flight.blow(fdm)
            fdm.run()
            heading = fdm["attitude/psi-rad"]
            north, east = (fdm[f"atmosphere/total-wind-{axis}-fps"] for axis in ("north", "east"))
            side = east * math.cos(heading) - north * math.sin(heading)
            seen.append((side, fdm["atmosphere/r-turb-rad_sec"], fdm["velocities/vt-fps"]))
        side, yawing, speed = np.array(seen).T
        # The lag of the span filters both: compare what the yaw rate has added up to.
        lag_s = 3.0 * fdm["metrics/bw-ft"] / math.pi / speed.mean()
        total = speed.mean() * (np.cumsum(yawing) * STEP_S + lag_s * yawing)
        slow = np.ones(200) / 200
        high = [x - np.convolve(x, slow, "same") for x in (side, total)]
        rates.append(np.corrcoef(*(x[200:-200] for x in high))[0, 1])
    assert rates[0] > 0.95
    assert rates[1] < 0.9


@pytest.mark.parametrize("axes", [(P,), (R,), (P, R)], ids=["p", "r", "pr"])
def test_a_line_has_its_frequency_and_its_share_of_the_yaw_rate_in_its_axes(
    axes: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ordinary, "TRIAL_S", T37.seconds)
    gusty = replace(CALM, severity=2, turns_s=None)
    states, _, quiet = flown(gusty)
    _, _, shaken = flown(replace(gusty, line=(axes, 4.0, 0.5)))

    for axis in (P, R):
        added = (shaken - quiet)[:, axis]
        if axis not in axes:
            assert not added.any()
            continue
        assert added.var() == pytest.approx(0.5 * states[:, R].var(), rel=0.15)
        power = np.abs(np.fft.rfft(added)) ** 2
        w = 2 * np.pi * np.fft.rfftfreq(len(added), LOOP_S)
        assert power[abs(w - 4.0) < math.tau * 0.05].sum() > 0.8 * power.sum()


def test_what_is_sent_of_a_hostile_flight_is_changed_and_the_flight_is_not() -> None:
    flight = replace(CALM, plan=replace(T37, seconds=40.0))

    def sent(flight: Ordinary) -> tuple[np.ndarray, dict[str, float]]:
        made = fly_ordinary(flight)
        attitude = columns(made.log, "ATTITUDE", "roll", "yawspeed", "rollspeed")[:390]
        aileron = columns(made.log, "SERVO_OUTPUT_RAW", "servo1_raw")[:390] - 1500.0
        return np.hstack([attitude, aileron]).T, made.truth["dutch_roll_open_loop"]

    (roll, r, p, aileron), truth = sent(flight)
    for name, expected in {
        "r scaled": (roll, 1.2 * r, p, aileron),
        "aileron of wrong scale": (roll, r, p, -aileron),
        "roll late by .1 s": (np.append(roll[0], roll[:-1]), r, p, aileron),
    }.items():
        found, still = sent(ordinary.changed(name, np.random.default_rng(1), 0, flight))
        assert still == truth
        assert found == pytest.approx(np.array(expected), abs=0.01)
