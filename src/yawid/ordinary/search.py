"""The search for the best fit: starts over all frequencies, each to its end, the best of them."""

import math

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import Guess, Law, modes
from yawid.ordinary.fit import Fitted, fit, start_at
from yawid.ordinary.law import law_of
from yawid.ordinary.model import Model, full
from yawid.ordinary.spectra import Band, Sums, band

BAND = 0.3, 3.5
"""The band of a fit in wn: below it turns are not linear, above it other modes begin."""
STARTS = 0.6, 0.9, 1.3, 1.9, 2.7, 3.8, 5.5, 8.0, 11.5
"""The starts' wn in rad/s."""
WIDE = 0.25, 18.0
STEPS, BEST, JOINED = 12, 3, 3
"""The steps of each start, on spectra of every three bins as one, and the starts that go on."""
APART = 0.02
"""Two starts that come to the same wn, to this part, are one."""
LEAST_OF_LAW = 0.05
"""There is no law where it explains less of the aileron: a pilot, or commands of other times."""
USABLE = 0.8
"""The part of the Nyquist frequency below which spectra are used."""


class Search:
    """The fits of sums: ``law`` with its R squared, ``limit`` the highest frequency in rad/s."""

    def __init__(self, sums: Sums) -> None:
        self.sums = sums
        self.airspeed_m_s, self.pitch = sums.speed / sums.seconds, sums.pitch / sums.seconds
        self.limit = USABLE * math.pi / sums.step_s
        law, self.explained = law_of(sums.law)
        self.law = law if self.explained > LEAST_OF_LAW else Law()
        self._wide = band(sums, WIDE[0], min(WIDE[1], self.limit), JOINED)
        high = self._wide.w > 0.6 * self._wide.w[-1]
        power = np.einsum("bii->bi", self._wide.Z[high]).real[:, :3] / self._wide.n[high, None]
        self.noise: Floats = 0.5 * np.log(np.maximum(np.median(power, axis=0), 1e-14))

    def fits(self) -> list[Fitted]:
        """Return the ends of the best starts on one band, the best of them first."""
        coarse = [x for wn in STARTS if wn < 0.75 * self.limit and (x := self._from(wn))]
        picked: list[Fitted] = []
        for each in sorted(coarse, key=lambda x: x.loss):
            if len(picked) < BEST and all(
                abs(math.log(wn_of(each) / wn_of(x))) > APART for x in picked
            ):
                picked.append(each)
        ends = [end for each in picked if (end := self._settled(each)) is not None]
        if not ends:
            return []
        middle = float(np.median([wn_of(each) for each in ends]))
        found = [x for each in ends if (x := self.again(each, middle)) is not None]
        return sorted(found, key=lambda x: x.loss)

    def again(
        self, start: Fitted, wn: float, sums: Sums | None = None, parts: tuple[float, float] = BAND
    ) -> Fitted | None:
        """Return the fit from another's end, in a band around wn in rad/s; None without a mode."""
        low, high = parts[0] * wn, min(parts[1] * wn, self.limit)
        data = band(sums or self.sums, low, high)
        return self._fit(start.x, data, wn, start, 40)

    def _from(self, wn: float) -> Fitted | None:
        model = Model(self._wide.w, self.airspeed_m_s, self.law)
        x, guess = start_at(wn, self._wide, model, self.pitch, self.noise)
        found = self._try(x, self._wide, model, guess, STEPS)
        return found if found is not None and math.isfinite(wn_of(found)) else None

    def _settled(self, start: Fitted) -> Fitted | None:
        """Return the fit whose band has the wn that it finds."""
        for _ in range(2):
            before = wn_of(start)
            found = self.again(start, before)
            if found is None:
                return None
            start = found
            if abs(math.log(wn_of(start) / before)) < 0.03:
                break
        return start

    def _fit(self, x: Floats, data: Band, wn: float, like: Fitted, steps: int) -> Fitted | None:
        if len(data.w) < 10:
            return None
        model = Model(data.w, self.airspeed_m_s, self.law)
        _, guess = start_at(wn, self._wide, model, self.pitch, self.noise)
        found = self._try(x, data, model, guess, steps)
        return found if found is not None and math.isfinite(wn_of(found)) else None

    def _try(self, x: Floats, data: Band, model: Model, guess: Guess, steps: int) -> Fitted | None:
        try:
            found = fit(x, data, model, guess, steps)
        except np.linalg.LinAlgError:
            return None
        return found if math.isfinite(found.loss) else None


def wn_of(found: Fitted) -> float:
    """Return wn in rad/s of the bare airframe, NaN where it does not oscillate."""
    return float(modes(full(found.x[None]), found.model.airspeed_m_s)[0, 0])
