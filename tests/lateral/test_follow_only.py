"""Flights of linear aircraft whose aileron only follows the roll hold, with the servo's lag given.

The airframe is that of the aircraft that was drawn, within the sigma that is said.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from linear_flights import Truth, flown

import yawid
from yawid.answers.run_summary import Bare

FLIGHTS = 48
FLOORS = {"wn": (0.008, 0.0), "zeta": (0.03, 0.005), "roll mode": (0.1, 0.0), "L_p": (0.0, 0.0)}
"""Least sigma as a share and as itself, as the manual's page says."""


def answer(seed: int, folder: Path) -> tuple[Bare, Truth]:
    """Return a flight's airframe and the truth."""
    data, truth = flown(seed)
    (folder / "flight.tlog").write_bytes(data)
    run = yawid.replay(folder / "flight.tlog", lateral="auto", servo_lag=round(truth.lag_s, 4))
    return run.bare, truth


def errors(bare: Bare, of: Truth) -> dict[str, tuple[float, float]]:
    """Return (estimate - truth) / sigma of each number, and the same without the floors."""
    roll, pole = bare.dutch_roll, bare.roll_mode
    found = -1.0 / pole.time_constant_s
    L_p = bare.derivatives["L_p"]
    rows = {
        "wn": (roll.wn_rad_s, roll.wn_std, of.wn_rad_s),
        "zeta": (roll.zeta, roll.zeta_std, of.zeta),
        "roll mode": (found, pole.std * found**2, of.roll_pole),
        "L_p": (L_p.value, L_p.std, of.L_p),
    }
    z = {}
    for name, (value, std, true) in rows.items():
        share, least = FLOORS[name]
        rest = np.sqrt(max(std**2 - (share * value) ** 2 - least**2, 1e-12))
        z[name] = (value - true) / std, (value - true) / rest
    return z


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(4, id="the roll damping was 70 sigma off", marks=pytest.mark.long),
        pytest.param(36, id="a second minimum: zeta was 15 sigma off, L_p 70"),
    ],
)
def test_an_airframe_is_right_although_the_aileron_only_follows(seed: int, tmp_path: Path):
    bare, truth = answer(seed, tmp_path)

    assert bare.verdict.usable
    z = errors(bare, truth)
    assert max(abs(each) for each, _ in z.values()) < 3.0, z


@pytest.mark.long
def test_of_many_flights_errors_are_those_that_sigma_says(tmp_path: Path):
    """Sixty per cent have an airframe; z without the floors is printed next to it."""
    answers = [answer(seed, tmp_path) for seed in range(FLIGHTS)]
    found = [errors(*each) for each in answers if each[0].verdict.usable]

    print(f"usable {len(found)} of {FLIGHTS}")
    for name in FLOORS:
        z, without = np.array([each[name] for each in found]).T
        rms, bare = (float(np.sqrt(np.mean(x**2))) for x in (z, without))
        within, worst = float(np.mean(np.abs(z) <= 2.0)), float(np.abs(z).max())
        print(
            f"{name}: z {rms:.2f}, without floors {bare:.2f}; {within:.0%} in 2; worst {worst:.2f}"
        )
        assert rms <= 1.3, name
        assert within >= 0.94, name
        assert worst <= 3.5, name
    assert len(found) >= 0.6 * FLIGHTS
