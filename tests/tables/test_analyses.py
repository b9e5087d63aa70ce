"""The analyses that users wrote in notebooks, as they are written now: yawid has every part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from damper.test_study import DELTA, WN, ZETA
from scipy.signal import cont2discrete, lfilter

import yawid


def flown(airspeed: float, zeta: float = ZETA) -> dict[str, np.ndarray]:
    """Return a record of doublets with an aircraft whose derivatives go with the airspeed."""
    v, u = airspeed / 20.0, np.zeros(1400)
    for start in (100, 160, 220):
        u[start : start + 12], u[start + 12 : start + 24] = 0.3, -0.3
    plant = [DELTA * v**2, 0.4 * DELTA * v**3], [1.0, 2.0 * zeta * WN * v, (WN * v) ** 2]
    b, a, _ = cont2discrete(plant, 0.05)
    r = lfilter(b.ravel(), a, u) + np.random.default_rng(1).normal(0.0, 0.002, len(u))
    t = 10.0 + 0.05 * np.arange(len(u))
    return {"t": t, "rudder": u, "r_rad_s": r, "airspeed [m/s EAS]": np.full(len(t), airspeed)}


def replayed(airspeed: float, zeta: float = ZETA) -> yawid.Run:
    return yawid.replay(
        flown(airspeed, zeta), rudder_unit="half-travel", rudder_is="commanded", orders=(2, 2, 2, 1)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("runs")
    for airspeed, zeta in ((18.0, 0.1), (20.0, 0.1), (22.0, 0.25)):
        replayed(airspeed, zeta).mcap(place).rename(place / f"at{airspeed:.0f}.mcap")
    return place


def test_zeta_over_the_airspeed_of_a_folder_of_runs_and_what_the_model_leaves(folder: Path) -> None:
    runs = [yawid.load(path) for path in sorted(folder.glob("*.mcap"))]
    points = [(r.flight.airspeed_m_s, r.flight.dutch_roll.zeta) for r in runs if r.flight]

    assert np.array(points) == pytest.approx(
        np.array([[18.0, 0.1], [20.0, 0.1], [22.0, 0.25]]), abs=0.01
    )
    shown = runs[1].model(1).measured
    assert np.nanstd(shown.y - shown.simulated) == pytest.approx(0.002, rel=0.15)
