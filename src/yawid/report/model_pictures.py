"""Pictures of a manoeuvre's model: its likelihood, poles and zeros, responses, what it leaves.

Their sigmas are those of the answer's numbers, by the delta method; they are drawn where the model
holds.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from scipy.interpolate import RectBivariateSpline
from scipy.signal import welch

from yawid.answers.run_summary import DutchRoll
from yawid.blocks import Floats, Ints
from yawid.errors import YawidError
from yawid.manoeuvre.fit import best_alone, fits_of
from yawid.manoeuvre.likelihood import surface
from yawid.manoeuvre.responses import Record
from yawid.models.answered import Answered, changes_of
from yawid.models.linear import COHERENT
from yawid.physics.continuous import pole_of
from yawid.physics.frequency_response import FrequencyResponse, frequency_response
from yawid.report.data import Drawn
from yawid.report.picture import Picture, band, log_axis
from yawid.sinks.palette import BARE, DATA, MODEL, NEUTRAL

APART = 1.04
HIGHEST = 0.9
"""The highest frequency drawn, as a part of half the rate: above it a model does not describe the
aircraft."""
MOST_DB = 45.0
"""The range below the peak of the gain that is drawn: a notch must not flatten all the rest."""
PERIODS: Final = 10.0
"""The length of a segment of a spectral estimate, in periods of the Dutch roll."""
STEP_PERIODS, KNOWN_PERIODS = 2.0, 1.0
"""How long the response to a step is drawn, and how long with its band, in periods."""
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


def poles_picture(drawn: Drawn, bare: DutchRoll | None = None) -> Picture:
    """Return the picture of poles with their 2 sigma ellipses, and zeros, in the s plane.

    The Dutch roll of the bare airframe, where it is known, stands next to them.
    """
    poles = drawn.answered.upper
    zeros = np.roots(drawn.model.tf().num)
    size = drawn.wn_rad_s if bare is None else max(drawn.wn_rad_s, bare.wn_rad_s)

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        for zeta in (0.1, 0.3, 0.5, 0.7):
            ray = np.array([0.0, 2.0 * size]) * pole_of(1.0, np.array(zeta))
            ax.plot(ray.real, ray.imag, color="#cccccc", linewidth=0.6)
        for pole, covariance in _with_sigma(drawn.answered):
            ellipse(ax, pole, covariance, 0.01 * size)
        ax.plot(poles.real, poles.imag, "x", color=MODEL, markersize=8, markeredgewidth=2,
                label="pole")  # fmt: skip
        above = zeros[zeros.imag >= 0.0]
        ax.plot(above.real, above.imag, "o", color=MODEL, markersize=7, fillstyle="none",
                markeredgewidth=1.6, label="zero")  # fmt: skip
        if bare is not None:
            its_own = pole_of(bare.wn_rad_s, np.array(bare.zeta))
            ax.plot(its_own.real, its_own.imag, "+", color=BARE, markersize=10, markeredgewidth=2,
                    label="bare airframe")  # fmt: skip
        ax.set_aspect("equal")
        ax.set(xlim=(-1.6 * size, 0.4 * size), ylim=(-0.2 * size, 1.3 * size),
               xlabel="real [1/s]", ylabel="imaginary [rad/s]")  # fmt: skip
        figure.legend(loc="outside upper right", ncols=3)

    look = (
        "The pole above the real axis is the Dutch roll: its distance from 0 is ωn, and the nearer "
        "it is to the imaginary axis, the less damped it is; grey: ζ of 0.1, 0.3, 0.5, 0.7. "
        "Ellipses: 2 sigma."
    )
    if bare is not None:
        look += " +: the Dutch roll of the bare airframe, without its roll loop."
    return Picture("poles", "Poles and zeros", look, draw)


def _with_sigma(model: Answered) -> Iterator[tuple[complex, Floats]]:
    """Yield the poles, one of each pair, and the covariance (2, 2) of their two parts."""

    def parts(x: Floats) -> Floats:
        poles = replace(model, x=x).upper
        return np.stack([poles.real, poles.imag])

    changes = changes_of(parts, model.x, model.covariance)
    for i, pole in enumerate(model.upper.tolist()):
        yield pole, changes[:, i] @ changes[:, i].T


def ellipse(ax: Axes, at: complex, covariance: Floats, least: float = 0.0) -> None:
    """Shade 2 sigma around x + jy whose covariance is (2, 2), ``least`` wide at the least."""
    variance, axes = np.linalg.eigh(covariance)
    width, height = np.maximum(4.0 * np.sqrt(np.maximum(variance[::-1], 0.0)), least)
    angle = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    ax.add_patch(Ellipse((at.real, at.imag), width, height, angle=angle, color=MODEL, alpha=0.25))


def bode_picture(drawn: Drawn, rudder_unit: str) -> Picture:
    """Return the frequency response from rudder to yaw rate, with its band, and spectral points."""
    spectral = _spectral(drawn)
    nyquist_hz = 0.5 / drawn.model.sample_time_s
    low = 0.02 * nyquist_hz
    if spectral is not None:
        low = min(low, spectral.w[0] / (2.0 * np.pi))
    f = np.geomspace(low, HIGHEST * nyquist_hz, 200)
    response = drawn.model.frequency_response(2.0 * np.pi * f)
    size, phase = np.abs(response.G), np.unwrap(np.angle(response.G))

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.4, 1])
        gain_db = 20.0 * np.log10(size)
        spread_db = 40.0 / math.log(10.0) * response.magnitude_std / size
        upper.plot(f, gain_db, color=MODEL, label="model")
        band(upper, f, gain_db - spread_db, gain_db + spread_db, MODEL)
        lower.plot(f, np.degrees(phase), color=MODEL)
        spread = 2.0 * response.phase_std_rad
        band(lower, f, np.degrees(phase - spread), np.degrees(phase + spread), MODEL)
        if spectral is not None:
            _draw_spectral(upper, lower, spectral, np.interp(spectral.w, 2.0 * np.pi * f, phase))
        for ax in (upper, lower):
            ax.axvline(drawn.wn_rad_s / (2.0 * np.pi), color=NEUTRAL, linewidth=0.9, ls="--")
        log_axis(upper)
        upper.set_ylabel(f"gain [dB, rad/s per {rudder_unit}]")
        lower.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
        upper.set_xlim(low, HIGHEST * nyquist_hz)
        _room(upper, np.maximum(gain_db, gain_db.max() - MOST_DB))
        _room(lower, np.degrees(phase))
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper right", ncols=2)

    look = (
        "The model holds where it has a band (2 sigma), from 0.6 to 1.6 ωn at most; dashed: ωn. "
        "Elsewhere the line only goes on."
    )
    if spectral is not None and (spectral.coherence >= COHERENT).any():
        look += (
            " The points come straight from the data, without a model, where rudder and yaw rate "
            "are coherent; bars: 2 sigma."
        )
    if len(drawn.model.inputs) > 1:
        look += " The points ignore the aileron."
    return Picture("bode", "Frequency response, rudder to yaw rate", look, draw, zooms=True)


def _segment_s(drawn: Drawn) -> float:
    """Return the length of a segment of a spectral estimate in s."""
    rows, step_s = drawn.measured.longest, drawn.model.sample_time_s
    seconds = (rows.stop - rows.start) * step_s
    wanted = PERIODS * 2.0 * math.pi / drawn.wn_rad_s
    return float(min(max(wanted, 64.0 * step_s), seconds / 4.0))


def _spectral(drawn: Drawn) -> FrequencyResponse | None:
    """Return G(jw) from spectra.

    Each input is the mean over the sample after its instant, (exp(jw Ts) - 1) / (jw Ts) of itself,
    which is half a sample early. Of a rudder that is held the sampled yaw rate, which falls as 1/s,
    has the same factor: that of the hold, with what sampling folds.
    """
    measured, rows, step_s = drawn.measured, drawn.measured.longest, drawn.model.sample_time_s
    try:
        u, y = measured.u[rows, 0], measured.y[rows]
        found = frequency_response(u, y, step_s, _segment_s(drawn))
    except YawidError:
        return None
    s = 1j * found.w * step_s
    mean = np.expm1(s) / s
    return found._replace(G=found.G * mean, magnitude_std=found.magnitude_std * np.abs(mean))


def _draw_spectral(
    upper: Axes, lower: Axes, spectral: FrequencyResponse, model_phase: Floats
) -> None:
    good = _apart(spectral.w, np.flatnonzero(spectral.coherence >= COHERENT))
    f, gain = spectral.w[good] / (2.0 * np.pi), np.abs(spectral.G[good])
    # The spectral phase is known only up to multiples of 360 degrees: take those near the model's.
    phase = np.angle(spectral.G[good])
    phase += 2.0 * np.pi * np.round((model_phase[good] - phase) / (2.0 * np.pi))
    decibel = 20.0 * np.log10(gain)
    relative = np.minimum(2.0 * spectral.magnitude_std[good] / gain, 0.9)
    errors = [-20.0 * np.log10(1.0 - relative), 20.0 * np.log10(1.0 + relative)]
    phase_errors = 2.0 * np.degrees(spectral.phase_std_rad[good])
    for ax, y, reach in ((upper, decibel, errors), (lower, np.degrees(phase), phase_errors)):
        label = "measured (spectra)" if len(f) else None
        ax.errorbar(f, y, reach, fmt=".", color=DATA, markersize=4, elinewidth=0.8, label=label)


def _apart(w: Floats, rows: Ints) -> Ints:
    """Return rows that are far enough apart on the logarithmic axis to be seen as single points."""
    kept: list[int] = []
    for i in rows.tolist():
        if not kept or w[i] > APART * w[kept[-1]]:
            kept.append(i)
    return np.array(kept, dtype=np.int64)


def _room(ax: Axes, line: Floats) -> None:
    low, high = float(np.nanmin(line)), float(np.nanmax(line))
    room = 0.12 * max(high - low, 1.0)
    ax.set_ylim(low - room, high + room)


def step_picture(drawn: Drawn, rudder_unit: str) -> Picture:
    """Return the picture of the yaw rate after a unit step of the rudder, with its band."""
    period_s = 2.0 * np.pi / drawn.wn_rad_s
    t = np.linspace(0.0, STEP_PERIODS * period_s, 200)
    answer, std = step_band(drawn.answered, t)
    known = t <= KNOWN_PERIODS * period_s

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.plot(t, answer, color=MODEL)
        band(ax, t[known], (answer - 2.0 * std)[known], (answer + 2.0 * std)[known], MODEL)
        ax.axhline(0.0, color=NEUTRAL, linewidth=0.8)
        ax.set(xlabel="time after the step [s]", ylabel="yaw rate [rad/s]", xlim=(0.0, t[-1]))

    look = (
        f"After the rudder steps by 1 {rudder_unit}, nose right. Band: 2 sigma, over the "
        "first period; later values lean on the spiral mode, which no short record shows."
    )
    return Picture("step", "Step response", look, draw, zooms=True)


def step_band(model: Answered, t: Floats) -> tuple[Floats, Floats]:
    """Return the transient function (n,) of eq. 1 and 2 at t (n,) in s, and its sigma.

    It is the yaw rate after a unit step of the rudder.
    """

    def answer(x: Floats) -> Floats:
        G = model.transfers(x[None])[0]
        p, residues = G.poles[0], G.residues[0]
        return np.asarray((np.expm1(t[:, None] * p) * (residues / p)).sum(axis=1).real)

    changes = changes_of(answer, model.x, model.covariance)
    return answer(model.x), np.asarray(np.linalg.norm(changes, axis=1))


def residuals_picture(drawn: Drawn) -> Picture:
    """Return the spectra of the yaw rate and of what the model leaves of it."""
    measured, rows, step_s = drawn.measured, drawn.measured.longest, drawn.model.sample_time_s
    left = (measured.y - measured.simulated)[rows]
    length = max(8, round(_segment_s(drawn) / step_s))
    spectra = [
        welch(x - x.mean(), 1.0 / step_s, nperseg=min(length, len(x)))
        for x in (measured.y[rows], left)
    ]

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        shown = (("measured", DATA), ("measured − model", MODEL))
        for (f, power), (label, shade) in zip(spectra, shown, strict=True):
            ax.plot(f[1:], 10.0 * np.log10(np.maximum(power[1:], 1e-30)), color=shade, label=label)
        ax.axvline(drawn.wn_rad_s / (2.0 * np.pi), color=NEUTRAL, linewidth=0.9, ls="--")
        log_axis(ax)
        ax.set(xlabel="frequency [Hz]", ylabel="power [dB, (rad/s)² per Hz]")
        figure.legend(loc="outside upper right", ncols=2)

    look = (
        "What the model leaves of the yaw rate, run free: noise, gusts, and motion that the rudder "
        "does not cause. Dashed: ωn, near which the two lines are farthest apart in calm air."
    )
    return Picture("residuals", "What the model leaves", look, draw, zooms=True)
