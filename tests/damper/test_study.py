"""The advice on a yaw damper: of a simulated aircraft of known damping, and of recorded flights."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from copy import copy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace as change
from recorded_flights import recorded
from scipy.signal import cont2discrete, invres, lfilter

import yawid
from yawid.cli import main as command_line
from yawid.damper.autopilots import AUTOPILOTS, READ
from yawid.damper.loop import closed_response
from yawid.tables.run import Run, no_rows

WN, ZETA, V = 5.0, 0.1, 20.0
PLANE = {
    "YAW2SRV_DAMP": 0.0, "SCALING_SPEED": 20.0, "AIRSPEED_MIN": 10.0, "AIRSPEED_MAX": 30.0,
    "SCHED_LOOP_RATE": 200.0,
}  # fmt: skip
"""The parameters of an autopilot that scales by 1 at the airspeed flown."""
DELTA = 6.0
"""The aircraft is r/u = 6 (s + 0.4) / (s^2 + 2 0.1 5 s + 25)."""


GIVEN: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded"}


def doublets(
    zeta: float = ZETA, starts: Sequence[int] = (100, 160, 220, 1200, 1260, 1320)
) -> tuple[np.ndarray, np.ndarray]:
    """Return rudder and yaw rate at 20 Hz: manoeuvres with doublets and their decay."""
    u = np.zeros(starts[-1] + 1080)
    for start in starts:
        u[start : start + 12], u[start + 12 : start + 24] = 0.3, -0.3
    b, a, _ = cont2discrete(([DELTA, 0.4 * DELTA], [1.0, 2.0 * zeta * WN, WN**2]), 0.05)
    rng = np.random.default_rng(1)
    return u, lfilter(b.ravel(), a, u) + rng.normal(0.0, 0.002, len(u))


def record(*flown: Any, rolls: float = 0.0) -> dict[str, np.ndarray]:
    """Return doublets as a record; the roll is the sum of ``rolls`` of the yaw rate."""
    u, r = doublets(*flown)
    t, roll = 10.0 + 0.05 * np.arange(len(u)), rolls * np.cumsum(r) * 0.05
    speed = np.full(len(u), V)
    return {"t": t, "rudder": u, "r [rad/s]": r, "airspeed [m/s EAS]": speed, "roll [rad]": roll}


@cache
def run() -> Run:
    return yawid.replay(record(), **GIVEN)


def studied(of: Run | None = None, **asked: Any) -> Any:
    given = {"autopilot": "ardupilot", "parameters": PLANE} | asked
    return (of or run()).damper(**given)


def stepped(num: Any, den: Any, pilot: np.ndarray, gain: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rudder and yaw rate (n,) of an aircraft with ArduPlane's damper, stepped at 200 Hz."""
    b, a, _ = cont2discrete((num, den), 0.005)
    y, u, (washed, before) = np.zeros(len(pilot)), np.zeros(len(pilot)), (0.0, 0.0)
    for k in range(len(a), len(pilot)):
        past = slice(k - 1, k - len(a), -1)
        y[k] = b.ravel()[1:] @ u[past] - a[1:] @ y[past]
        washed, before = 0.996008 * washed + y[k] - before, y[k]
        u[k] = pilot[k] - gain * 1.27324 * washed
    return u, y


def pair(gain: float, airspeed: float = V, turn: float = 0.0) -> complex:
    """Return the true closed Dutch roll, of a polynomial without the loop's delay of 2.5 ms.

    The loop is closed on the yaw rate less ``turn`` times its integral.
    """
    v = airspeed / V
    washout = -np.log(0.996008) * 200.0
    k = 1.2732 * gain / v**2
    plant = [1.0, 2.0 * ZETA * WN * v, (WN * v) ** 2]
    zeros = DELTA * v**2 * np.array([1.0, 0.4 * v])
    whole = np.polyadd(np.polymul(plant, [1.0, washout]), k * np.polymul(zeros, [1.0, -turn]))
    roots = np.roots(whole)
    return complex(roots[np.argmax(roots.imag)])


