"""How well a manoeuvre's wn and zeta are known: the likelihood, the structures and the answer."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import RectBivariateSpline

from yawid.manoeuvre.fit import best_alone, fits_of
from yawid.manoeuvre.likelihood import surface
from yawid.manoeuvre.responses import Record
from yawid.report.data import Drawn
from yawid.report.model_pictures import ellipse
from yawid.report.picture import Picture
from yawid.sinks.palette import DATA, MODEL, NEUTRAL

NATS = (0.5, 2.0, 4.5)
"""How far the contours of 1, 2 and 3 sigma lie below the top."""
SMOOTH = 80
"""The points over wn and over zeta between which a contour is straight."""
REACH, ROOM = 3.0, 1.2
"""How far the picture reaches in sigmas of the answer, and beyond a structure that counts."""


def likelihood_picture(drawn: Drawn) -> Picture | None:
    """Return the picture of a manoeuvre's likelihood over wn and zeta.

    None where they are too few for a fit, or the answer has no structures.
    """
    answer = drawn.found.answer
    if answer is None or answer.structures is None:
        return None
    measured = drawn.measured
    record = Record.of(drawn.model.sample_time_s, measured.held, measured.y)
    fit = best_alone(fits_of(record))
    if fit is None:
        return None
    found, structures, name = surface(fit), answer.structures, fit.structure.name
    at, std = drawn.answered.x[:2], drawn.answered.std[:2]

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        wn, zeta = (np.linspace(x[0], x[-1], SMOOTH) for x in found[:2])
        nats = RectBivariateSpline(found.zeta, found.wn_rad_s, found.nats)(zeta, wn)
        ax.contour(wn, zeta, nats, NATS, colors=DATA, linewidths=1.0)
        ax.plot([], color=DATA, label=f"likelihood, structure {name}")
        ellipse(ax, complex(*at), drawn.answered.covariance[:2, :2])
        ax.plot(*at, "+", color=MODEL, markersize=11, markeredgewidth=2, label="answer, 2σ")
        reach = REACH * std
        for (key, each), mark in zip(structures.items(), Line2D.filled_markers, strict=False):
            point = each.wn_rad_s, each.zeta
            ax.errorbar(*point, each.zeta_std, each.wn_std, fmt=mark, color=NEUTRAL, markersize=5,
                        label=f"structure {key}: {100.0 * each.weight:.0f} %")  # fmt: skip
            if each.weight > 0.0:
                reach = np.maximum(reach, ROOM * np.abs(np.array(point) - at))
        (low, bottom), (high, top) = at - reach, at + reach
        ax.set(xlim=(low, high), ylim=(bottom, top), xlabel="ωn [rad/s]", ylabel="ζ")
        figure.legend(loc="outside right upper")

    look = (
        f"Contours: 1, 2 and 3 sigma of what noise alone leaves open if structure {name} is the "
        "aircraft. Grey: what each structure found, ± 1 sigma of noise, and its weight in the "
        "answer; one without a vote may lie outside. Ellipse: 2 sigma in total, to which belongs "
        "how far the structures are apart."
    )
    return Picture("likelihood", "How well ωn and ζ are known", look, draw)
