"""Two flights of one simulated aircraft, without and with a damper: what each says of the other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damper.test_study import GIVEN, PLANE, WN, ZETA, V, pair, stepped
from msgspec.structs import replace
from printed import printed
from recorded_flights import recorded

import yawid
from yawid.answers.heard import GainSeen, VehicleSeen
from yawid.cli import main as command_line
from yawid.damper.autopilots import Law
from yawid.damper.before_after import before_after
from yawid.damper.decay import damped_sine, decays_in
from yawid.damper.identified import Facts
from yawid.damper.loop import pilots_rudder
from yawid.damper.refusals import gain_flown
from yawid.sinks.pages import to_text
from yawid.trend.diff import DamperDiff, Diff
from yawid.trend.table import diff_page

GAIN = 0.3
FAST, EVERY = 200, 4
"""The loop's rate in Hz, and how many of its calls there are to a row of the log."""


def flown(gain: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the servo's output and the yaw rate at 50 Hz, and the pilot's rudder.

    The aircraft is r/u = 6 (s + .4) / (s^2 + 2 .1 5 s + 25), and ArduPlane's damper runs at 200 Hz.
    """
    n = 120 * FAST
    pilot = np.zeros(n)
    for start in (5.0, 16.0, 27.0, 70.0, 81.0, 92.0):
        i = round(start * FAST)
        pilot[i : i + 120], pilot[i + 120 : i + 240] = 0.3, -0.3
    u, y = stepped([6.0, 2.4], [1.0, 2.0 * ZETA * WN, WN**2], pilot, gain)
    noise = np.random.default_rng(seed).normal(0.0, 0.002, n // EVERY)
    mean = u.reshape(-1, EVERY).mean(axis=1)
    return mean, y[::EVERY] + noise, pilot.reshape(-1, EVERY).mean(axis=1)


def facts(gain: float, seed: int) -> Facts:
    u, r, _ = flown(gain, seed)
    t = 10.0 + EVERY / FAST * np.arange(len(u))
    columns = {"t": t, "rudder": u, "r [rad/s]": r, "airspeed [m/s EAS]": np.full(len(u), V)}
    run = yawid.replay(columns | {"roll [rad]": 0.0 * t}, **GIVEN)
    run.summary = replace(run.summary, vehicle=VehicleSeen(1, 1, 1, 3))
    run.parameters = PLANE | {"YAW2SRV_DAMP": gain}
    return run.facts


@pytest.fixture(scope="module")
def both() -> tuple[Facts, Facts]:
    return facts(0.0, 1), facts(GAIN, 2)


@pytest.fixture(scope="module")
def found(both):
    return before_after(*both)


def test_each_flight_is_predicted_from_the_other_and_found_in_its_decay(found) -> None:
    assert found.notes == []
    assert [(each.flight, each.gain) for each in found.flown] == [("A", 0.0), ("B", GAIN)]
    truths = pair(0.0), pair(GAIN)
    for each, true in zip(found.flown, truths, strict=True):
        zeta = -true.real / abs(true)
        assert each.wn_rad_s == pytest.approx(abs(true), rel=0.02)
        assert each.zeta == pytest.approx(zeta, abs=0.02)
        # Without a servo's lag the decay is the pair itself.
        for decay in (each.decay, each.decay_predicted):
            assert decay.zeta == pytest.approx(zeta, abs=0.03)
            assert decay.decays >= 5
        assert each.decay.zeta_std < 0.02
        assert each.agrees
    # The residue of 6 (s + .4) / ((s - p) (s - conj p)) at p.
    p = truths[0]
    effect = abs(6.0 * (p + 0.4) / (p - p.conjugate())) / V**2
    for value in found.effect.values():
        assert value.value == pytest.approx(effect, rel=0.03)


def test_a_wrong_gain_is_seen_in_the_decay_and_an_unknown_rate_is_noted(both) -> None:
    a, b = both

    def against(parameters: dict[str, float]) -> Any:
        return before_after(a, Facts(b.summary, b.config, b.sample_time_s, b.samples, parameters))

    wrong = against(PLANE | {"YAW2SRV_DAMP": 0.05})
    slow = against({k: x for k, x in PLANE.items() if x < 100.0} | {"YAW2SRV_DAMP": GAIN})

    assert [each.agrees for each in wrong.flown] == [True, False]
    assert [each.flight for each in slow.flown] == ["A"]
    assert "SCHED_LOOP_RATE is not in the log" in slow.notes[0]
    assert before_after(a, a) is None


def test_the_pilots_rudder_is_what_the_damper_leaves() -> None:
    u, r, pilot = flown(GAIN, 3)
    law = Law(1.27324, -np.log(0.996008) * FAST, 0.0, 0.0, 0.0)

    v = pilots_rudder(law, GAIN, u, r, EVERY / FAST)

    assert np.std(v - pilot) < 0.01 * np.max(np.abs(pilot))
    assert len(decays_in(v, EVERY / FAST, WN)) == 6


def test_the_damped_sine_of_several_decays_is_theirs() -> None:
    t = 0.05 * np.arange(40)
    rng = np.random.default_rng(4)
    parts = [
        a * np.exp(-0.3 * 6.0 * t) * np.cos(6.0 * np.sqrt(1 - 0.09) * t + phase) + 0.1 * a
        + rng.normal(0.0, 0.002, len(t))
        for a, phase in ((1.0, 0.3), (0.5, 2.0), (0.8, -1.0))
    ]  # fmt: skip

    sine = damped_sine(parts, 0.05, 7.0)

    assert (sine.wn_rad_s, sine.zeta) == pytest.approx((6.0, 0.3), abs=0.01)
    assert 0.0 < sine.zeta_std < 0.01
    assert damped_sine([np.full(40, np.nan)], 0.05, 7.0) is None


def test_the_gain_flown_is_that_of_the_manoeuvre(both) -> None:
    summary = both[0].summary
    one = summary.manoeuvres[0]
    middle = 0.5 * (one.from_s + one.to_s)

    def seen(from_s: float) -> float | None:
        gains = [GainSeen("YAW2SRV_DAMP", 0.0, 1, 0.0), GainSeen("YAW2SRV_DAMP", 0.2, 1, from_s)]
        rudder = replace(summary.channels["rudder"], yaw_gains=gains)
        changed = replace(summary, channels={"rudder": rudder})
        return gain_flown(changed, one, "YAW2SRV_DAMP", 0.7)

    assert [seen(one.from_s), seen(middle), seen(one.to_s)] == [0.2, None, 0.0]
    assert gain_flown(summary, one, "YAW2SRV_DAMP", 0.7) == 0.7
    assert gain_flown(summary, replace(one, loop="airframe"), "YAW2SRV_DAMP", 0.7) == 0.0


def test_the_terminal_and_json_have_what_was_found(found) -> None:
    damper = DamperDiff(
        parameter=found.parameter, unchanged=False, differ=["zeta"], flown=found.flown,
        notes=["one note"],
    )  # fmt: skip
    told = Diff(a="a", b="b", changed=True, false_alarm_rate=0.01, judged=1, numbers=[], facts=[],
                notes=[], damper=damper)  # fmt: skip

    said = to_text(diff_page(told))

    assert "without its yaw damper  CHANGED in zeta" in said
    assert "one note" in said
    rows = [line.split() for line in said.splitlines() if line.endswith("agrees")]
    assert [row[:2] for row in rows] == [["A", "0"], ["B", "0.3"]]
    assert max(map(len, said.splitlines())) <= 80
    printed("diff", json.dumps(told.to_json()))


@pytest.mark.long
@recorded("sitl_damp0")
def test_a_real_autopilots_flights_predict_each_other(log: Path, tmp_path: Path, capsys) -> None:
    logs = [log, log.with_name("sitl_ramp.tlog")]
    command_line.main(["replay", *map(str, logs), "--out", str(tmp_path), "--rerun", "off"])
    capsys.readouterr()

    runs = [str(tmp_path / each.with_suffix(".mcap").name) for each in logs]
    assert command_line.main(["diff", *runs, "--json"]) == 0

    damper = printed("diff", capsys.readouterr().out)["damper"]
    assert damper["unchanged"]
    assert "effect_per_V2" not in damper["differ"]
    rows = {(each["flight"], each["gain"]): each for each in damper["flown"]}
    # The closed pair seen from stick to r.
    for gain, wn, zeta in ((0.0, 10.07, 0.609), (1.0, 15.57, 0.500), (2.0, 18.95, 0.413)):
        assert rows["B", gain]["wn_rad_s"] == pytest.approx(wn, rel=0.03)
        assert rows["B", gain]["zeta"] == pytest.approx(zeta, abs=0.04)
    for key in (("A", 0.0), ("B", 0.0), ("B", 0.5), ("B", 1.0), ("B", 1.5)):
        assert rows[key]["agrees"], key
