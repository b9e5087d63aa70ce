"""Draws the paper's figures from yawid's own runs.

    python -m pictures.paper_figures FOLDER

Figures 1 and 2 show the transients of first and second order (eq. 4, 7) with the values that the
paper reads from them. Figure 2.3 shows the yaw angle and rate of the reference model (eq. 23) after
a unit step. Figure 2.4 shows a second experiment, the model that the paper's listing identifies
from the first one, and the model of the procedure with lags: only the latter predicts it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from yawid.config.estimator import ArmaxOrders
from yawid.estimation.fit import fit_percent, simulate
from yawid.offline.step_response import FORMS, first_order_response
from yawid.offline.two_stage import paper_listing, two_stage
from yawid.plant.excitation import Excitation
from yawid.plant.simulate import REFERENCE
from yawid.plant.yaw import YawPlant

TS = 0.01


def first_order(axes: Axes) -> None:
    """Draw figure 1: K is the steady state, T the time to 63 % of it."""
    t = np.linspace(0.0, 8.0, 400)
    axes.plot(t, first_order_response(t, 1.0, 1.2))
    axes.axhline(1.0, ls=":", c="0.5")
    axes.plot([1.2, 1.2, 0.0], [0.0, 1 - np.exp(-1), 1 - np.exp(-1)], ls="--", c="0.5")
    axes.set(title="Figure 1: first order (eq. 4)", xlabel="t, s", ylabel="c(t)/K")
    axes.annotate("T, 63 %", (1.2, 0.2), xytext=(1.5, 0.2))


def second_order(axes: Axes) -> None:
    """Draw figure 2: overshoot and the time of the first peak give D and q (eq. 12-13)."""
    t, D, q = np.linspace(0.0, 12.0, 600), 0.2, 2.0
    response, peak = FORMS["second"].response, np.pi / (q * np.sqrt(1.0 - D * D))  # eq. 9
    axes.plot(t, response(t, 1.0, D, q))
    height = float(response(peak, 1.0, D, q))
    axes.axhline(1.0, ls=":", c="0.5")
    axes.plot([peak, peak], [1.0, height], c="C3")
    axes.annotate("Δh", (peak, 1.2), xytext=(peak + 0.2, 1.2), color="C3")
    axes.annotate("T1", (peak, 0.05), xytext=(peak + 0.1, 0.05))
    axes.axvline(peak, ls="--", c="0.5", lw=0.8)
    axes.set(title="Figure 2: second order (eq. 7)", xlabel="t, s", ylabel="h(t)/k")


def reference_model(axes: Axes) -> None:
    """Draw figure 2.3: the transient of eq. 23."""
    t = np.arange(0.0, 10.0, TS)
    plant = YawPlant.from_coefficients(REFERENCE)
    yaw, rate = plant.linear("yaw"), plant.linear("yaw-rate")
    for linear, label in ((yaw, "ψ, rad"), (rate, "r, rad/s")):
        axes.plot(t, linear.simulate(np.ones(len(t)), TS)[:, 0], label=label)
    axes.set(title="Figure 2.3: reference model, unit step of -δH", xlabel="t, s")
    axes.legend()


def identified(axes: Axes) -> None:
    """Draw figure 2.4: a model that fits its record by 100 % and predicts nothing, and another."""
    plant = YawPlant.from_coefficients(REFERENCE).linear("yaw-rate")
    t = np.arange(0.0, 10.0, TS)
    record = plant.simulate(np.ones(len(t)), TS)[:, 0]
    theta1, own = paper_listing(np.ones(len(t)), record)
    vacuous_pct = fit_percent(record, own)
    # Ten samples a second suit the mode; at a hundred, the zeros of eq. 28's C lie close to z = 1.
    t = np.arange(0.0, 20.0, 10 * TS)
    u = Excitation(kind="3211", start_s=0.5, unit_s=0.7).samples(len(t), 10 * TS)
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(t))
    y = plant.simulate(u, 10 * TS)[:, 0] + noise
    orders = ArmaxOrders(na=2, nb=(2,), nc=2, nk=(1,))
    lagged = simulate(two_stage(u, y, orders).theta, orders, False, u[:, None], y)
    static = theta1[1] * u / (1.0 + theta1[0]) if theta1[0] > -0.999 else 0 * u
    axes.plot(t, y, c="0.7", label="another experiment (3-2-1-1)")
    axes.plot(t, lagged, label=f"procedure with its lags: {fit_percent(y, lagged):.0f} %")
    axes.plot(t, static, "--", label=f"listing (fits its own record {vacuous_pct:.0f} %)")
    axes.set(title="Figure 2.4: experiment and identified", xlabel="t, s", ylabel="r, rad/s")
    axes.legend(fontsize=7)


def main(folder: Path) -> None:
    """Draw the four pictures into one SVG and one PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    drawings = (first_order, second_order, reference_model, identified)
    for draw, place in zip(drawings, figure.subplots(2, 2).flat, strict=True):
        draw(place)
    with mpl.rc_context({"svg.hashsalt": "yawid"}):
        figure.savefig(folder / "paper_figures.svg", metadata={"Date": None})
    figure.savefig(folder / "paper_figures.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
