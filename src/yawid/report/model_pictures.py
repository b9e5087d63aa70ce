"""Pictures of the model: poles and zeros, frequency response, step response, residuals.

All sigmas are found by the delta method from the covariance of theta, with exact derivatives. With
q^-1 the delay by one sample and X = B/A u the model's response,

    dX/da_i = -(q^-i / A) X,    dX/db_i = (q^-(nk+i-1) / A) u.
"""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from scipy.signal import correlate, lfilter

from yawid.answers.run_summary import DutchRoll
from yawid.blocks import Floats, Ints
from yawid.errors import YawidError
from yawid.models.fitted import Judged, Model
from yawid.physics.frequency_response import FrequencyResponse, frequency_response
from yawid.physics.model_response import step_response
from yawid.physics.modes import Complexes, damping_lines, discrete_poles, pair_poles
from yawid.report.picture import Picture, band, log_axis
from yawid.sinks.base import Grid
from yawid.sinks.palette import BAD, BARE, DATA, MODEL, NEUTRAL

LAGS = 25
COHERENT = 0.6
APART = 1.04
HIGHEST = 0.9
"""The highest frequency drawn, as a part of half the rate: above it a model does not describe the
aircraft."""
MOST_DB = 45.0
"""The range below the peak of the gain that is drawn: a notch must not flatten all the rest."""
PERIODS = 10.0
"""The length of a segment of the spectral estimate, in periods of the Dutch roll."""


def poles_picture(model: Model, bare: DutchRoll | None = None) -> Picture:
    """Return the picture of poles with their 2 sigma ellipses, and zeros, in the z plane.

    The Dutch roll of the bare airframe, where it is known, stands next to them.
    """
    z, spread = poles_with_sigma(model)
    its_own: Complexes = np.empty(0, complex)
    if bare is not None:
        its_own = pair_poles(bare.wn_rad_s, bare.zeta, model.sample_time_s)

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        _plane(ax)
        for pole, covariance in zip(z, spread, strict=True):
            _ellipse(ax, pole, covariance)
        ax.plot(z.real, z.imag, "x", color=MODEL, markersize=8, markeredgewidth=2, label="pole")
        found = zeros(model)
        inside = found[np.abs(found) < 1.6]
        ax.plot(
            inside.real, inside.imag, "o", color=MODEL, markersize=7, fillstyle="none",
            markeredgewidth=1.6, label="zero",
        )  # fmt: skip
        if len(its_own):
            x, y = its_own.real, its_own.imag
            ax.plot(x, y, "+", color=BARE, markersize=10, markeredgewidth=2, label="bare airframe")
        figure.legend(loc="outside upper right", ncols=3)

    look = (
        "The pair off the real axis is the Dutch roll, the nearer to the circle the less damped. A "
        "pole with a zero on top does nothing: a lower order would do. Ellipses: 2 sigma of noise."
    )
    if bare is not None:
        look += " +: the Dutch roll of the bare airframe, without its roll loop."
    return Picture("poles", "Poles and zeros", look, draw)


def _plane(ax: Axes) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    ax.plot(np.cos(angle), np.sin(angle), color="#444444", linewidth=1.0)
    for z in damping_lines():
        for sign in (1.0, -1.0):
            ax.plot(z.real, sign * z.imag, color="#cccccc", linewidth=0.6)
    ax.set_aspect("equal")
    ax.set(xlim=(-1.25, 1.45), ylim=(-1.12, 1.12), xlabel="real", ylabel="imaginary")


def _ellipse(ax: Axes, pole: complex, covariance: Floats) -> None:
    if not np.isfinite(covariance).all():
        return
    variance, axes = np.linalg.eigh(covariance)
    width, height = np.maximum(4.0 * np.sqrt(np.maximum(variance[::-1], 0.0)), 0.015)
    angle = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    size = max(width, height)
    if size < 2.0:
        ax.add_patch(
            Ellipse((pole.real, pole.imag), width, height, angle=angle, color=MODEL, alpha=0.25)
        )


