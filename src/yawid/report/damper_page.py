"""The page of ``yawid damper``: one HTML file in the report's style."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from yawid.answers.damper_report import DamperReport
from yawid.blocks import Floats
from yawid.damper.advice import LEAST_PHASE_DEG, Predicted
from yawid.damper.loop import closed_dutch_roll, closed_response, known_frequencies
from yawid.damper.study import Study
from yawid.physics.modes import Complexes
from yawid.report.html import head, listed, note, page, pictures, sheet
from yawid.report.picture import Picture, band, log_axis
from yawid.sinks.palette import BAD, DATA, MODEL, NEUTRAL, RUDDER
from yawid.sinks.run_page import MEANS, gains_grid
from yawid.system.part_file import written_whole

PERIODS_SHOWN: Final = 16.0
"""The periods of the Dutch roll over which the response is drawn."""
SHADES: Final = (MODEL, RUDDER, BAD)
"""The colour of each airspeed, the lowest first."""


def write_damper_page(found: Study, path: Path, *, force: bool = False) -> None:
    """Write the page of a damper's predictions to ``path``.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """
    assert found.predicted is not None
    name = Path(found.report.log).name
    with written_whole(path, force=force) as stream:
        sections = _sections(found.report, found.predicted, name)
        stream.write(page(f"{name} - yawid damper", sections).encode("utf-8", "replace"))


def _sections(report: DamperReport, predicted: Predicted, name: str) -> Iterator[str]:
    band_said = report.recommended
    sentence = (
        f"No {report.parameter} is recommended."
        if band_said is None
        else f"{report.parameter}: aim at {band_said.low:g} to {band_said.high:g}, "
        f"fly {band_said.next:g} next."
    )
    flown = f"{report.parameter} flown {report.flown:g}"
    origin = f"{report.autopilot} · loop at {report.loop_rate_hz:g} Hz · {flown}"
    reasons = [(each.weight, each.name, each.text, "") for each in report.verdict.reasons]
    body = note("", " ".join(report.says)) + listed(reasons)
    if report.mix is not None:
        body += note("", f"Rudder mix, {report.mix.parameter}: {report.mix.text}")
    yield head(name, origin, sentence, body, usable=band_said is not None)
    drawn = predicted, _gain_of(report, predicted), report.parameter or ""
    of_gains = [_over_gain(report, predicted), _locus(report, predicted)]
    yield pictures("The damped aircraft", [*of_gains, _bode(*drawn), _response(*drawn)])
    grid = gains_grid(report)
    rows = [([(cell, "") for cell in row], False) for row in grid.rows]
    yield sheet("Every gain", grid.heads, rows)
    yield note("", f"{MEANS}. Bands are 2 sigma.")


