"""The advice on a yaw damper: of a simulated aircraft of known damping, and of recorded flights."""

from __future__ import annotations

import json
import re
from copy import copy
from pathlib import Path

import msgspec
import numpy as np
import pytest
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


def doublets() -> tuple[np.ndarray, np.ndarray]:
    """Return rudder and yaw rate at 20 Hz: two manoeuvres with doublets and their decay."""
    u = np.zeros(2400)
    for start in (100, 160, 220, 1200, 1260, 1320):
        u[start : start + 12], u[start + 12 : start + 24] = 0.3, -0.3
    b, a, _ = cont2discrete(([DELTA, 0.4 * DELTA], [1.0, 2.0 * ZETA * WN, WN**2]), 0.05)
    rng = np.random.default_rng(1)
    return u, lfilter(b.ravel(), a, u) + rng.normal(0.0, 0.002, len(u))


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Run:
    u, r = doublets()
    t = 10.0 + 0.05 * np.arange(len(u))
    lines = ["t,rudder,r [rad/s],airspeed [m/s EAS],roll [rad]"]
    lines += [f"{a:.2f},{b:.4f},{c:.6f},{V},0.0" for a, b, c in zip(t, u, r, strict=True)]
    path = tmp_path_factory.mktemp("damper") / "flight.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return yawid.replay(path, rudder_unit="half-travel", rudder_is="commanded")


def pair(gain: float, airspeed: float = V) -> complex:
    """Return the true closed Dutch roll, of a polynomial without the loop's delay of 2.5 ms."""
    v = airspeed / V
    washout = -np.log(0.996008) * 200.0
    k = 1.2732 * gain / v**2
    plant = [1.0, 2.0 * ZETA * WN * v, (WN * v) ** 2]
    zeros = DELTA * v**2 * np.array([1.0, 0.4 * v])
    whole = np.polyadd(np.polymul(plant, [1.0, washout]), k * np.polymul(zeros, [1.0, 0.0]))
    roots = np.roots(whole)
    return complex(roots[np.argmax(roots.imag)])


def test_the_predictions_are_those_of_the_true_aircraft(run: Run) -> None:
    found = run.damper(autopilot="ardupilot", parameters=PLANE, gains=[0.1, 0.3])

    assert found.exit_code == 0
    rows = {gain.value: gain.at[0] for gain in found.report.gains}
    for gain in (0.0, 0.1, 0.3):
        true, at = pair(gain), rows[gain]
        assert at.wn_rad_s == pytest.approx(abs(true), rel=0.02)
        assert at.zeta == pytest.approx(-true.real / abs(true), abs=0.02)
        assert 0.0 < at.zeta_std < 0.05
    # No damper was flown: all of the rudder is the pilot's.
    drawn = found.predicted.manoeuvre.u[:, 0]
    assert found.predicted.pilot == pytest.approx(np.nan_to_num(drawn - np.nanmedian(drawn)))
    flight = run.summary.flight.dutch_roll
    assert rows[0.0].wn_rad_s == pytest.approx(flight.wn_rad_s, rel=0.005)
    # Sigma of a next manoeuvre has the scatter tau, that of the mean has not.
    tau = run.summary.flight.between_std
    mean = np.sqrt(flight.wn_std**2 - tau.wn_rad_s**2), np.sqrt(flight.zeta_std**2 - tau.zeta**2)
    assert (rows[0.0].wn_std, rows[0.0].zeta_std) == pytest.approx(mean, rel=0.2)


def test_the_advice_aims_at_the_band_and_goes_there_in_steps(run: Run) -> None:
    def advised(flown: float, **asked):
        values = PLANE | {"YAW2SRV_DAMP": flown}
        return run.damper(autopilot="ardupilot", parameters=values, **asked).report.recommended

    def zeta(gain: float) -> float:
        return -pair(gain).real / abs(pair(gain))

    first = advised(0.0)
    assert zeta(first.low) == pytest.approx(0.3, abs=0.03)
    assert zeta(first.high) == pytest.approx(0.4, abs=0.03)
    assert zeta(first.next) - ZETA == pytest.approx(0.1, abs=0.03)
    assert advised(0.1).next == pytest.approx(0.2)
    assert advised(first.low * 0.9).next == first.low
    assert advised(1.5).next < 1.5
    aimed = advised(0.0, aim=0.5)
    assert zeta(aimed.low) == pytest.approx(0.45, abs=0.03)


