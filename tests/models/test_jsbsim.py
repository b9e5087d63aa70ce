"""Exported coefficients in stock aircraft of JSBSim: the exported Dutch roll comes back."""

from __future__ import annotations

import re
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gate import one_in

from yawid.answers.identified_model import ModelSignal
from yawid.models.aerodynamics import aerodynamics
from yawid.models.identify import _airframe
from yawid.models.linear import LinearModel

jsbsim = pytest.importorskip("jsbsim")

SLUG_FT2, LB, FT, SLUG_FT3 = 1.3558179483, 0.45359237, 0.3048, 515.378818
PLACES = [("T37", 5000, 200), ("c172p", 4000, 100), ("t6texan2", 5000, 180), ("OV10", 5000, 180)]
NAMES = ("Y_beta", "L_beta", "L_p", "L_r", "L_delta_a", "L_delta_r",
         "N_beta", "N_p", "N_r", "N_delta_a", "N_delta_r", "Y_delta_r", "alpha_rad")  # fmt: skip


def identified(fdm: Any, A: np.ndarray, aileron: np.ndarray, rudder: np.ndarray) -> LinearModel:
    """Return the model with the derivatives of a linearisation (beta, roll, p, r), as commanded."""
    V, alpha = fdm["velocities/vt-fps"] * FT, fdm["aero/alpha-rad"]
    values = [A[0, 0], A[2, 0], A[2, 2], A[2, 3], aileron[2], -rudder[2],
              A[3, 0], A[3, 2], A[3, 3], aileron[3], -rudder[3], -rudder[0], alpha]  # fmt: skip
    matrices = partial(_airframe, names=NAMES, airspeed_m_s=V)
    inputs = ModelSignal("aileron", "half-travel"), ModelSignal("rudder", "half-travel")
    return LinearModel("bare airframe", True, (), "mean", NAMES, ("",) * len(NAMES),
                       np.array(values), np.zeros((13, 13)), matrices, 0.05, inputs, (), (),
                       facts={"airspeed_m_s": V})  # fmt: skip


def dimensions(fdm: Any) -> dict[str, float]:
    inertia = {n: fdm[f"inertia/{n}-slugs_ft2"] * SLUG_FT2 for n in ("ixx", "izz", "ixz")}
    return {
        "mass": fdm["inertia/weight-lbs"] * LB, "ixx": inertia["ixx"], "izz": inertia["izz"],
        "ixz": -inertia["ixz"], "area": fdm["metrics/Sw-sqft"] * FT**2,
        "span": fdm["metrics/bw-ft"] * FT,
        "rudder_max_deg": 20.0, "aileron_max_deg": 15.0,
        "density": fdm["atmosphere/rho-slugs_ft3"] * SLUG_FT3,
    }  # fmt: skip


@pytest.mark.parametrize("place", one_in(4, PLACES))
def test_the_dutch_roll_comes_back(
    place: tuple[str, float, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flights.flight import trimmed
    from flights.plan import FlightPlan
    from flights.truth import dutch_roll, lateral

    aircraft, feet, knots = place
    plan = FlightPlan(aircraft=aircraft, speed_kt=knots, altitude_ft=feet)
    fdm = trimmed(plan)
    A, aileron, rudder = lateral(fdm)
    model = identified(fdm, A, aileron, rudder)
    poles = np.linalg.eigvals(model.ss().A)
    pole = poles[poles.imag > 1e-3][0]
    axes = "".join(re.findall(r"<axis.*?</axis>", aerodynamics(model, dimensions(fdm)), re.DOTALL))

    root = Path(jsbsim.get_default_root_dir())
    for name in ("engine", "systems"):
        (tmp_path / name).symlink_to(root / name)
    shutil.copytree(root / "aircraft" / aircraft, tmp_path / "aircraft" / aircraft)
    page = tmp_path / "aircraft" / aircraft / f"{aircraft}.xml"
    text = page.read_text(encoding="latin-1")
    others = re.sub(r'<axis name="(SIDE|ROLL|YAW)".*?</axis>', "", text, flags=re.DOTALL)
    page.write_text(others.replace("</aerodynamics>", f"{axes}</aerodynamics>"), encoding="latin-1")
    monkeypatch.setattr(jsbsim, "get_default_root_dir", lambda: str(tmp_path))

    B, _, _ = lateral(trimmed(plan))
    found = dutch_roll(B, rudder, 3)
    assert found["wn_rad_s"] == pytest.approx(abs(pole), rel=0.01)
    assert found["zeta"] == pytest.approx(-pole.real / abs(pole), rel=0.01)
    assert not np.array_equal(A, B)