def test_the_predictions_are_those_of_the_true_aircraft_at_each_airspeed() -> None:
    """At a higher one less damping is added."""
    found = studied(gains=[0.1, 0.3], airspeed=(16.0, 26.0))

    assert found.exit_code == 0
    rows = {gain.value: gain.at for gain in found.report.gains}
    for gain in (0.0, 0.1, 0.3):
        assert [at.airspeed_m_s for at in rows[gain]] == pytest.approx([16.0, V, 26.0])
        for at in rows[gain]:
            true, near = pair(gain, at.airspeed_m_s), 0.02 if at.airspeed_m_s == V else 0.03
            assert at.wn_rad_s == pytest.approx(abs(true), rel=near)
            assert at.zeta == pytest.approx(-true.real / abs(true), abs=near)
            assert 0.0 < at.zeta_std < 0.05
    # No damper was flown: all of the rudder is the pilot's.
    drawn = found.predicted.manoeuvre.u[:, 0]
    assert found.predicted.pilot == pytest.approx(np.nan_to_num(drawn - np.nanmedian(drawn)))
    # Sigma of a next manoeuvre has the scatter tau, that of the mean has not.
    flight, tau = run().summary.flight.dutch_roll, run().summary.flight.between_std
    mean = np.sqrt(flight.wn_std**2 - tau.wn_rad_s**2), np.sqrt(flight.zeta_std**2 - tau.zeta**2)
    own = rows[0.0][1]
    assert own.wn_rad_s == pytest.approx(flight.wn_rad_s, rel=0.005)
    assert (own.wn_std, own.zeta_std) == pytest.approx(mean, rel=0.2)
    assert own.wn_std < 0.9 * flight.wn_std
    settles = run().summary.flight.settling_s
    assert own.settling_s == pytest.approx(settles.value, rel=0.03)
    assert 0.0 < own.settling_std < settles.std


def test_the_advice_aims_at_the_band_and_goes_there_in_steps() -> None:
    def advised(flown: float, **asked: Any) -> Any:
        return studied(parameters=PLANE | {"YAW2SRV_DAMP": flown}, **asked).report.recommended

    def zeta(gain: float) -> float:
        return -pair(gain).real / abs(pair(gain))

    first, aimed = advised(0.0), advised(0.0, aim=0.5)
    assert [zeta(x) for x in (first.low, first.high)] == pytest.approx([0.3, 0.4], abs=0.03)
    assert zeta(first.next) - ZETA == pytest.approx(0.1, abs=0.03)
    assert advised(0.1).next == pytest.approx(0.2)
    assert advised(first.low * 0.9).next == first.low
    assert advised(1.5).next < 1.5
    assert zeta(aimed.low) == pytest.approx(0.45, abs=0.03)


def test_the_gain_flown_and_the_same_gain_asked_for_are_one_row() -> None:
    """MAVLink sends parameters as float32: 0.2 arrives as 0.20000000298."""
    report = studied(
        parameters=PLANE | {"YAW2SRV_DAMP": float(np.float32(0.2))}, gains=[0.2]
    ).report

    assert [gain.value for gain in report.gains if 0.19 < gain.value < 0.21] == [0.2]
    assert report.flown == 0.2


ASKED = "--param SCHED_LOOP_RATE=HZ --param YAW2SRV_DAMP=VALUE --param SCALING_SPEED=VALUE"


@pytest.mark.parametrize(
    ("asked", "id_", "code", "says"),
    [
        ({"autopilot": None, "parameters": {}}, "no_autopilot", 2, "--autopilot"),
        ({"parameters": {}}, "loop_rate_unknown", 2, ASKED),
        ({"parameters": {"SCHED_LOOP_RATE": 50.0}}, "parameters_unknown", 2, "--param SCALING"),
        (
            {"autopilot": "px4", "parameters": {"IMU_GYRO_RATEMAX": 400.0}},
            "parameters_unknown", 2, "FW_AIRSPD_TRIM",
        ),
        ({"airspeed": (20.0, 40.0)}, "too_far", 2, "--airspeed"),
        ({"parameters": PLANE | {"YAW_RATE_ENABLE": 1.0}}, "other_loop", 5, "fly again"),
    ],
)  # fmt: skip
def test_what_is_missing_is_named_with_what_to_do(asked, id_: str, code: int, says: str):
    found = studied(**asked)

    verdict = found.report.verdict
    assert (found.exit_code, verdict.usable, verdict.why) == (code, False, id_)
    assert says in verdict.next
    assert found.report.recommended is None


