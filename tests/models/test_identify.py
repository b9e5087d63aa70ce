"""Models of a run: against the plant that was flown, SciPy, python-control, and a Monte Carlo."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from damper.test_study import DELTA, GIVEN, WN, ZETA, record, run
from flights.records import HZ, SAID, Leg, states
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


@cache
def model(which: int | str) -> LinearModel:
    return run().model(which)  # type: ignore[arg-type]  # a test's text


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


MEASURED = {"rate": 6.0, "rudder_is": "measured"}


@pytest.mark.parametrize("which", [1, "flight"])
@pytest.mark.parametrize(
    ("flown", "within", "input_is"),
    [
        pytest.param(lambda: (run(), NUM, DEN), 0.01, "held", id="held"),
        pytest.param(lambda: moving(0.0), 0.01, "mean", id="known by its means"),
        pytest.param(lambda: moving(1.0 / 12.0), 0.01, "mean", id="by means, behind a servo"),
        # Means over a sixth of a second weaken wn by 4 %, as sinc(0.5), and again as held.
        pytest.param(lambda: moving(0.0, **MEASURED), 0.015, "mean", id="by coarse means"),
    ],
)
def test_a_model_is_the_plant_that_was_flown(
    which: int | str, flown: Any, within: float, input_is: str
) -> None:
    """However the rudder is known; its matrices, numerators and response are one model."""
    log, num, den = flown()
    found, w = log.model(which), np.array([4.0, 6.0, 9.0])
    (n, d, _, d_std, _), (n_z, d_z, *_) = found.tf(), found.tf(discrete=True)

    response = found.frequency_response(w).G
    assert np.abs(response / signal.freqs(num, den, w)[1]) == pytest.approx(1.0, abs=within)
    np.testing.assert_allclose(signal.freqs(n, d, w)[1], response, rtol=1e-9)
    sampled = signal.cont2discrete(found.ss()[:4], found.sample_time_s)
    numerator = signal.ss2tf(*sampled[:4])[0].ravel()
    np.testing.assert_allclose(numerator, np.pad(n_z, (1, 0)), atol=1e-9)
    u = np.zeros(200)
    u[10:20], u[20:30] = 0.3, -0.3
    simulated = found.simulate(u)
    np.testing.assert_allclose(simulated, signal.lfilter(np.pad(n_z, (1, 0)), d_z, u), atol=1e-9)
    b, a, _ = signal.cont2discrete((num, den), found.sample_time_s)
    y = signal.lfilter(b.ravel(), a, u)
    coarse = found.sample_time_s > 0.1
    assert np.linalg.norm(simulated - y) < (0.1 if coarse else 0.02) * np.linalg.norm(y)
    assert found.input_is == input_is
    if len(d) == len(den) and input_is == "held":
        assert (np.abs(d - den) <= 4.0 * d_std + 1e-12).all()


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


PLANE = {
    "mass": 800.0, "ixx": 1000.0, "izz": 2000.0, "ixz": 100.0, "area": 16.0, "span": 10.0,
    "rudder_max_deg": 20.0, "aileron_max_deg": 15.0, "density": 1.0,
}  # fmt: skip


def test_coefficients_are_of_unprimed_moments() -> None:
    found = coefficients(airframe_run().model("bare"), PLANE)

    force, V = 0.5 * AIRSPEED_M_S**2 * 16.0, AIRSPEED_M_S
    expected = {
        "Cnb": (2000.0 * 4.0 - 100.0 * -9.0) / (force * 10.0),
        "Clp": (1000.0 * -4.0 - 100.0 * -0.15) / (force * 10.0) * 2.0 * V / 10.0,
        "CYb": -0.25 * 800.0 * V / force,
        "Cndr": -(2000.0 * 1.5 - 100.0 * -0.5) / (force * 10.0) / math.radians(20.0),
        "Clda": (1000.0 * 8.0 - 100.0 * 0.1) / (force * 10.0) / math.radians(15.0),
    }
    assert {name: found[name].value for name in expected} == pytest.approx(expected)
    assert found["Cnb"].std == pytest.approx(math.hypot(2000.0 * 0.4, 100.0 * 0.9) / (force * 10.0))
    assert {name for name, each in found.items() if each.from_prior} == {"CYb"}


DIMENSIONS = "dimensions: --aircraft mass=...,ixx=...,izz=...,ixz=...,area=...,span=..."


@pytest.mark.parametrize(
    ("made", "error", "said"),
    [
        (lambda: coefficients(airframe_run().model("bare"), {}), ConfigError, DIMENSIONS),
        (
            lambda: coefficients(airframe_run().model("bare"), PLANE | {"mass": -1.0}),
            ConfigError, "the aircraft's mass must be above 0",
        ),
        (
            lambda: coefficients(airframe_run().model("bare"), PLANE | {"ixz": 5000.0}),
            ConfigError, "ixz is too large for its ixx and izz",
        ),
        (
            lambda: coefficients(model("flight"), {}),
            ConfigError, "of the bare airframe, not of the flight",
        ),
        (lambda: model("bare"), NotIdentifiable, "airframe is not known: replay the log"),
        (lambda: model(9), ConfigError, r"no model of 9: .* a manoeuvre \(1, 2\)"),
        (lambda: model(1).tf(output="beta"), ConfigError, "no 'beta': r"),
    ],
)  # fmt: skip
def test_what_is_not_known_has_no_model_and_no_coefficients(
    made: Any, error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        made()


def test_python_control_reads_it() -> None:
    control = pytest.importorskip("control")

    found = model(1).to_control()
    assert found.input_labels + found.output_labels == ["rudder", "r"]
    np.testing.assert_allclose(found(3j), model(1).frequency_response([3.0]).G[0], rtol=1e-9)
    sampled = model(1).to_control(discrete=True)
    assert sampled.dt == 0.05
    y = control.forced_response(sampled, U=np.ones(40)).outputs
    np.testing.assert_allclose(y, model(1).simulate(np.ones(40)), atol=1e-12)


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


def test_other_tables_and_refusals(
    mcap: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for what, name, expected in (
        ("manoeuvres", "wn_rad_s", run().manoeuvres.wn_rad_s), ("modes", "wn", run().modes.wn),
    ):  # fmt: skip
        out = tmp_path / f"{what}.npz"
        assert main(["export", str(mcap), "--what", what, "-o", str(out)]) == 0
        with np.load(out) as found:
            np.testing.assert_array_equal(found[name], expected)
    as_model = ["export", str(mcap), "--what", "model"]
    assert main([*as_model, "-o", str(tmp_path / "m.csv")]) == 2
    with pytest.raises(SystemExit, match="2"):
        main([*as_model, "--of", "all"])
    assert main([*as_model, "--of", "bare", "-o", str(tmp_path / "m.xml")]) == 5
    said = capsys.readouterr().err
    for each in (".json, .mat, .xml", "--of: must be", "airframe is not known: replay the log"):
        assert each in said


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
