"""The pictures of a manoeuvre's model: of an answer written by hand, and of a fitted flight."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from finished_runs import replayed
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from models.answers_by_hand import manoeuvre, response, run_of
from msgspec.structs import replace
from places import C172P
from report_page import Page

from yawid.answers.run_summary import DutchRoll
from yawid.estimation.fit import fit_percent
from yawid.estimation.grids import as_held
from yawid.models.flown import Flown
from yawid.report.data import Drawn, ReportData, gather
from yawid.report.model_pictures import (
    bode_picture,
    likelihood_picture,
    poles_picture,
    residuals_picture,
    step_band,
)
from yawid.report.picture import Picture
from yawid.report.time_pictures import manoeuvre_picture, modes_picture
from yawid.report.write import report
from yawid.sinks.mcap.reader import McapRun, open_run

PAIR, R = complex(-0.5, 5.0), complex(3.0, 0.2)
WN = abs(PAIR)
STD = [0.05, 0.01, 0.3, 0.1]


def rudder(n: int = 1000) -> np.ndarray:
    u = np.zeros(n)
    u[60:72], u[72:84], u[300:312], u[312:324] = 0.3, -0.3, 0.3, -0.3
    return u


def exact(u: np.ndarray) -> np.ndarray:
    """Return the yaw rate from rest, held over each sample of 0.05 s, by its very sum."""
    y, x = np.zeros(len(u)), 0j
    step, gain = np.exp(PAIR * 0.05), np.expm1(PAIR * 0.05) / PAIR
    for k, value in enumerate(u):
        y[k], x = 2.0 * (R * x).real, step * x + gain * value
    return y


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """Return a run with one manoeuvre of which everything is known, and 1 % of noise."""
    u = rudder()
    noise = np.random.default_rng(2).normal(0.0, 0.005, len(u))
    found = manoeuvre(1, response([PAIR], {"rudder": [R]}, STD))
    run = run_of({"rudder": u, "r [rad/s]": exact(u) + noise}, [found])
    mcap = open_run(run.mcap(tmp_path_factory.mktemp("by_hand")))
    return gather(dataclasses.replace(mcap, summary=run.summary))


@pytest.fixture(scope="module")
def drawn(data: ReportData) -> Drawn:
    (found,) = data.drawn
    return found


def axes_of(picture: Picture) -> list:
    figure = Figure()
    picture.draw(figure)
    figure.draw_without_rendering()
    return figure.axes


def test_a_step_is_that_of_the_poles_and_has_the_sigma_of_its_numbers(drawn: Drawn) -> None:
    t = np.array([0.0, 0.1, 0.4, 0.9])

    found, std = step_band(drawn.answered, t)

    def step(x: np.ndarray) -> np.ndarray:
        p = x[0] * (-x[1] + 1j * np.sqrt(1.0 - x[1] ** 2))
        return 2.0 * np.real(complex(x[2], x[3]) / p * (np.exp(p * t) - 1.0))

    x = np.array([WN, 0.5 / WN, R.real, R.imag])
    np.testing.assert_allclose(found, step(x), atol=1e-12)
    slopes = [(step(x + 1e-6 * e) - step(x - 1e-6 * e)) / 2e-6 for e in np.eye(4)]
    np.testing.assert_allclose(std, np.linalg.norm(np.array(STD)[:, None] * slopes, axis=0),
                               rtol=1e-4, atol=1e-9)  # fmt: skip


def test_the_band_of_the_response_ends_where_the_model_does(drawn: Drawn) -> None:
    picture = bode_picture(drawn, "half-travel")
    upper, lower = axes_of(picture)[:2]

    for ax in (upper, lower):
        (band,) = [c for c in ax.collections if isinstance(c, FillBetweenPolyCollection)]
        f = np.concatenate([path.vertices[:, 0] for path in band.get_paths()])
        ends = np.array([f.min(), f.max()]) * 2.0 * np.pi / WN
        assert ends == pytest.approx([0.6, 1.6], abs=0.05)
        assert 0.6 <= ends[0] <= ends[1] <= 1.6
    (points,) = upper.containers
    assert points.get_label() == "measured (spectra)"


def points_of(picture: Picture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return w (n,) in rad/s of the points, their G (n,), and the sigma of its phase in rad."""
    upper, lower = axes_of(picture)[:2]
    (f, decibel), (_, degrees) = (ax.containers[0].lines[0].get_xydata().T for ax in (upper, lower))
    reach = np.array([np.ptp(bar[:, 1]) for bar in lower.containers[0].lines[2][0].get_segments()])
    G = 10.0 ** (decibel / 20.0) * np.exp(1j * np.radians(degrees))
    return 2.0 * np.pi * f, G, np.radians(reach / 4.0)


