"""Models of a run: against the plant that was flown, SciPy, python-control, and a Monte Carlo."""

from __future__ import annotations

import json
import math
import re
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from damper.test_study import DELTA, WN, ZETA, doublets
from lateral.flown import AIRSPEED_M_S
from lateral.flown import DERIVATIVES as TRUE
from linear_flights import airframe
from printed import why_invalid
from scipy import signal
from scipy.io import loadmat

import yawid
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, Value
from yawid.cli.main import main
from yawid.errors import ConfigError, NotIdentifiable
from yawid.models.aerodynamics import coefficients
from yawid.models.linear import LinearModel
from yawid.tables.run import Run

NUM, DEN = [DELTA, 0.4 * DELTA], [1.0, 2.0 * ZETA * WN, WN**2]
GIVEN: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded"}


def record() -> dict[str, np.ndarray]:
    u, r = doublets()
    t = 10.0 + 0.05 * np.arange(len(u))
    return {"t": t, "rudder": u, "r [rad/s]": r, "airspeed [m/s EAS]": np.full(len(t), 20.0)}


@cache
def run() -> Run:
    return yawid.replay(record(), **GIVEN)


@cache
def model(which: int | str) -> LinearModel:
    return run().model(which)  # type: ignore[arg-type]  # a test's text


def test_a_manoeuvre_has_the_transfer_function_that_was_flown() -> None:
    found = model(1).tf()

    for value, std, true in ((found.num, found.num_std, NUM), (found.den, found.den_std, DEN)):
        assert (np.abs(value - true) <= 4.0 * std + 1e-12).all(), (value, std)
        np.testing.assert_allclose(value, true, rtol=0.01)
    b, a, _ = signal.cont2discrete((NUM, DEN), 0.05)
    sampled = model(1).tf(discrete=True)
    np.testing.assert_allclose(sampled.num, b.ravel()[1:], rtol=2e-3)
    np.testing.assert_allclose(sampled.den, a, rtol=2e-3)


def test_the_flight_has_exactly_its_own_wn_and_zeta_and_their_total_sigma() -> None:
    roll, found = run().flight.dutch_roll, model("flight")

    wn = math.sqrt(found.tf().den[2])
    assert wn == pytest.approx(roll.wn_rad_s, rel=1e-9)
    assert found.tf().den[1] / (2.0 * wn) == pytest.approx(roll.zeta, rel=1e-9)
    assert found.tf().den_std[2] / (2.0 * wn) == pytest.approx(roll.wn_std, rel=0.15)
    np.testing.assert_allclose(found.tf().num, NUM, rtol=0.01)


@pytest.mark.parametrize("which", [1, "flight"])
def test_time_and_frequency_are_those_of_the_matrices(which: int | str) -> None:
    found, u = model(which), np.sin(np.arange(200) ** 2 / 400.0)
    num, den, *_ = found.tf(discrete=True)

    np.testing.assert_allclose(
        found.simulate(u), signal.lfilter(np.pad(num, (1, 0)), den, u), atol=1e-9
    )
    w = np.array([0.5, 5.0, 20.0])
    response = found.frequency_response(w)
    _, G = signal.freqs(*found.tf()[:2], w)
    np.testing.assert_allclose(response.G, G, rtol=1e-9)
    sampled = signal.cont2discrete(found.ss()[:4], 0.05)
    np.testing.assert_allclose(
        signal.ss2tf(*sampled[:4])[0].ravel(), np.pad(num, (1, 0)), atol=1e-9
    )


def test_sigmas_are_those_of_parameters_that_are_drawn() -> None:
    found, rng = model("flight"), np.random.default_rng(2)
    w = np.array([3.2, 5.0, 7.8])
    # A hundredth of the covariance, within which everything is nearly linear.
    drawn = rng.multivariate_normal(found.values, 1e-2 * found.covariance, 4000)
    G = np.array([np.polyval(p[2:], 1j * w) / np.polyval([1.0, *p[:2]], 1j * w) for p in drawn])

    response = found.frequency_response(w)
    np.testing.assert_allclose(10.0 * np.std(np.abs(G), 0), response.magnitude_std, rtol=0.05)
    np.testing.assert_allclose(10.0 * np.std(np.angle(G), 0), response.phase_std_rad, rtol=0.05)