def test_the_gain_flown_and_the_same_gain_asked_for_are_one_row(run: Run) -> None:
    """MAVLink sends parameters as float32: 0.2 arrives as 0.20000000298."""
    values = PLANE | {"YAW2SRV_DAMP": float(np.float32(0.2))}
    report = run.damper(autopilot="ardupilot", parameters=values, gains=[0.2]).report

    assert [gain.value for gain in report.gains if 0.19 < gain.value < 0.21] == [0.2]
    assert report.flown == 0.2


def test_at_a_higher_airspeed_less_damping_is_added(run: Run) -> None:
    found = run.damper(autopilot="ardupilot", parameters=PLANE, gains=[0.3], airspeed=(16.0, 26.0))

    (row,) = [gain for gain in found.report.gains if gain.value == 0.3]
    assert [at.airspeed_m_s for at in row.at] == pytest.approx([16.0, 20.0, 26.0])
    for at in row.at:
        true = pair(0.3, at.airspeed_m_s)
        assert at.wn_rad_s == pytest.approx(abs(true), rel=0.03)
        assert at.zeta == pytest.approx(-true.real / abs(true), abs=0.03)


@pytest.mark.parametrize(
    ("asked", "id_", "code", "says"),
    [
        ({}, "no_autopilot", 2, "--autopilot"),
        (
            {"autopilot": "ardupilot"},
            "loop_rate_unknown",
            2,
            "--param SCHED_LOOP_RATE=HZ --param YAW2SRV_DAMP=VALUE --param SCALING_SPEED=VALUE",
        ),
        (
            {"autopilot": "ardupilot", "parameters": {"SCHED_LOOP_RATE": 50.0}},
            "parameters_unknown",
            2,
            "--param SCALING",
        ),
        (
            {"autopilot": "px4", "parameters": {"IMU_GYRO_RATEMAX": 400.0}},
            "parameters_unknown",
            2,
            "FW_AIRSPD_TRIM",
        ),
        ({"airspeed": (20.0, 40.0)}, "too_far", 2, "--airspeed"),
        ({"parameters": PLANE | {"YAW_RATE_ENABLE": 1.0}}, "other_loop", 5, "fly again"),
    ],
)
def test_what_is_missing_is_named_with_what_to_do(run: Run, asked, id_: str, code: int, says: str):
    known = {} if id_ in ("no_autopilot", "loop_rate_unknown", "parameters_unknown") else {
        "autopilot": "ardupilot", "parameters": PLANE,
    }  # fmt: skip

    found = run.damper(**known | asked)

    assert found.exit_code == code
    verdict = found.report.verdict
    assert (verdict.usable, verdict.why) == (False, id_)
    assert says in verdict.next
    assert found.report.recommended is None


def test_an_uncertain_or_refused_answer_gives_no_advice(run: Run) -> None:
    flight = run.summary.flight
    change = msgspec.structs.replace
    wide = change(flight, dutch_roll=change(flight.dutch_roll, wn_std=0.3))
    verdict = change(flight.verdict, usable=False)
    for each, id_ in ((wide, "wn_uncertain"), (change(flight, verdict=verdict), "not_usable"),
                      (change(flight, airspeed_m_s=None), "airspeed_unknown")):  # fmt: skip
        other = copy(run)
        other.summary = change(run.summary, flight=each)
        found = other.damper(autopilot="ardupilot", parameters=PLANE)
        assert (found.exit_code, found.report.verdict.why) == (5, id_)


def test_manoeuvres_without_a_model_or_samples_give_no_advice(run: Run) -> None:
    change = msgspec.structs.replace
    old = [
        change(each, estimates={"ct": change(each.estimates["ct"], response=None)})
        for each in run.summary.manoeuvres
    ]
    without, empty = copy(run), copy(run)
    without.summary, empty._rows = change(run.summary, manoeuvres=old), no_rows()
    for other, says in ((without, "has no model"), (empty, "samples are not")):
        verdict = other.damper(autopilot="ardupilot", parameters=PLANE).report.verdict
        assert verdict.why == "not_fitted"
        assert re.search(says, verdict.reasons[0].text)


