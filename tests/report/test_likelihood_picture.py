"""The picture of how well a manoeuvre's wn and zeta are known, of a replayed flight."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from finished_runs import replayed
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from msgspec.structs import replace
from places import C172P

from yawid.report.data import Drawn, gather
from yawid.report.likelihood_picture import likelihood_picture
from yawid.sinks.mcap.reader import open_run


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    run = open_run(replayed(C172P, tmp_path_factory.mktemp("flown")))
    data = gather(run)
    assert data is not None
    return data.drawn[0]


def test_contours_points_and_ellipse_are_those_of_the_answer(flown: Drawn) -> None:
    answer = flown.found.answer
    picture = likelihood_picture(flown)
    assert picture is not None
    figure = Figure()
    picture.draw(figure)
    (ax,) = figure.axes

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


def test_without_what_the_fit_saw_there_is_no_picture(flown: Drawn) -> None:
    answer = replace(flown.found.answer, structures=None)
    found = replace(flown.found, estimates={"ct": answer})
    older = dataclasses.replace(flown.answered, found=found)
    lost = dataclasses.replace(flown.measured, y=np.full_like(flown.measured.y, np.nan))
    unseen = dataclasses.replace(flown.model, measured=lost)

    assert likelihood_picture(dataclasses.replace(flown, answered=older)) is None
    assert likelihood_picture(dataclasses.replace(flown, model=unseen)) is None