@cache
def moving(lag_s: float, **options: Any) -> tuple[Run, np.ndarray, np.ndarray]:
    """Return the run of a rudder that switches between samples, without noise, and num and den."""
    num, den, rng = np.array([8.0, 4.8]), np.array([1.0, 3.6, 36.0]), np.random.default_rng(3)
    num, den = (num / lag_s, np.polymul(den, [1.0, 1.0 / lag_s])) if lag_s else (num, den)
    u = np.zeros(6400)  # every 5 ms
    for start in range(600, 5400, 800):
        first, second = start + rng.integers(0, 70, 2)
        u[first : second + 90], u[second + 90 : second + 170] = 0.3, -0.3
    b, a, _ = signal.cont2discrete((num, den), 0.005)
    t = 10.0 + 0.005 * np.arange(len(u))
    data = {"t": t, "rudder": u, "r [rad/s]": signal.lfilter(b.ravel(), a, u),
            "airspeed [m/s EAS]": np.full(len(t), 20.0)}  # fmt: skip
    return yawid.replay(data, **GIVEN | options), num, den


@pytest.mark.parametrize("lag_s", [0.0, 1.0 / 12.0])
@pytest.mark.parametrize("which", [1, "flight"])
def test_a_rudder_known_by_its_means_gives_the_plant_that_was_flown(
    which: int | str, lag_s: float
) -> None:
    flown, num, den = moving(lag_s)
    found = flown.model(which)  # type: ignore[arg-type]  # a test's text
    w = np.array([4.0, 6.0, 9.0])
    _, true = signal.freqs(num, den, w)

    assert np.abs(found.frequency_response(w).G / true) == pytest.approx(1.0, abs=0.01)
    u = np.zeros(200)
    u[10:20], u[20:30] = 0.3, -0.3
    b, a, _ = signal.cont2discrete((num, den), 0.05)
    y = signal.lfilter(b.ravel(), a, u)
    assert np.linalg.norm(found.simulate(u) - y) < 0.01 * np.linalg.norm(y)
    assert found.input_is == "mean"
    assert model(which).input_is == "held"


def test_what_means_lose_is_undone_in_the_rudder_and_in_its_effect() -> None:
    """Means over a sixth of a second weaken wn by 4 %, as sinc(0.5), and again as held"""
    flown, num, den = moving(0.0, rate=6.0, rudder_is="measured")
    w = np.array([4.0, 6.0, 9.0])
    _, true = signal.freqs(num, den, w)

    for which in (1, "flight"):
        found = flown.model(which)  # type: ignore[arg-type]  # a test's text
        assert np.abs(found.frequency_response(w).G / true) == pytest.approx(1.0, abs=0.015)


def test_two_inputs_have_their_own_numerators() -> None:
    data, rng = record(), np.random.default_rng(3)
    aileron = np.zeros(2400)
    for start in (130, 190, 1230, 1290):
        aileron[start : start + 10], aileron[start + 10 : start + 20] = -0.4, 0.4
    b, a, _ = signal.cont2discrete(([-2.0, 1.0], DEN), 0.05)
    data["r [rad/s]"] = data["r [rad/s]"] + signal.lfilter(b.ravel(), a, aileron)
    data["aileron"] = aileron + rng.normal(0.0, 1e-6, 2400)

    found = yawid.replay(data, **GIVEN, inputs=("rudder", "aileron")).model(1)

    assert [each.name for each in found.inputs] == ["rudder", "aileron"]
    np.testing.assert_allclose(found.tf("aileron").num, [-2.0, 1.0], rtol=0.02)
    np.testing.assert_allclose(found.tf("rudder").num, NUM, rtol=0.01)
    u = np.stack([np.zeros(50), np.ones(50)], axis=1)
    np.testing.assert_allclose(found.simulate(u), signal.lfilter(b.ravel(), a, u[:, 1]), atol=0.01)