def bode_picture(model: Model, judged: Judged, mode: DutchRoll | None, grid: Grid) -> Picture:
    """Return the frequency response from rudder to yaw rate, with its band, and spectral points."""
    spectral = _spectral(judged, model, mode)
    nyquist = 0.5 / model.sample_time_s
    low = 0.02 * nyquist if spectral is None else min(0.02 * nyquist, spectral.frequency_hz[0])
    response = frequency_band(model, np.geomspace(low, HIGHEST * nyquist, 200))
    f, phase = response.frequency_hz, np.unwrap(np.angle(response.G))

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.4, 1])
        gain_db = 20.0 * np.log10(np.abs(response.G))
        spread_db = 40.0 / math.log(10.0) * response.log_magnitude_std
        upper.plot(f, gain_db, color=MODEL, label="model")
        band(upper, f, gain_db - spread_db, gain_db + spread_db, MODEL)
        lower.plot(f, np.degrees(phase), color=MODEL)
        spread = 2.0 * response.phase_std_rad
        band(lower, f, np.degrees(phase - spread), np.degrees(phase + spread), MODEL)
        if spectral is not None:
            _draw_spectral(upper, lower, spectral, np.interp(spectral.frequency_hz, f, phase))
        if mode is not None:
            for ax in (upper, lower):
                ax.axvline(mode.wn_rad_s / (2.0 * np.pi), color=NEUTRAL, linewidth=0.9, ls="--")
        log_axis(upper)
        upper.set_ylabel(f"gain [dB, rad/s per {grid.rudder_unit}]")
        lower.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
        upper.set_xlim(low, HIGHEST * nyquist)
        _room(upper, np.maximum(gain_db, gain_db.max() - MOST_DB))
        _room(lower, np.degrees(phase))
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper right", ncols=2)

    look = (
        "The points come straight from the data, without a model, where rudder and yaw rate are "
        "coherent: off the line near the dashed ωn they mean a wrong order. Band and bars: 2 sigma "
        "of noise."
    )
    if spectral is None or not (spectral.coherence >= COHERENT).any():
        look = "Dashed: ωn. Band: 2 sigma of noise."
    if len(grid.inputs) > 1:
        look += " The points ignore the aileron."
    return Picture("bode", "Frequency response, rudder to yaw rate", look, draw)


def _spectral(judged: Judged, model: Model, mode: DutchRoll | None) -> FrequencyResponse | None:
    rows = judged.longest_stretch()
    seconds = (rows.stop - rows.start) * model.sample_time_s
    wanted = PERIODS * 2.0 * np.pi / mode.wn_rad_s if mode is not None else seconds / 8.0
    segment_s = min(max(wanted, 64.0 * model.sample_time_s), seconds / 4.0)
    try:
        u, y = judged.u[rows, 0], judged.y[rows]
        return frequency_response(u, y, model.sample_time_s, segment_s)
    except YawidError:
        return None


def _draw_spectral(
    upper: Axes, lower: Axes, spectral: FrequencyResponse, model_phase: Floats
) -> None:
    good = _apart(spectral.frequency_hz, np.flatnonzero(spectral.coherence >= COHERENT))
    f, gain = spectral.frequency_hz[good], np.abs(spectral.G[good])
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


def _apart(frequency_hz: Floats, rows: Ints) -> Ints:
    """Return rows that are far enough apart on the logarithmic axis to be seen as single points."""
    kept: list[int] = []
    for i in rows.tolist():
        if not kept or frequency_hz[i] > APART * frequency_hz[kept[-1]]:
            kept.append(i)
    return np.array(kept, dtype=np.int64)


def _room(ax: Axes, line: Floats) -> None:
    low, high = float(np.nanmin(line)), float(np.nanmax(line))
    room = 0.12 * max(high - low, 1.0)
    ax.set_ylim(low - room, high + room)


def step_picture(model: Model, mode: DutchRoll | None, grid: Grid) -> Picture:
    """Return the picture of the yaw rate after a unit step of the rudder, with its band."""
    period_s = 2.0 * np.pi / mode.wn_rad_s if mode is not None else 2.0
    steps = int(np.clip(4.0 * period_s / model.sample_time_s, 20, 2000))
    answer, std = step_band(model, steps)
    t = np.arange(steps, dtype=np.float64) * model.sample_time_s

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.plot(t, answer, color=MODEL)
        band(ax, t, answer - 2.0 * std, answer + 2.0 * std, MODEL)
        ax.axhline(0.0, color=NEUTRAL, linewidth=0.8)
        ax.set(xlabel="time after the step [s]", ylabel="yaw rate [rad/s]", xlim=(0.0, t[-1]))

    look = (
        f"After the rudder steps by 1 {grid.rudder_unit}, nose right, the first swing must go up; "
        "late values lean on the spiral mode, which no short record shows. Band: 2 sigma of noise."
    )
    return Picture("step", "Step response", look, draw)


def residuals_picture(judged: Judged, p: float | None) -> Picture:
    """Return the autocorrelation of the residuals, and their correlation with the rudder.

    ``p`` is the p-value of the whiteness test, None where unknown.
    """

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1)
        own, lags, count = correlation(judged.residual, judged.residual, LAGS)
        half = len(lags) // 2
        bound = 2.0 / math.sqrt(max(count, 1))
        _stems(upper, lags[half + 1 :], own[half + 1 :], bound)
        upper.set_ylabel("with itself")
        cross, lags, count = correlation(judged.residual, judged.u[:, 0], LAGS)
        moved, _, _ = correlation(judged.u[:, 0], judged.u[:, 0], LAGS)
        spread = float(np.sum(own * moved)) if len(own) == len(moved) else 1.0
        _stems(lower, lags, cross, 2.0 * math.sqrt(max(spread, 1.0) / max(count, 1)))
        lower.set(xlabel="lag [samples]", ylabel="with the rudder")

    look = (
        "Red bars leave the 2 sigma bounds. With itself: the noise is not fully modelled (raise "
        "nc). With the rudder at lags above 0: its effect is not fully modelled (raise na, nb or "
        "nk)."
    )
    if p is not None:
        look += f" Whiteness (Ljung-Box): p = {p:.2g}."
    return Picture("residuals", "Residuals: is anything left?", look, draw)


