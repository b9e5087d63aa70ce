"""The report's section on ordinary flight: its answer, and the spectra that it rests on."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.run_summary import RunSummary
from yawid.report.html import note
from yawid.report.picture import Picture, band, log_axis
from yawid.sinks.palette import BARE, DATA, NEUTRAL
from yawid.sinks.words import ordinary_rows

UNITS = {"p": "(rad/s)²/Hz", "r": "(rad/s)²/Hz", "roll": "rad²/Hz"}


def ordinary_section(summary: RunSummary) -> Iterator[str]:
    """Yield the section on ordinary flight; nothing where it was not looked for."""
    said = [row.text for row in ordinary_rows(summary)]
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
            figure.subplots(len(UNITS), 1, sharex=True), UNITS.items(), strict=True
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
    return Picture("ordinary", "Spectra of ordinary flight", look, draw)