def test_a_manoeuvre_shows_what_was_measured_and_what_it_explains() -> None:
    shown = model(1).measured

    assert shown is not None
    rows = shown.longest
    left = shown.y[rows] - shown.simulated[rows]
    assert np.nanstd(left) == pytest.approx(0.002, rel=0.15)  # the noise
    assert model("flight").measured is None
    coherence = model(1).frequency_response([3.0, 6.0]).coherence
    assert (coherence > 0.5).all()
    assert np.isnan(model("flight").frequency_response([3.0]).coherence).all()


@cache
def airframe_run() -> Run:
    """Return the run with the bare airframe of known derivatives, as a fit would give it."""
    n = len(TRUE) + 2
    derivatives = {name: Value(TRUE[name], 0.1 * abs(TRUE[name])) for name in Bare.NAMES}
    bare = Bare(
        derivatives=derivatives, alpha_rad=Value(0.0, 0.01), servo_lag_s=Value(0.08, 0.01),
        correlations=np.eye(n).tolist(), from_prior=["Y_beta"], airspeed_m_s=AIRSPEED_M_S,
        used=[1], verdict=Verdict(usable=True, reasons=[]),
    )  # fmt: skip
    found = yawid.replay(record(), **GIVEN)
    found.summary = msgspec.structs.replace(found.summary, bare=bare)
    return found


def test_the_bare_airframe_is_that_of_its_equations() -> None:
    found = airframe_run().model("bare")
    A, B, *_ = found.ss()

    for ours, true in zip((A, B[:, :]), airframe(TRUE), strict=True):
        np.testing.assert_allclose(ours, true, atol=1e-12)
    assert found.ss().A_std[2, 0] == pytest.approx(0.4)
    assert found.facts["servo_lag_s"] == 0.08
    assert found.simulate(np.ones((5, 2))).shape == (5, 4)
    assert found.from_prior == ("Y_beta",)


def test_coefficients_are_of_unprimed_moments() -> None:
    of = {"mass": 800.0, "ixx": 1000.0, "izz": 2000.0, "ixz": 100.0, "area": 16.0, "span": 10.0,
                    "rudder_max_deg": 20.0, "aileron_max_deg": 15.0, "density": 1.0}  # fmt: skip
    found = coefficients(airframe_run().model("bare"), of)

    force = 0.5 * AIRSPEED_M_S**2 * 16.0
    assert found["Cnb"].value == pytest.approx((2000.0 * 4.0 - 100.0 * -9.0) / (force * 10.0))
    assert found["Clp"].value == pytest.approx(
        (1000.0 * -4.0 - 100.0 * -0.15) / (force * 10.0) * 2.0 * AIRSPEED_M_S / 10.0
    )
    assert found["CYb"].value == pytest.approx(-0.25 * 800.0 * AIRSPEED_M_S / force)
    assert found["Cndr"].value == pytest.approx(
        -(2000.0 * 1.5 - 100.0 * -0.5) / (force * 10.0) / math.radians(20.0)
    )
    assert found["Clda"].value == pytest.approx(
        (1000.0 * 8.0 - 100.0 * 0.1) / (force * 10.0) / math.radians(15.0)
    )
    assert found["Cnb"].std == pytest.approx(math.hypot(2000.0 * 0.4, 100.0 * 0.9) / (force * 10.0))
    assert {name for name, each in found.items() if each.from_prior} == {"CYb"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {},
            "dimensions: --aircraft mass=...,ixx=...,izz=...,ixz=...,area=...,span=...",
        ),
        ({"mass": -1.0}, "the aircraft's mass must be above 0"),
        ({"ixz": 5000.0}, "ixz is too large for its ixx and izz"),
    ],
)
def test_coefficients_need_the_aircraft(given: dict[str, float], said: str) -> None:
    whole = dict.fromkeys(
        ("mass", "ixx", "izz", "ixz", "area", "span", "rudder_max_deg", "aileron_max_deg"), 1.0
    )
    of = whole | {"density": 1.0} | given if given else {}
    with pytest.raises(ConfigError, match=said):
        coefficients(airframe_run().model("bare"), of)


