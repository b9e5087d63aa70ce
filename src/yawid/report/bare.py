"""The report's sections on the bare airframe: from manoeuvres, and from ordinary flight."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.run_summary import Bare, RunSummary
from yawid.report.html import grid, note, tables
from yawid.report.picture import Picture, band, log_axis
from yawid.sinks.palette import BARE, DATA, NEUTRAL
from yawid.sinks.words import GREEK, NONE, bare_rows, of_value, ordinary_rows

SYMBOLS: Final = {
    "Y_beta": ("Y_β/V", "−a_z^β", "1/s"),
    "L_beta": ("L_β", "−a_mx^β", "1/s²"),
    "L_p": ("L_p", "−a_mx^ωx", "1/s"),
    "L_r": ("L_r", "a_mx^ωy", "1/s"),
    "L_delta_a": ("L_δa", "a_mx^δb", "1/s² per aileron"),
    "L_delta_r": ("L_δr", NONE, "1/s² per rudder"),
    "N_beta": ("N_β", "a_my^β", "1/s²"),
    "N_p": ("N_p", "a_my^ωx", "1/s"),
    "N_r": ("N_r", "−a_my^ωy", "1/s"),
    "N_delta_a": ("N_δa", NONE, "1/s² per aileron"),
    "N_delta_r": ("N_δr", "a_my^δH", "1/s² per rudder"),
    "Y_delta_r": ("Y_δr/V", NONE, "1/s per rudder"),
}
"""Of each derivative the usual name, the paper's (eq. 21), and the unit."""
DENSITIES = {"p": "(rad/s)²/Hz", "r": "(rad/s)²/Hz", "roll": "rad²/Hz"}


def bare_section(summary: RunSummary) -> Iterator[str]:
    """Yield the section on the bare airframe; nothing where it was not looked for."""
    bare = summary.bare
    if bare is None:
        return
    first, *others = [_sentence(row.text) for row in bare_rows(summary, GREEK)]
    yield note("The bare airframe", first)
    yield from (note("", text) for text in others)
    if bare.dutch_roll is None:
        return
    rows = [
        (symbol, paper, of_value(bare.derivatives[name]), unit)
        for name, (symbol, paper, unit) in SYMBOLS.items()
        if bare.derivatives and name in bare.derivatives
    ]
    yield tables("", [grid("Derivatives, ± one σ", ("", "paper's", "value", "unit"), rows)])
    yield note(
        "",
        "This is the airframe without the roll loop that it was flown with, from p, r, roll and "
        "the commands of rudder and aileron; a level of flying qualities is its own. One unit of "
        "rudder or aileron is that of its channel. Ixz is folded into the derivatives."
        + _from_prior(bare),
    )


def _sentence(text: str) -> str:
    """Return a text that begins with a capital letter, unless it begins with a symbol."""
    begin = text[0].upper() if text[0].isascii() else text[0]
    return f"{begin}{text[1:].rstrip('.')}."


def _from_prior(bare: Bare) -> str:
    """Return a sentence on the derivatives that the flight does not show, "" without any."""
    symbols = [SYMBOLS[name][0] for name in bare.from_prior or () if name in SYMBOLS]
    if not symbols:
        return ""
    return f" What is known of aircraft beforehand gives {' and '.join(symbols)}, not the flight."


def ordinary_section(summary: RunSummary) -> Iterator[str]:
    """Yield the section on ordinary flight; nothing where it was not looked for."""
    said = [row.text for row in ordinary_rows(summary, GREEK)]
    if said:
        yield note("Ordinary flight", f"{'; '.join(said)}.")


def spectra_picture(found: OrdinaryAnswer | None) -> Picture | None:
    """Return the picture of the spectra of p, r and roll, measured and of the model."""
    if found is None or found.spectrum is None or found.dutch_roll is None:
        return None
    spectrum, wn = found.spectrum, found.dutch_roll.wn_rad_s
    w = np.array(spectrum.w_rad_s)
    spread = np.exp(2.0 / np.sqrt(np.array(spectrum.count)))

    def draw(figure: Figure) -> None:
        for ax, (name, unit) in zip(
            figure.subplots(len(DENSITIES), 1, sharex=True), DENSITIES.items(), strict=True
        ):
            modelled = np.array(spectrum.modelled[name])
            ax.loglog(w, spectrum.measured[name], ".", color=DATA, markersize=4, label="measured")
            ax.plot(w, modelled, color=BARE, label="model")
            band(ax, w, modelled / spread, modelled * spread, BARE)
            ax.axvline(wn, color=NEUTRAL, linewidth=0.8, linestyle="--")
            ax.yaxis.set_major_formatter(StrMethodFormatter("{x:.0e}"))
            ax.set_ylabel(f"{name}\n{unit}")
        log_axis(ax)
        ax.set_xlabel("frequency [rad/s]")
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper right", ncols=2)

    look = (
        f"The band used, {w[0]:.2g} to {w[-1]:.2g} rad/s; dashed: ωn of the aircraft without its "
        "autopilot. Shaded: where 95 % of the points should be. The model has the aileron as it "
        "was, so that turns are in it."
    )
    return Picture("ordinary", "Spectra of ordinary flight", look, draw, zooms=True)
