"""Sigma of an exported frequency response against an aircraft that is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from flights.records import HZ, SAID, Leg, states

import yawid
from yawid.cli.main import main

V, GRAVITY = 20.0, 9.81
A = np.array(
    [[-0.6, 0.0, -1.0, GRAVITY / V], [-10.0, -6.0, 2.5, 0.0], [14.0, -0.6, -0.9, 0.0], [0, 1, 0, 0]]
)
"""Sideslip, roll rate, yaw rate and roll of an aircraft: a Dutch roll of 4.09 rad/s and zeta .185,
a roll mode of -6.1 and a slow spiral. Yaw rate and rudder have zeros below the Dutch roll."""
B = np.array([[0.05], [1.0], [8.0], [0.0]])


def flown() -> dict[str, np.ndarray]:
    """Return two doublets and the aircraft's yaw rate, exact for a held rudder, with noise."""
    rudder = np.tile(Leg(stroke=0.2, seconds=30.0).rudder(), 2)
    noise = 0.001 * np.random.default_rng(1).standard_normal(len(rudder))
    t, rate = np.arange(len(rudder)) / HZ, states(A, B[:, 0], rudder, HZ)[:, 2]
    return {"t": t, "rudder": rudder, "r": rate + noise, "airspeed": V + 0.0 * t}


def test_the_response_of_a_model_is_within_three_sigmas_of_the_aircraft_where_sigma_is_given(
    tmp_path: Path,
) -> None:
    model = tmp_path / "model.json"
    run = yawid.replay(flown(), **SAID).mcap(tmp_path)
    asked = ["export", str(run), "--what", "model", "--of", "1", "-o", str(model)]
    assert main(asked) == 0

    [found] = json.loads(model.read_text(encoding="utf-8"))["frequency_response"]
    w, std = np.array(found["w_rad_s"]), np.array(found["magnitude_std"], float)
    magnitude = np.hypot(np.array(found["re"], float), np.array(found["im"], float))
    wn = next(abs(pole) for pole in np.linalg.eigvals(A) if pole.imag > 1.0)
    truth = np.array([abs(np.linalg.solve(1j * each * np.eye(4) - A, B)[2, 0]) for each in w])
    near = (w > 0.3 * wn) & (w < 1.4 * wn)
    known = near & np.isfinite(std)
    assert (known & (w > 0.8 * wn)).any()
    assert (np.abs(magnitude - truth)[known] < 3.0 * std[known]).all()
