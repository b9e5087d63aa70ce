"""The damper's advice on the bare airframe, against its own linearisation with both loops closed.

The aircraft is linear and flies under a roll hold that alone moves its aileron.
"""

from __future__ import annotations

import json
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from linear_flights import GRAVITY, Truth, flown
from msgspec.structs import replace
from scipy.optimize import newton

import yawid
from yawid.answers.damper_report import DamperReport
from yawid.answers.run_summary import Value
from yawid.cli import main as command_line
from yawid.tables.run import Run

LOOP_HZ = 50.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Truth]:
    data, truth = flown(36)
    log = tmp_path_factory.mktemp("flight") / "flight.tlog"
    log.write_bytes(data)
    return yawid.replay(log, lateral="auto", servo_lag=round(truth.lag_s, 4)), truth


def parameters(truth: Truth) -> dict[str, float]:
    """Return those of ArduPlane's damper, which scales by 1 at the airspeed flown."""
    V = truth.airspeed_m_s
    return {"YAW2SRV_DAMP": 0.0, "SCALING_SPEED": V, "AIRSPEED_MIN": 0.5 * V,
            "AIRSPEED_MAX": 2.0 * V, "SCHED_LOOP_RATE": LOOP_HZ}  # fmt: skip


def at_airspeed(of: Truth, by: float) -> Truth:
    """Return the aircraft and its hold at an airspeed that is higher by a factor."""
    moments = [by**2, by, by, 1.0]
    A = of.A * np.array([[by, by**-2, 1.0, 1.0 / by], moments, moments, np.ones(4)])
    A[3, 2] = np.tan(A[0, 1])
    B = of.B * np.array([[by], [by**2], [by**2], [1.0]])
    return of._replace(A=A, B=B, hold=of.hold / by**2, airspeed_m_s=by * of.airspeed_m_s)


def pair(of: Truth, gain: float) -> complex:
    """Return the Dutch roll's pole under the roll hold, and the damper with a gain.

    A command of the hold stays until the next one, and the servos lag. The pole is followed from
    that with the largest part in the yaw rate, as a root of 1 + K G.
    """
    late_s = of.lag_s + 0.5 / of.rate_hz
    A = np.block([[of.A, of.B[:, :1]], [-of.hold / late_s, -1.0 / late_s]])
    b, seen = np.append(of.B[:, 1], 0.0), np.array([0.0, 0.0, 1.0, -GRAVITY / of.airspeed_m_s, 0.0])
    poles, vectors = np.linalg.eig(A)
    part = np.abs(vectors[2] * np.linalg.solve(vectors, b.astype(complex))) / np.sqrt(-poles.real)
    s = complex(poles[np.argmax(np.where(poles.imag > 0.0, part, -1.0))])

    def left(s: complex, k: float) -> complex:
        G = seen @ np.linalg.solve(s * np.eye(5) - A, b) / (1.0 + of.lag_s * s)
        washout = s / (s - np.log(0.996008) * LOOP_HZ)
        return 1.0 / G + k * washout * np.exp(-0.5 * s / LOOP_HZ)

    for k in np.linspace(0.0, np.degrees(1.0) / 45.0 * gain, 21):
        s = newton(left, s * (1.0 + 1e-6j), args=(k,), tol=1e-9)
    return s


def test_each_gain_is_that_of_the_linearisation_with_both_loops(flight, tmp_path: Path, capsys):
    """Within two of its own sigmas, which are smaller than those of the answer as flown."""
    run, truth = flight
    V, given = truth.airspeed_m_s, parameters(truth)
    said = ",".join(f"{name}={x}" for name, x in given.items())

    asked = ["--param", said, "--airspeed", f"{0.85 * V},{V}", "--json"]
    assert command_line.main(["damper", str(run.mcap(tmp_path)), *asked]) == 0
    found = json.loads(capsys.readouterr().out)

    assert found["aircraft"] == "airframe"
    assert "the bare airframe, closed with the roll hold" in found["says"][0]
    rows = [(gain["value"], at) for gain in found["gains"] for at in gain["at"] if "zeta" in at]
    assert len(rows) > 8
    for value, at in rows:
        by = at["airspeed_m_s"] / V
        true = pair(at_airspeed(truth, by), value / by**2)
        assert abs(at["wn_rad_s"] - abs(true)) < 2.0 * at["wn_std"]
        assert abs(at["zeta"] + true.real / abs(true)) < 2.0 * at["zeta_std"]
    own = run.summary.flight.dutch_roll
    assert 0.03 * own.zeta < rows[0][1]["zeta_std"] < 0.7 * own.zeta_std


def studied(run: Run, truth: Truth, **changed: Any) -> DamperReport:
    """Return the advice of a run whose summary is changed, without its rudder mix."""
    other = copy(run)
    other.summary = replace(run.summary, **changed)
    return replace(other.damper(parameters=parameters(truth)).report, mix=None)


def test_an_airframe_that_is_false_or_whose_law_is_unknown_leaves_the_answer_as_flown(flight):
    """One that is flown by hand has no law: it is the bare one, and not that of this flight."""
    run, truth = flight
    as_flown = studied(run, truth, bare=None)
    assert (as_flown.aircraft, as_flown.verdict.reasons) == ("as_flown", [])

    refused = replace(run.bare, verdict=replace(run.bare.verdict, usable=False))
    without_motion = copy(run)
    without_motion._motion = None
    assert studied(run, truth, bare=refused) == as_flown
    assert studied(without_motion, truth) == as_flown
    far = replace(run.bare, derivatives=run.bare.derivatives | {"N_r": Value(-1.5, 0.05)})
    by_hand = replace(run.summary.flight, loop="airframe")
    zeta = f"{run.bare.dutch_roll.zeta:.2f}"
    for changed, said in (({"bare": far}, "zeta 0.5"), ({"flight": by_hand}, f"zeta {zeta}")):
        found = studied(run, truth, **changed)
        (reason,) = found.verdict.reasons
        assert (found.aircraft, found.gains) == ("as_flown", as_flown.gains)
        assert reason.id == "airframe_differs"
        assert said in reason.text