def _gain_of(report: DamperReport, predicted: Predicted) -> float:
    """Return the gain that is drawn: the next to fly, else the flown one, else a middle one."""
    if report.recommended is not None:
        return report.recommended.next
    return report.flown or float(predicted.closed.gains[len(predicted.closed.gains) // 4])


def _over_gain(report: DamperReport, predicted: Predicted) -> Picture:
    closed = predicted.closed

    def draw(figure: Figure) -> None:
        axes = figure.subplots(2, 1, sharex=True)
        of_zeta, of_wn = (closed.zeta, closed.zeta_std), (closed.wn_rad_s, closed.wn_std)
        for ax, (middle, std), label in zip(
            axes, (of_zeta, of_wn), ("ζ", "ωn [rad/s]"), strict=True
        ):
            for v, speed in enumerate(closed.airspeeds_m_s):
                shade = SHADES[v % len(SHADES)]
                ax.plot(closed.gains, middle[v], color=shade, label=f"{speed:.1f} m/s")
                band(ax, closed.gains, middle[v] - 2.0 * std[v], middle[v] + 2.0 * std[v], shade)
            if (best := report.recommended) is not None:
                ax.axvspan(best.low, best.high, color=NEUTRAL, alpha=0.2)
                ax.axvline(best.next, color=NEUTRAL, linestyle="--")
            ax.set_ylabel(label)
        axes[1].set_xlabel(report.parameter or "")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)

    look = "Grey: the band aimed at; dashed: the gain to fly next. Bands: 2 sigma."
    return Picture("over-gain", "Damping and frequency over the gain", look, draw, zooms=True)


def _locus(report: DamperReport, predicted: Predicted) -> Picture:
    closed = predicted.closed

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        for v, (speed, law) in enumerate(zip(closed.airspeeds_m_s, predicted.laws, strict=True)):
            s = closed_dutch_roll(predicted.aircraft.middle_at(speed), law, closed.gains)[:, 0]
            shade = SHADES[v % len(SHADES)]
            ax.plot(s.real, s.imag, color=shade, label=f"{speed:.1f} m/s")
            ax.plot(s.real[:1], s.imag[:1], "x", color=shade)
            shown = [int(np.argmin(np.abs(closed.gains - each.value))) for each in report.gains]
            ax.plot(s.real[shown], s.imag[shown], ".", color=shade)
        low, high = ax.get_ylim()
        top = max(high, 1e-9)
        for zeta in (0.1, 0.2, 0.3, 0.4, 0.6):
            end = -top * zeta / np.sqrt(1 - zeta**2)
            ax.plot([0.0, end], [0.0, top], color="#cccccc", linewidth=0.6)
            ax.annotate(f"{zeta:g}", (end, top), fontsize=7, color="#777777")
        ax.set(ylim=(min(low, 0.0), high), xlabel="real [1/s]", ylabel="imaginary [rad/s]")
        figure.legend(loc="outside upper right", ncols=3)

    look = "The Dutch roll from no damper (x) on. Dots: gains of the table; grey: constant ζ."
    return Picture("locus", "Root locus", look, draw)


def _bode(predicted: Predicted, gain: float, name: str) -> Picture:
    law, speed = predicted.laws[0], predicted.closed.airspeeds_m_s[0]
    aircraft = predicted.aircraft.at(speed)
    w = known_frequencies(
        float(np.median(np.abs(aircraft.dutch_roll))), predicted.manoeuvre.sample_time_s
    )
    s: Complexes = (1j * w).astype(np.complex128)
    every = law.at(s, gain) * aircraft.at(s)
    middle = (law.at(s, gain) * predicted.aircraft.middle_at(speed).at(s))[0]

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True)
        decibels = 20.0 * np.log10(np.abs(every))
        upper.plot(w, 20.0 * np.log10(np.abs(middle)), color=MODEL)
        band(upper, w, *_ninety_five(decibels), MODEL)
        upper.axhline(0.0, color=NEUTRAL, linewidth=0.9)
        phase = np.degrees(np.unwrap(np.angle(every), axis=1))
        lower.plot(w, np.degrees(np.unwrap(np.angle(middle))), color=MODEL)
        band(lower, w, *_ninety_five(phase), MODEL)
        for edge in (-180.0, 180.0):
            lower.axhline(edge, color=BAD, linewidth=0.9)
            inside = edge - np.sign(edge) * LEAST_PHASE_DEG
            lower.axhline(inside, color=BAD, linewidth=0.7, linestyle=":")
        log_axis(upper)
        upper.set_ylabel("|L| [dB]")
        lower.set(xlabel="ω [rad/s]", ylabel="phase [deg]")

    look = (
        f"With {name} {gain:g} at {speed:.1f} m/s, over the frequencies where the model is known. "
        "Where |L| crosses 0 dB the phase must be within the dotted lines. Bands: 95 %."
    )
    return Picture("open-loop", "Open loop", look, draw, zooms=True)


def _ninety_five(values: Floats) -> tuple[Floats, Floats]:
    low, high = np.percentile(values, [2.5, 97.5], axis=0)
    return low, high


def _response(predicted: Predicted, gain: float, name: str) -> Picture:
    flown = predicted.manoeuvre
    speeds = np.array(predicted.closed.airspeeds_m_s)
    v = int(np.argmin(np.abs(speeds - predicted.aircraft.airspeed_m_s)))
    G, law = predicted.aircraft.middle_at(speeds[v]), predicted.laws[v]
    period_s = 2.0 * np.pi / float(np.abs(G.dutch_roll[0]))
    shown = slice(0, round(PERIODS_SHOWN * period_s / flown.sample_time_s))
    u, t = predicted.pilot[shown], (flown.t - flown.t[0])[shown]
    y = (flown.y - np.nanmedian(flown.y))[shown]
    without, damped = (
        closed_response(G, law, each, u, flown.sample_time_s) for each in (None, gain)
    )

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 2])
        upper.plot(t, u, color=RUDDER)
        upper.set_ylabel("rudder")
        lower.plot(t, y, color=DATA, linewidth=0.9, label="measured")
        lower.plot(t, without, color=NEUTRAL, label="without damper")
        lower.plot(t, damped, color=MODEL, label=f"with {name} {gain:g}")
        lower.set(xlabel="s", ylabel="yaw rate [rad/s]")
        figure.legend(loc="outside upper right", ncols=3)

    look = "The rudder that the pilot moved, without and with the damper: how the manoeuvre began."
    return Picture(
        "response", "The manoeuvre flown, without and with the damper", look, draw, zooms=True
    )
