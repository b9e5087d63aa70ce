"""The search for the best fit: starts over all frequencies, each to its end, the best of them."""

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from yawid.blocks import Floats
from yawid.lateral.model import Law, modes
from yawid.ordinary.fit import Fitted, fit, left_over, start_at
from yawid.ordinary.law import law_of
from yawid.ordinary.model import Model, full
from yawid.ordinary.spectra import Band, Complex, Sums, band

BAND = 0.3, 3.5
"""The band of a fit in wn: below it turns are not linear, above it other modes begin."""
STARTS = 0.6, 0.9, 1.3, 1.9, 2.7, 3.8, 5.5, 8.0, 11.5
"""The starts' wn in rad/s."""
WIDE, STEPS, BEST, JOINED = (0.25, 18.0), 12, 3, 3
"""The band of all starts in rad/s, their steps, those that go on, and the bins taken as one."""
APART = 0.02
"""Two starts that come to the same wn, to this part, are one."""
LEAST_LAW = 0.85
"""The least that a law explains of the aileron: less is a pilot, or commands of other times. A law
that explained .48 of a calm flight at 10 Hz made the aircraft unstable, and wn 20 % low."""
USABLE = 0.8
"""The part of the Nyquist frequency below which spectra are used."""
ROUNDS, NOISE_BINS = 2, 5
"""The fits by turns, and the bins on each side over which the noise is a mean: 13 % of w."""
FEWEST = 10
"""The fewest bins of a fit."""


class Search:
    """The fits of sums: ``limit`` is the highest frequency in rad/s.

    ``found_law`` explains a part ``explained`` of the aileron; ``law`` is it, or none.
    """

    def __init__(self, sums: Sums) -> None:
        self._sums, self.limit = sums, USABLE * math.pi / sums.step_s
        self.airspeed_m_s, self._pitch = sums.speed / sums.seconds, sums.pitch / sums.seconds
        self.found_law, self.explained = law_of(sums.law)
        self.law = self.found_law if self.explained >= LEAST_LAW else Law()
        self._wide = band(sums, WIDE[0], min(WIDE[1], self.limit), JOINED)
        high = self._wide.w > 0.6 * self._wide.w[-1]
        power = np.einsum("bii->bi", self._wide.Z[high]).real[:, :3] / self._wide.n[high, None]
        self._noise: Floats = 0.5 * np.log(np.maximum(np.median(power, axis=0), 1e-14))

    def fits(self) -> list[Fitted]:
        """Return the ends of the best starts on one band, the best of them first."""
        starts = (self._fit(None, self._wide, wn, STEPS) for wn in STARTS if wn < 0.75 * self.limit)
        ends: list[Fitted] = []
        picked: list[float] = []
        for each in sorted((x for x in starts if x is not None), key=lambda x: x.loss):
            wn = wn_of(each)
            if len(picked) == BEST or any(abs(math.log(wn / x)) < APART for x in picked):
                continue
            picked.append(wn)
            found = self.again(each, wn)
            found = None if found is None else self.again(found, wn_of(found))
            ends += [] if found is None else [found]
        middle = float(np.median([wn_of(each) for each in ends])) if ends else math.nan
        found_all = (self.again(each, middle) for each in ends)
        return sorted((x for x in found_all if x is not None), key=lambda x: x.loss)

    def again(
        self,
        start: Fitted,
        wn: float,
        parts: tuple[float, float] = BAND,
        law: Law | None = None,
    ) -> Fitted | None:
        """Return the fit from another's end, in a band around wn in rad/s; None without a mode.

        Another ``law`` may be tried.
        """
        data = band(self._sums, parts[0] * wn, min(parts[1] * wn, self.limit))
        return self._fit(start.x, data, wn, law=law)

    def by_turns(self, start: Fitted) -> Fitted | None:
        """Return the fit of what the inputs make alone, whose noise is what each fit leaves."""
        found: Fitted | None = start
        for _ in range(ROUNDS):
            if found is None:
                return None
            _, E = left_over(start.band, start.model, start.model.at(found.x)[0])
            noise = (
                around(E, 2 * NOISE_BINS + 1)
                / around(start.band.n, 2 * NOISE_BINS + 1)[:, None, None]
            )
            found = self._fit(found.x, start.band, wn_of(start), noise=noise)
        return found

    def _fit(
        self,
        x: Floats | None,
        data: Band,
        wn: float,
        steps: int = 40,
        law: Law | None = None,
        noise: Complex | None = None,
    ) -> Fitted | None:
        if len(data.w) < FEWEST:
            return None
        wide = Model(self._wide.w, self.airspeed_m_s, self.law)
        start, guess = start_at(wn, self._wide, wide, self._pitch, self._noise)
        model = Model(data.w, self.airspeed_m_s, law or self.law, noise)
        try:
            found = fit(start if x is None else x, data, model, guess, steps)
        except np.linalg.LinAlgError:
            return None
        return found if math.isfinite(found.loss) and math.isfinite(wn_of(found)) else None


def around(x: Complex | Floats, count: int) -> Any:
    """Return the sums of rows (b, ...) over ``count`` of them around each, mirrored at the ends."""
    half = count // 2
    padded = np.pad(x, [(half, half)] + [(0, 0)] * (x.ndim - 1), mode="reflect")
    return sliding_window_view(padded, count, axis=0).sum(axis=-1)


def wn_of(found: Fitted) -> float:
    """Return wn in rad/s of the bare airframe, NaN where it does not oscillate."""
    return float(modes(full(found.x[None]), found.model.airspeed_m_s)[0, 0])