def without_model(each: Any) -> Any:
    return change(each, estimates={"ct": change(each.estimates["ct"], response=None)})


@pytest.mark.parametrize(
    ("changed", "id_", "says"),
    [
        (lambda f: {"dutch_roll": change(f.dutch_roll, wn_std=0.3)}, "wn_uncertain", ""),
        (lambda f: {"verdict": change(f.verdict, usable=False)}, "not_usable", ""),
        (lambda f: {"airspeed_m_s": None}, "airspeed_unknown", ""),
        (None, "not_fitted", "has no model"),
        ("no rows", "not_fitted", "samples are not"),
        ("stick", "stick", "of the damped aircraft"),
    ],
)
def test_an_uncertain_or_refused_answer_gives_no_advice(changed: Any, id_: str, says: str) -> None:
    """Nor do manoeuvres without a model or samples."""
    other, summary = copy(run()), run().summary
    if changed == "no rows":
        other._rows = no_rows()
    elif changed == "stick":
        stick = change(summary.channels["rudder"], source="RC_CHANNELS.chan4_raw")
        other.summary = change(summary, channels=summary.channels | {"rudder": stick})
    elif changed is None:
        other.summary = change(summary, manoeuvres=[*map(without_model, summary.manoeuvres)])
    else:
        flight = change(summary.flight, **changed(summary.flight))
        other.summary = change(summary, flight=flight)
    found = studied(other)
    assert (found.exit_code, found.report.verdict.why) == (5, id_)
    assert says in found.report.verdict.reasons[0].text


def test_a_turn_that_the_damper_feeds_back_is_refused() -> None:
    rolling = yawid.replay(record(rolls=0.8), **GIVEN, turn="keep")

    # At wn the roll is 0.8 r / wn, and the turn's term g / V of that: 0.078 r.
    found = studied(rolling, gains=[0.6])
    assert found.exit_code == 0
    # The loop is closed on r - (g / V) roll, of which the roll is 0.8 r / s.
    (at,) = [gain.at[0] for gain in found.report.gains if gain.value == 0.6]
    turned = pair(0.6, turn=9.80665 / V * 0.8)
    assert at.wn_rad_s == pytest.approx(abs(turned), rel=0.015)
    assert abs(turned) < 0.96 * abs(pair(0.6))
    verdict = studied(rolling, parameters=PLANE | {"YAW2SRV_RLL": 3.0}).report.verdict
    assert verdict.why == "roll_term"
    share = int(re.findall(r"(\d+) % of the yaw", verdict.reasons[0].text)[0])
    assert share == pytest.approx(3.0 * 100.0 * 0.8 / WN * 9.81 / V, rel=0.15)


def test_a_rudder_in_rad_of_unknown_travel_and_an_unknown_bank_are_refused() -> None:
    columns = record()
    rad = {"rudder_unit": "rad", "rudder_sign": "nose-right", "rudder_is": "commanded"}
    in_rad = yawid.replay(columns, **rad)
    no_roll = yawid.replay({k: x for k, x in columns.items() if k != "roll [rad]"}, **GIVEN)

    verdict = studied(in_rad).report.verdict
    assert (verdict.why, verdict.next) == ("travel_unknown", "replay with --rudder-max-deg D")
    verdict = studied(no_roll, parameters=PLANE | {"YAW2SRV_RLL": 1.0}).report.verdict
    assert (verdict.why, verdict.next) == ("roll_term", "log ATTITUDE and the airspeed")