def _stems(ax: Axes, lags: Floats, values: Floats, bound: float) -> None:
    ax.axhspan(-bound, bound, color=NEUTRAL, alpha=0.25, linewidth=0.0)
    shades = [BAD if abs(value) > bound else NEUTRAL for value in values]
    ax.bar(lags, values, width=0.55, color=shades)
    ax.axhline(0.0, color=NEUTRAL, linewidth=0.8)
    limit = max(1.6 * bound, 1.15 * float(np.max(np.abs(values), initial=0.0)))
    ax.set_ylim(-limit, limit)


@dataclass(frozen=True, slots=True)
class Response:
    """G (n,) from rudder to yaw rate at ``frequency_hz`` (n,), and the sigmas of ln|G| and angle.

    The unit of G is rad/s per unit of rudder.
    """

    frequency_hz: Floats
    G: Complexes
    log_magnitude_std: Floats
    phase_std_rad: Floats


def frequency_band(model: Model, frequency_hz: Floats) -> Response:
    """Return the frequency response to the first input with its sigmas."""
    na, nb, nk = model.orders.na, model.orders.nb[0], model.orders.nk[0]
    z = np.exp(2j * np.pi * frequency_hz * model.sample_time_s)
    delays = z[:, None] ** -np.arange(1, na + 1)
    forward = z[:, None] ** -(nk + np.arange(nb))
    denominator = 1.0 + delays @ model.theta[:na]
    numerator = forward @ model.theta[na : na + nb]
    # The real part of d ln G is the derivative of ln|G|, its imaginary part that of the angle.
    slopes = np.hstack([-delays / denominator[:, None], forward / numerator[:, None]])
    covariance = model.covariance[: na + nb, : na + nb]
    real, imaginary = (_sigma(part, covariance) for part in (slopes.real, slopes.imag))
    return Response(frequency_hz, numerator / denominator, real, imaginary)


def step_band(model: Model, steps: int) -> tuple[Floats, Floats]:
    """Return the yaw rate (steps,) after a unit step of the first input, and its sigma."""
    na, nb, nk = model.orders.na, model.orders.nb[0], model.orders.nk[0]
    answer = step_response(model.theta, model.orders, steps)
    a = np.concatenate([[1.0], model.theta[:na]])
    by_a = [-lfilter(_delay(i), a, answer) for i in range(1, na + 1)]
    by_b = [lfilter(_delay(nk + i), a, np.ones(steps)) for i in range(nb)]
    covariance = model.covariance[: na + nb, : na + nb]
    return answer, _sigma(np.column_stack([*by_a, *by_b]), covariance)


def _delay(count: int) -> Floats:
    return np.concatenate([np.zeros(count), [1.0]])


def _sigma(slopes: Floats, covariance: Floats) -> Floats:
    variance = np.einsum("ki,ij,kj->k", slopes, covariance, slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def zeros(model: Model) -> Complexes:
    """Return the finite zeros of the first input's B(z)."""
    first = model.orders.na
    b = model.theta[first : first + model.orders.nb[0]]
    return np.asarray(np.roots(np.trim_zeros(b, "f")), dtype=np.complex128)


def poles_with_sigma(model: Model) -> tuple[Complexes, Floats]:
    """Return the poles z (na,) and the covariances (na, 2, 2) of their real and imaginary parts."""
    na = model.orders.na
    z = discrete_poles(model.theta[None, :na])[0]
    distance = z[:, None] - z[None, :] + np.eye(na)
    with np.errstate(divide="ignore", invalid="ignore"):
        dz = -(z[:, None] ** np.arange(na - 1, -1, -1)) / np.prod(distance, axis=1)[:, None]
    parts = np.stack([dz.real, dz.imag], axis=1)
    return z, parts @ model.covariance[:na, :na] @ parts.transpose(0, 2, 1)


def correlation(x: Floats, v: Floats, lags: int) -> tuple[Floats, Floats, int]:
    """Return r(l) = corr(x(k), v(k-l)) and l for l = -lags..lags, and the number of samples.

    ``x``, ``v`` (n,); rows where either is NaN count as their mean. ``lags`` is cut to n - 1.
    """
    good = np.isfinite(x) & np.isfinite(v)
    count = int(good.sum())
    if count < 3 or not (x[good].std() > 0.0 and v[good].std() > 0.0):
        return np.zeros(2 * lags + 1), np.arange(-lags, lags + 1, dtype=np.float64), count
    p, q = (np.where(good, (s - s[good].mean()) / s[good].std(), 0.0) for s in (x, v))
    half = min(lags, len(p) - 1)
    r = correlate(p, q)[len(p) - 1 - half : len(p) + half] / count
    return r, np.arange(-half, half + 1, dtype=np.float64), count