def test_what_is_not_known_has_no_model() -> None:
    with pytest.raises(NotIdentifiable, match="replay the log with lateral auto"):
        run().model("bare")
    with pytest.raises(ConfigError, match=r"no model of 9: .* a manoeuvre \(1, 2\)"):
        run().model(9)
    with pytest.raises(ConfigError, match="no 'beta': r"):
        model(1).tf(output="beta")
    with pytest.raises(ConfigError, match="of the bare airframe, not of the flight"):
        coefficients(model("flight"), {})


def test_python_control_reads_it() -> None:
    control = pytest.importorskip("control")

    found = model(1).to_control()
    assert found.input_labels + found.output_labels == ["rudder", "r"]
    np.testing.assert_allclose(found(3j), model(1).frequency_response([3.0]).G[0], rtol=1e-9)
    sampled = model(1).to_control(discrete=True)
    assert sampled.dt == 0.05
    y = control.forced_response(sampled, U=np.ones(40)).outputs
    np.testing.assert_allclose(y, model(1).simulate(np.ones(40)), atol=1e-12)
    wn, zeta, _ = control.damp(model("flight").to_control(), doprint=False)
    assert wn[0] == pytest.approx(run().flight.dutch_roll.wn_rad_s)
    assert zeta[0] == pytest.approx(run().flight.dutch_roll.zeta)


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run().mcap(tmp_path_factory.mktemp("run"))


def test_the_files_are_read_back(
    mcap: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("model.json", "model.mat"):
        out = ["--what", "model", "--of", "1", "-o", str(tmp_path / name)]
        assert main(["export", str(mcap), *out]) == 0
    assert capsys.readouterr().out.split() == [
        str(tmp_path / n) for n in ("model.json", "model.mat")
    ]

    told = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    assert why_invalid("export", told) == ""
    form, space = told["continuous"], model(1).ss()
    assert form["A"] == space.A.tolist()
    assert form["parameters"]["den_s0"] == {
        "value": pytest.approx(25.0, rel=0.01), "std": pytest.approx(space.A_std[1, 0]),
        "unit": "1/s^2",
    }  # fmt: skip
    assert told["inputs"] == [{"name": "rudder", "unit": "half-travel"}]
    assert told["sigma_is"] == "total"
    assert told["input_is"] == "held"
    kept = loadmat(tmp_path / "model.mat", simplify_cells=True)
    discrete = model(1).ss(discrete=True)
    for name in "ABCD":
        np.testing.assert_array_equal(
            np.reshape(kept[name], getattr(discrete, name).shape), getattr(discrete, name)
        )
    assert kept["Ts"] == 0.05
    poles = np.log(np.linalg.eigvals(kept["A"])) / kept["Ts"]
    assert np.abs(poles).tolist() == pytest.approx([WN, WN], rel=0.01)


def test_other_tables_and_refusals(
    mcap: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "m.npz"
    assert main(["export", str(mcap), "--what", "manoeuvres", "-o", str(out)]) == 0
    with np.load(out) as found:
        assert found["wn_rad_s"].tolist() == run().manoeuvres.wn_rad_s.tolist()
    assert main(["export", str(mcap), "--what", "modes", "-o", str(tmp_path / "o.npz")]) == 0
    with np.load(tmp_path / "o.npz") as found:
        np.testing.assert_array_equal(found["wn"], run().modes.wn)
    as_model = ["export", str(mcap), "--what", "model"]
    assert main([*as_model, "-o", str(tmp_path / "m.csv")]) == 2
    with pytest.raises(SystemExit, match="2"):
        main([*as_model, "--of", "all"])
    assert main([*as_model, "--of", "bare", "-o", str(tmp_path / "m.xml")]) == 5
    said = capsys.readouterr().err
    found = r"\.json, \.mat, \.xml|--of: must be|replay the log with --lateral"
    assert re.findall(found, said) == [
        ".json, .mat, .xml", "--of: must be", "replay the log with --lateral",
    ]  # fmt: skip
