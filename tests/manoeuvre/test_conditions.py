"""In which conditions a manoeuvre was flown, and what aircraft its answer is of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flightlog import beat, every, fly, hud, samples_of
from manoeuvre.streams import HZ, doublets, joined, rest, stream
from pymavlink import mavutil

from yawid.blocks import Noted, SampleBlock
from yawid.config.run import RunConfig
from yawid.manoeuvre.conditions import conditions, loop_of
from yawid.quantities.airspeed import Kind
from yawid.quantities.vehicles import mode_name

ARDUPILOT, PX4, OTHER = 3, 12, 8
PLANE = (ARDUPILOT, 1)
MANUAL, STABILIZE, TRAINING, FBWA = 0.0, 2.0, 3.0, 5.0


@pytest.mark.parametrize(
    ("autopilot", "mode", "loop"),
    [
        (ARDUPILOT, "MANUAL", "airframe"),
        (PX4, "MANUAL", "airframe"),
        *[
            (ARDUPILOT, mode, "with_roll_loop")
            for mode in ("STABILIZE", "ACRO", "FBWA", "FBWB", "CRUISE", "AUTOTUNE", "AUTO")
        ],
        *[(ARDUPILOT, mode, "with_roll_loop") for mode in ("RTL", "LOITER", "GUIDED", "TAKEOFF")],
        *[(PX4, mode, "with_roll_loop") for mode in ("STABILIZED", "ACRO", "ALTCTL", "POSCTL")],
        *[(PX4, mode, "with_roll_loop") for mode in ("MISSION", "LOITER", "RTL", "RATTITUDE")],
        (ARDUPILOT, "TRAINING", "unknown"),
        (ARDUPILOT, "mode 99", "unknown"),
        (PX4, "mode 0", "unknown"),
        (OTHER, "MANUAL", "unknown"),
        (0, "mode 0", "unknown"),
    ],
)
def test_only_a_mode_that_leaves_the_ailerons_to_the_stick_is_the_airframe(
    autopilot: int, mode: str, loop: str
):
    assert loop_of(autopilot, mode) == loop


def test_no_mode_of_arduplane_is_without_a_loop():
    """The table of pymavlink names them"""
    names = mavutil.mode_mapping_bynumber(1)
    loops = {name: loop_of(ARDUPILOT, mode_name(*PLANE, mode)) for mode, name in names.items()}

    assert {name for name, loop in loops.items() if loop == "airframe"} == {"MANUAL"}
    assert {name for name, loop in loops.items() if loop == "unknown"} == {"TRAINING"}


def test_a_manoeuvre_reports_when_how_fast_and_how_high_it_was_flown():
    """Samples that are held do not count, and what is unknown is left out"""
    rudder = doublets(10)
    airspeed = np.where(np.arange(len(rudder)) % 2, 19.0, 23.0)
    rudder[50:100], airspeed[50:100] = np.nan, 90.0
    found, _ = conditions(stream(rudder, first_k=100 * HZ, airspeed=airspeed, mode=FBWA), 1, PLANE)

    times = (found.from_s, found.to_s, found.duration_s)
    assert times == pytest.approx((100.0, 100.0 + 199 / HZ, 199 / HZ))
    assert found.date == "2023-11-14T22:15:00.000Z"
    assert (found.mode, found.loop) == ("FBWA", "with_roll_loop")
    assert (found.airspeed_m_s, found.airspeed_std_m_s) == pytest.approx((21.0, 2.0))
    assert (found.airspeed_source, found.altitude_m) == ("airspeed", 100.0)
    blind, _ = conditions(stream(doublets(10), airspeed=np.nan, mode=np.nan), 1, PLANE)
    assert (blind.mode, blind.loop) == (None, "unknown")
    assert (blind.airspeed_m_s, blind.airspeed_std_m_s, blind.airspeed_source) == (None, None, None)
    held, _ = conditions(stream(rest(10, np.nan)), 1, PLANE)
    assert (held.airspeed_m_s, held.altitude_m) == (None, None)


def test_a_stretch_of_two_modes_is_of_one_loop_only_where_both_are():
    """A stretch that was named may hold several"""
    rudder = doublets(10)
    for later, loop in ((STABILIZE, "with_roll_loop"), (MANUAL, "unknown"), (TRAINING, "unknown")):
        both = joined(stream(rudder, mode=FBWA), stream(rudder, first_k=len(rudder), mode=later))
        found, _ = conditions(both, 1, PLANE)
        assert found.loop == loop
        assert " and " in found.mode


@pytest.mark.parametrize(
    ("share", "source", "kind"),
    [(0.0, "airspeed", "calibrated"), (0.4, "airspeed", "true"), (0.6, "ground speed", None)],
)
def test_the_airspeed_is_the_ground_speed_where_most_of_it_is(
    share: float, source: str, kind: str | None
):
    """Its kind is that of most of it: true of .6, calibrated of .7"""
    samples = stream(doublets(10))
    by_ground = np.arange(len(samples)) < share * len(samples)
    noted = Noted.SATURATED | np.where(by_ground, int(Noted.GROUND_SPEED), 0)
    true = np.arange(len(samples)) < (0.6 if share else 0.3) * len(samples)
    kinds = np.where(true, float(Kind.TRUE), float(Kind.CALIBRATED))
    found, _ = conditions(replace(samples, noted=noted, airspeed_kind=kinds), 1, PLANE)

    assert (found.airspeed_source, found.airspeed_kind) == (source, kind)


def flown(groundspeed: float, autopilot: int = ARDUPILOT) -> SampleBlock:
    """A log in which the airspeed is 20 m/s."""
    log = fly(
        lambda t: 0.1, lambda t: 1500 + 10 * (round(50 * t) % 7), 10.0,
        vehicle=beat(autopilot=autopilot), more=every(0.5, 10.0, lambda t: hud(20.0, groundspeed)),
    )  # fmt: skip
    return joined(*samples_of(log.data, RunConfig(rudder="servo:4")).blocks)


@pytest.mark.parametrize(
    ("groundspeed", "autopilot", "source", "kind"),
    [
        (20.0, ARDUPILOT, "ground speed", None), (20.5, ARDUPILOT, "airspeed", "equivalent"),
        (23.5, PX4, "airspeed", "calibrated"), (23.5, 0, "airspeed", "indicated"),
    ],
)  # fmt: skip
def test_an_airspeed_is_of_the_kind_that_its_autopilot_sends_and_none_if_it_equals_ground_speed(
    groundspeed: float, autopilot: int, source: str, kind: str | None
):
    """ArduPlane's VFR_HUD has the equivalent one, PX4's the calibrated; MAVLink asks for either."""
    samples = flown(groundspeed, autopilot)

    used = samples.held == 0
    known = np.isfinite(samples.airspeed) & used
    flagged = samples.noted & Noted.GROUND_SPEED.value != 0
    found, _ = conditions(samples, 1, (autopilot, 1))
    assert used.sum() > 100
    assert set(flagged[known]) == {source == "ground speed"}
    assert not flagged[~used].any()
    assert (found.airspeed_source, found.airspeed_kind) == (source, kind)
    over_ground = samples.ground_speed[np.isfinite(samples.ground_speed)]
    np.testing.assert_array_equal(over_ground, groundspeed)