def test_a_turn_that_the_damper_feeds_back_is_refused(tmp_path: Path) -> None:
    u, r = doublets()
    roll = 0.8 * np.cumsum(r) * 0.05
    rows = zip(10.0 + 0.05 * np.arange(len(u)), u, r, roll, strict=True)
    lines = [f"{t:.2f},{a:.4f},{b:.6f},{V},{c:.5f}" for t, a, b, c in rows]
    path = tmp_path / "rolls.csv"
    path.write_text(
        "\n".join(["t,rudder,r [rad/s],airspeed [m/s EAS],roll [rad]", *lines]) + "\n",
        encoding="utf-8",
    )
    options = {"rudder_unit": "half-travel", "rudder_is": "commanded", "turn": "keep"}
    run = yawid.replay(path, **options)

    # At wn the roll is 0.8 r / wn, and the turn's term g / V of that: 0.078 r.
    found = run.damper(autopilot="ardupilot", parameters=PLANE, gains=[0.6])
    assert found.exit_code == 0
    # The loop is closed on r - (g / V) roll, of which the roll is 0.8 r / s.
    (at,) = [gain.at[0] for gain in found.report.gains if gain.value == 0.6]
    washout, turn = -np.log(0.996008) * 200.0, 9.80665 / V * 0.8
    plant = np.polymul([1.0, 2.0 * ZETA * WN, WN**2], [1.0, washout])

    def damped(left: float) -> complex:
        zeros = 0.6 * 1.2732 * DELTA * np.polymul([1.0, 0.4], [1.0, -left])
        roots = np.roots(np.polyadd(plant, zeros))
        return complex(roots[np.argmax(roots.imag)])

    assert at.wn_rad_s == pytest.approx(abs(damped(turn)), rel=0.015)
    assert abs(damped(turn)) < 0.96 * abs(damped(0.0))
    three = PLANE | {"YAW2SRV_RLL": 3.0}
    found = run.damper(autopilot="ardupilot", parameters=three)
    assert found.report.verdict.why == "roll_term"
    share = int(re.findall(r"(\d+) % of the yaw", found.report.verdict.reasons[0].text)[0])
    assert share == pytest.approx(3.0 * 100.0 * 0.8 / WN * 9.81 / V, rel=0.15)


def test_the_damped_response_is_that_of_the_steps_of_the_autopilot(run: Run) -> None:
    found = run.damper(autopilot="ardupilot", parameters=PLANE, gains=[0.3])
    G, law = found.predicted.aircraft.central, AUTOPILOTS["ardupilot"].law(PLANE, 200.0, V)
    u = np.zeros(400)
    u[20:40], u[40:60] = 0.2, -0.2

    damped = closed_response(G, law, 0.3, u, 0.05)

    # The aircraft stepped at 200 Hz with the source's washout in between.
    num, den = (np.real(p) for p in invres(G.residues[0], G.poles[0], []))
    b, a, _ = cont2discrete((np.trim_zeros(num.round(9), "f"), den), 0.005)
    b = b.ravel()
    y, put_in, washed, before = np.zeros(4000), np.zeros(4000), 0.0, 0.0
    for k in range(4000):
        y[k] = sum(b[i] * put_in[k - i] for i in range(1, len(b)) if k >= i) - sum(
            a[i] * y[k - i] for i in range(1, len(a)) if k >= i
        )
        washed, before = 0.996008 * washed + y[k] - before, y[k]
        put_in[k] = u[k // 10] - 0.3 * 1.27324 * washed
    r = y[::10]
    assert np.max(np.abs(damped - r)) < 0.02 * np.max(np.abs(r))


def test_the_command_prints_a_table_json_and_a_page(tmp_path: Path, capsys) -> None:
    u, r = doublets()
    path, page = tmp_path / "flight.csv", tmp_path / "page.html"
    rows = zip(10.0 + 0.05 * np.arange(len(u)), u, r, strict=True)
    lines = [f"{t:.2f},{a:.4f},{b:.6f},{V},0.0" for t, a, b in rows]
    head = ["t,rudder [half travel],r [rad/s],airspeed [m/s EAS],roll [rad]"]
    path.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")
    given = [f"--param={name}={value}" for name, value in PLANE.items()]
    asked = [
        "damper",
        str(path),
        "--autopilot",
        "ardupilot",
        *given,
        "--param",
        "SCHED_LOOP_RATE=200",
    ]

    assert command_line.main([*asked, "-o", str(page)]) == 0
    said = capsys.readouterr().out
    assert "aim at" in said
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
    assert command_line.main(["damper", str(path), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["verdict"]["reasons"][0]["id"] == "no_autopilot"


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
            read.add(name)
            return super().__contains__(name)

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