def steps_of_the_rudder(moves: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return rudder and yaw rate (1000,) of doublets with noise, the rudder its mean over a sample.

    Its steps lie at the samples of 0.05 s or, where it ``moves``, anywhere within them.
    """
    fine, u = 40, np.zeros(40 * 1000)
    firsts = np.random.default_rng(5).integers(0, 38_000, 40)
    firsts = firsts if moves else firsts // fine * fine
    for first, size in zip(firsts.tolist(), [0.3, -0.3] * 20, strict=True):
        u[first : first + 480] += size
    y, x = np.zeros(1000), 0j
    step, gain = np.exp(PAIR * 0.05 / fine), np.expm1(PAIR * 0.05 / fine) / PAIR
    for k, value in enumerate(u):
        if k % fine == 0:
            y[k // fine] = 2.0 * (R * x).real
        x = step * x + gain * value
    return u.reshape(-1, fine).mean(axis=1), y + np.random.default_rng(6).normal(0.0, 0.002, 1000)


@pytest.mark.parametrize("moves", [False, True])
def test_the_points_of_an_exact_record_lie_on_the_line(moves: bool, drawn: Drawn) -> None:
    """As they are the samples turn the phase by w Ts / 2: by seven degrees at the Dutch roll."""
    mean, y = steps_of_the_rudder(moves)
    t, held = np.arange(1000) * 0.05, as_held(mean[:, None], np.full(1000, moves))
    flown = Flown(drawn.found, 0.05, t, mean[:, None], held, y, 0.0 * y)
    measured = flown.with_model(drawn.answered)
    drawn = dataclasses.replace(drawn, model=dataclasses.replace(drawn.model, measured=measured))

    w, G, sigma = points_of(bode_picture(drawn, "half-travel"))

    true = R / (1j * w - PAIR) + np.conj(R) / (1j * w - np.conj(PAIR))
    off = np.angle(G / true)
    near = (w > 0.6 * WN) & (w < 1.5 / 0.05)
    weights, late = 1.0 / sigma[near] ** 2, w[near] * 0.05 / 2.0
    left = float(weights @ off[near] / weights.sum())
    assert abs(left) < 3.0 / np.sqrt(weights.sum())
    assert float(weights @ late / weights.sum()) > 10.0 / np.sqrt(weights.sum())  # it would be seen
    assert np.median(np.abs(G / true)[near & (w > 15.0)]) == pytest.approx(1.0, abs=0.03)


def test_the_poles_have_ellipses_of_two_sigma_and_the_bare_airframes_stand_next_to_them(
    drawn: Drawn,
) -> None:
    picture = poles_picture(drawn, DutchRoll(wn_rad_s=4.2, zeta=0.3))
    (ax,) = axes_of(picture)

    (ellipse,) = [patch for patch in ax.patches if isinstance(patch, Ellipse)]
    assert ellipse.get_center() == pytest.approx((PAIR.real, PAIR.imag))
    # wn moves the pole along its direction, zeta nearly across it.
    across = WN * STD[1] / np.sqrt(1.0 - (0.5 / WN) ** 2)
    assert sorted((ellipse.width, ellipse.height)) == pytest.approx(
        sorted((4.0 * STD[0], 4.0 * across)), rel=0.02
    )
    at = {line.get_marker(): line.get_xydata()[0].tolist() for line in ax.lines}
    assert at["x"] == pytest.approx([PAIR.real, PAIR.imag])
    assert at["+"] == pytest.approx([-1.26, 4.2 * np.sqrt(1.0 - 0.09)])
    assert "without its roll loop" in picture.look


def test_what_is_left_is_the_noise(drawn: Drawn) -> None:
    (ax,) = axes_of(residuals_picture(drawn))

    measured, left, _ = ax.lines
    f, power = left.get_xydata().T
    # White noise of 0.005 rad/s at 20 Hz: its power up to 10 Hz, in dB.
    assert power[f > 1.5].mean() == pytest.approx(10.0 * np.log10(0.005**2 / 10.0), abs=1.0)
    near = np.abs(f - WN / (2.0 * np.pi)) < 0.2
    assert (measured.get_ydata()[near] > power[near] + 20.0).all()


def test_what_explodes_leaves_the_picture_and_takes_no_axis_with_it(
    data: ReportData, drawn: Drawn
) -> None:
    """A warning of the drawing is an error in these tests."""
    rows = np.arange(len(drawn.measured.t))
    grown = (-1.0) ** rows * 10.0 ** np.linspace(-3.0, 307.0, len(rows))
    grown[-100:] = np.inf
    measured = dataclasses.replace(drawn.measured, simulated=grown)
    model = dataclasses.replace(drawn.model, measured=measured)
    far = data.track.copy()
    far[9::50, 1:] += 1e9

    fit = manoeuvre_picture(dataclasses.replace(drawn, model=model), "half-travel")
    over_time = modes_picture(dataclasses.replace(data, track=far))

    for picture in (fit, over_time):
        assert not re.findall(r"[0-9]{5,}\.[0-9]", picture.svg)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> McapRun:
    """Return the run of a recorded flight with one manoeuvre."""
    return open_run(replayed(C172P, tmp_path_factory.mktemp("fitted")))


@pytest.fixture(scope="module")
def answered(fitted: McapRun) -> Drawn:
    (found,) = gather(fitted).drawn
    return found


def test_a_manoeuvre_is_drawn_by_the_very_model_that_answered_it(
    fitted: McapRun, answered: Drawn
) -> None:
    (found,) = fitted.summary.manoeuvres
    pct = fit_percent(answered.measured.y, answered.measured.simulated)
    assert pct == pytest.approx(found.answer.fit.simulation_pct, abs=1.0)

    text = report(fitted)
    page, keys = Page(text), set(re.findall(r'<figure id="([^"]+)">', text))
    assert {"manoeuvre1", "likelihood", "bode", "poles", "step", "residuals"} <= keys
    assert len(page.ids) == len(set(page.ids))
    assert "N β = a my β weathercock stability, 1/s²" in page.text
    assert "M. T. Vu" in page.text
    looks = re.findall("<figcaption>(.*?)</figcaption>", text)
    assert re.findall(r"order|raise n|one step|not fully modelled", " ".join(looks)) == []


def test_contours_points_and_ellipse_are_those_of_the_answer(answered: Drawn) -> None:
    answer = answered.found.answer
    (ax,) = axes_of(likelihood_picture(answered))

    structures, roll = answer.structures, answer.dutch_roll
    points = [each.lines[0].get_xydata()[0].tolist() for each in ax.containers]
    assert points == [[each.wn_rad_s, each.zeta] for each in structures.values()]
    (ellipse,) = [each for each in ax.patches if isinstance(each, Ellipse)]
    turn, halves = np.radians(ellipse.angle), np.array([ellipse.width, ellipse.height]) / 2.0
    wide = np.hypot(*halves * (np.cos(turn), np.sin(turn)))
    high = np.hypot(*halves * (np.sin(turn), np.cos(turn)))
    assert (wide, high) == pytest.approx((2.0 * roll.wn_std, 2.0 * roll.zeta_std), rel=1e-9)
    assert ellipse.get_center() == pytest.approx((roll.wn_rad_s, roll.zeta))

    # The contours of 1, 2 and 3 sigma lie around their structure's point, one in the other.
    (contours,) = [each for each in ax.collections if isinstance(each, QuadContourSet)]
    best = structures[answer.structure]
    low, high = (
        np.array([f(path.vertices, axis=0) for path in contours.get_paths()])
        for f in (np.min, np.max)
    )
    at = np.array([best.wn_rad_s, best.zeta])
    assert ((low < at) & (high > at)).all()
    reach = (high - low) / 2.0
    np.testing.assert_allclose(reach / reach[0], [[1, 1], [2, 2], [3, 3]], rtol=0.05)
    np.testing.assert_allclose(reach[0], [best.wn_std, best.zeta_std], rtol=0.15)


def test_without_what_the_fit_saw_there_is_no_picture(answered: Drawn) -> None:
    answer = replace(answered.found.answer, structures=None)
    found = replace(answered.found, estimates={"ct": answer})
    older = dataclasses.replace(answered.answered, found=found)
    lost = dataclasses.replace(answered.measured, y=np.full_like(answered.measured.y, np.nan))
    unseen = dataclasses.replace(answered.model, measured=lost)

    assert likelihood_picture(dataclasses.replace(answered, answered=older)) is None
    assert likelihood_picture(dataclasses.replace(answered, model=unseen)) is None
