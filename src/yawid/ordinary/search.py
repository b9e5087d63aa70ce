"""The search for the best fit: starts over all frequencies, each to its end, the best of them."""

import math
from dataclasses import replace

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import Guess, Law
from yawid.ordinary.fit import Fitted, fit, is_stable
from yawid.ordinary.model import AT, FROZEN, NAMES, SPAN, Band, known_before
from yawid.ordinary.spectra import Sums, spectra

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


class Search:
    """The fits of sums with their ``own`` law: ``limit`` is the highest frequency in rad/s.

    ``found_law`` explains a part ``explained`` of the aileron, both 0 where its gain is below 0;
    ``law`` is it, or none.
    """

    def __init__(self, sums: Sums, own: tuple[Law, float]) -> None:
        seen = sums.n > 0.0
        self._sums, self.limit = sums, float((sums.w[seen] / sums.n[seen])[-1])
        self._pitch = sums.pitch / sums.seconds
        self.found_law, self.explained = own if own[0].roll_gain > 0.0 else (Law(), 0.0)
        self.law = self.found_law if self.explained >= LEAST_LAW else Law()
        wide = spectra(sums, WIDE[0], WIDE[1], JOINED)
        self._wide = Band(*wide, sums.speed / sums.seconds, self.law, (np.zeros(0), np.zeros(0)))

    def fits(self, near: tuple[float, ...] = ()) -> list[Fitted]:
        """Return the ends of the best starts on one band, the best of them first.

        They are over all frequencies, or ``near`` some wn in rad/s.
        """
        starts = [
            fit(start, replace(self._wide, known=known), STEPS)
            for start, known in (self._start(wn) for wn in near or STARTS if wn < 0.75 * self.limit)
        ]
        ordered = sorted((x for x in starts if x.wn > 0.0), key=lambda x: -x.loss)
        picked = {round(math.log(each.wn) / APART): each for each in ordered}
        best = sorted(picked.values(), key=lambda x: x.loss)[:BEST]
        ends = [self.again(each, each.wn) for each in best]
        ends = [self.again(each, each.wn) for each in ends if each.wn > 0.0]
        middle = float(np.median([each.wn for each in ends if each.wn > 0.0] or [math.nan]))
        found = [self.again(each, middle) for each in ends if each.wn > 0.0]
        return sorted((each for each in found if each.wn > 0.0), key=lambda x: x.loss)

    def again(self, start: Fitted, wn: float, parts: tuple[float, float] = BAND) -> Fitted:
        """Return the fit from another's end, in a band around wn in rad/s."""
        data = spectra(self._sums, parts[0] * wn, parts[1] * wn)
        _, known = self._start(wn)
        return fit(start.x, Band(*data, self._wide.airspeed_m_s, self.law, known))

    def _start(self, wn: float) -> tuple[Floats, tuple[Floats, Floats]]:
        """Return parameters (n,) of a plausible aircraft of this wn in rad/s, and its prior."""
        wide, pitch = self._wide, self._pitch
        power = np.einsum("bii->ib", wide.Z).real / wide.n
        a = np.einsum("bi,bij,bj->b", U := wide.inputs()[:, 0], wide.Z, U.conj()).real / wide.n
        near = float(np.mean(power[1, np.argsort(np.abs(wide.w - wn))[:3]])) + 1e-14
        high = power[:3, wide.w > 0.6 * wide.w[-1]]
        noise = 0.5 * np.log(np.maximum(np.median(high, axis=1), 1e-14))
        L_p = -2.5 * wn
        start = dict.fromkeys(NAMES, 0.0) | {
            "log_Y_beta": math.log(0.12 * wn), "L_beta": -1.5 * wn**2,
            "L_p": L_p, "L_r": 0.2 * wn,
            "L_delta_a": -L_p * math.sqrt(float(power[0].sum() / (a.sum() + 1e-12))),
            "N_beta": wn**2, "N_p": -0.05 * wn, "N_r": -0.25 * wn, "N_delta_r": 1.0,
            "alpha": pitch, "delay": 0.01, "servo_lag": 0.04,
            "frozen": FROZEN[0], "log_span_lag": math.log(SPAN[0] / wn),
            "log_gust": 0.5 * math.log(near * 0.16 * wn**2 / (0.3 * wn)),
            "log_gust_rate": math.log(0.15 * wn),
            "log_roll_gust": 0.5 * math.log(float(np.median(power[0])) + 1e-14),
            "log_roll_gust_rate": math.log(1.5 * wn), "log_yaw_gust": 0.5 * math.log(near) - 1.0,
            "log_sigma_p": noise[0], "log_sigma_r": noise[1], "log_sigma_roll": noise[2],
        }  # fmt: skip
        x = np.array([start[name] for name in NAMES])
        if not is_stable(x, wide):
            x[[AT["N_r"], AT["L_r"], AT["N_p"]]] = -0.8 * wn, 0.0, 0.0
        return x, known_before(Guess(start, wn, pitch))