def test_the_damped_response_is_that_of_the_steps_of_the_autopilot() -> None:
    found = studied(gains=[0.3])
    G, law = found.predicted.aircraft.central, AUTOPILOTS["ardupilot"].law(PLANE, 200.0, V)
    u = np.zeros(400)
    u[20:40], u[40:60] = 0.2, -0.2

    damped = closed_response(G, law, 0.3, u, 0.05)

    num, den = (np.real(p) for p in invres(G.residues[0], G.poles[0], []))
    r = stepped(np.trim_zeros(num.round(9), "f"), den, np.repeat(u, 10), 0.3)[1][::10]
    assert np.max(np.abs(damped - r)) < 0.02 * np.max(np.abs(r))


def test_the_command_prints_a_table_json_and_a_page(tmp_path: Path, capsys) -> None:
    mcap, page = str(run().mcap(tmp_path)), tmp_path / "page.html"
    given = [f"--param={name}={value}" for name, value in PLANE.items()]
    asked = ["damper", mcap, "--autopilot", "ardupilot", *given]

    assert command_line.main([*asked, "-o", str(page)]) == 0
    said = capsys.readouterr().out
    assert "aim at" in said
    assert re.search(r"zeta +settled +GM dB", said)
    assert "This is a prediction" in said
    sentences = said[said.index("The answer is") - 2 : said.index("YAW2SRV_DAMP V m/s")]
    assert all(line.startswith("  ") for line in sentences.splitlines())
    html = page.read_text(encoding="utf-8")
    assert html.count("<svg") == 4
    assert "Rudder mix, KFF_RDDRMIX: the mix needs the bare airframe" in html
    assert command_line.main([*asked, "--json"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    told = json.loads(line)
    assert told["parameter"] == "YAW2SRV_DAMP"
    assert {"low", "high", "next"} == told["recommended"].keys()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("--param=SCALING_SPED=15", "there is no 'SCALING_SPED'; did you mean SCALING_SPEED?"),
        ("--param=SCALING_SPEED", "SCALING_SPEED must be a number, got ''"),
        ("--airspeed=15", "must be LO,HI in m/s, got '15'"),
    ],
)
def test_a_mistyped_parameter_is_not_left_out(given: str, says: str, capsys) -> None:
    with pytest.raises(SystemExit, match="2"):
        command_line.main(["damper", "flight.mcap", given])
    assert says in " ".join(capsys.readouterr().err.split())


def test_every_parameter_of_a_loop_may_be_given() -> None:
    read = set()

    class Seen(dict):
        def get(self, name, default=None):
            read.add(name)
            return super().get(name, default)

        def __contains__(self, name):
            return self.get(name, read) is not read

    for each in AUTOPILOTS.values():
        values = Seen(
            SCALING_SPEED=15.0, AIRSPEED_MIN=10.0, AIRSPEED_MAX=30.0, YAW2SRV_INT=0.5
        )  # fmt: skip
        each.law(values, 100.0, 20.0)
        each.against(values)
        read |= {each.gain, each.loop_rate, each.mix, *filter(None, [each.turn])}
        read |= {name for names in each.needs(values) for name in names}

    assert set(READ) == read


@pytest.mark.long
@recorded("sitl_damp0")
def test_a_slow_servo_is_named_from_a_real_autopilots_flight(log: Path) -> None:
    run = yawid.replay(log)

    found = run.damper(gains=[0.2, 1.0, 2.0])

    # The closed pair seen from stick to r in sitl_damp02 and sitl_ramp.
    rows = {gain.value: gain.at[0] for gain in found.report.gains}
    for gain, wn, zeta in ((0.2, 11.65, 0.603), (1.0, 15.57, 0.500), (2.0, 18.95, 0.413)):
        assert rows[gain].wn_rad_s == pytest.approx(wn, rel=0.03)
        assert rows[gain].zeta == pytest.approx(zeta, abs=0.04)
    assert found.report.recommended is None
    assert "less damped" in " ".join(found.report.says)
    assert "slow servo" in " ".join(found.report.says)
