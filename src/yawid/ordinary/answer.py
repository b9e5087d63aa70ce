"""The answer of an ordinary flight: the fit, its sigma, and the gates that it must pass.

    sigma^2 = (1.3 sigma_Whittle)^2 + floor^2 + (half of what a narrower band changes)^2
              + (what a roll gain changes that is larger by the root of 1 - R^2 of the law)^2

with floors of 2.5 % of wn, and of .015 and 8 % of zeta. What an autopilot's integrator or lag adds
to the law is taken for a turn, and in gusts it is not one: with it zeta was .29 for .12.
Whittle's sigma is of noise alone: in calm air the error was up to four times as large, for the
model is not the aircraft. What a line does to it shows in one place of the whitened spectra e
of what is left of p, and of r without what p says:

    lines = largest over bins near the mode of  (m / M - 1) sqrt(n)

m is the mean of e over three bins of n frequencies, M the median of m over thirty bins on each
side: a model that fits badly does so over wide bands, an oscillation that is not the aircraft's in
one.
"""

import dataclasses
import math

import numpy as np
from msgspec.structs import replace

from yawid.answers.ordinary import OrdinaryAnswer, OrdinarySpectrum, RollLaw
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, TimeConstant, Value
from yawid.blocks import Bools, Floats
from yawid.lateral.model import NAMES as LATERAL
from yawid.lateral.model import Law, airframe, modes
from yawid.lateral.roll_law import dutch_roll_closed
from yawid.ordinary.fit import DIFFERENCE, Fitted, fit
from yawid.ordinary.law import law_of
from yawid.ordinary.model import AT, FREE
from yawid.ordinary.pieces import Ordinary
from yawid.ordinary.search import LEAST_LAW, Search
from yawid.ordinary.spectra import USABLE, P, R

IN_GUSTS, OF_BAND = 1.3, 0.5
FLOORS = 0.025, 0.015, 0.08
"""Of wn, as a part of it, and of zeta, as itself and as a part of it."""
FLOORS_FLOWN = 0.04, 0.045
"""The same as flown, where the law counts: one with a lag of .06 s was found 20 % low."""
NARROW, NEAR = (0.45, 2.2), (0.6, 1.6)
"""The narrower band, and what is near the mode, both in wn."""
LONG_S = 290.0
"""Less has a wn that is off by up to 9 %."""
SHARE = 0.015
"""Where turns make less of p's power, the largest errors of wn are 9 % and 3.3 sigma, and with a
wrong scale of the aileron 29 %; of 9 small flights from .015 to .05 none is beyond 2 sigma."""
KNOWN_WN, KNOWN_ZETA = 0.05, 0.06
"""The largest sigmas: beyond them an answer is of no use."""
MOST_DAMPED, LEAST_FLOWN = 0.45, 0.08
"""Beyond the first there is no peak: the A320's wn (zeta .52) was off by up to 33 %. Below the
second, as flown, a roll hold with backlash passed for the mode: 2 of 4 such flights."""
ABOVE_NOISE = 4.0
"""The least power of r near the mode over the gyro's: less had a zeta that was .15 high. Of six
flights in calm air with 4.3 to 5.5 none is beyond 1 sigma."""
SAME_NATS, APART = 6.0, 0.05
"""Another fit as good as this, and the difference of wn that matters."""
LINE, ABOUT, SEARCHED = 7.0, 30, (0.5, 2.4)
"""The most of a line, the bins on each side for its median, a factor of 2.1 in w, and where it is
sought, in wn. Without it a line of half of r's power near the mode moved wn by up to 25 % and zeta
by -.29. With 10 bins a line's own width raised the median: 3 of 60 logs with a line (seed 7200)
were wrong by 3.5 to 6.4 sigma. Of those 60, 48 have more than 7 and 27 would be wrong; of the other
12 one would be, which is refused as feedback alone. Of 64 flights without a line (seed 3200) a calm
OV-10 has 9.1, whose p fits badly at the mode itself, and the next one 5.9."""
NAMED = ("L_p", "L_delta_a", "L_beta", "N_beta")
_TURN = "Fly twelve minutes at one airspeed, with turns of 20 degrees of bank or more."
_DOUBLETS = "Fly rudder doublets."


def answer_of(
    flight: Ordinary, near: tuple[float, ...] = (), *, recent: bool = False
) -> OrdinaryAnswer:
    """Return what a flight answers, or its ``recent`` part; ``near`` has starts of wn in rad/s.

    It is refused where its fit fails: whatever happens here, the manoeuvres' answer must stay.
    """
    try:
        with np.errstate(all="ignore"):  # a step too far is not taken
            return _answer_of(flight, near, recent=recent)
    except Exception as error:
        text = f"the fit failed: {error}"
        return OrdinaryAnswer(verdict=_verdict((True, "fit_failed", text, "")))


def _answer_of(flight: Ordinary, near: tuple[float, ...], *, recent: bool) -> OrdinaryAnswer:
    """Return the same; gates that are facts come before any fit."""
    sums, lost = flight.sums(recent=recent), dict(flight.lost_s)
    law, explained = own = law_of(sums.law)
    cause = max(lost, key=lambda name: lost[name], default="")
    is_rudder = "rudder" in cause and 2.0 * lost[cause] > flight.seen_s
    why = f"; {lost[cause]:.0f} s are {cause}" if cause and lost[cause] > 0.0 else ""
    facts = OrdinaryAnswer(
        airspeed_m_s=sums.speed / sums.seconds if sums.seconds else None, seconds=sums.seconds,
        seen_s=flight.seen_s, turns=sums.turns, windows=sums.windows,
        verdict=_verdict(
            (
                sums.seconds < LONG_S, "rudder_moves" if is_rudder else "too_short",
                f"{LONG_S:.0f} s of ordinary flight at one airspeed are needed, "
                f"{sums.seconds:.0f} s of {flight.seen_s:.0f} s are there{why}", _TURN,
            ),
            (
                sums.seconds >= LONG_S and not sums.turns, "only_feedback",
                "no turn was flown: the aileron only answers", _TURN,
            ),
            (
                explained >= LEAST_LAW and law.roll_gain < 0.0, "aileron_reversed",
                "the aileron follows the roll, and rolls it further: no roll hold does that, so "
                "its sign is wrong", "Check the channel of the aileron (--aileron).",
            ),
        ),
    )  # fmt: skip
    if not facts:
        return facts
    search = Search(sums, own)
    fits = search.fits(near)
    if fits:
        return _of_fits(facts, search, fits)
    return replace(facts, verdict=_verdict((True, "no_mode", "no fit shows an oscillation", _TURN)))


def _of_fits(facts: OrdinaryAnswer, search: Search, fits: list[Fitted]) -> OrdinaryAnswer:
    """Return the answer of fits, the best of them first."""
    best, law = fits[0], search.law
    mode, std, total, off = _with_sigma(search, best)
    gates = _gates(search, fits, mode, std[0], off[0])
    no_law = (
        search.explained < LEAST_LAW, "no_roll_law",
        f"roll and p explain {search.explained:.2f} of the aileron, {LEAST_LAW:g} are needed",
        "Use the answer without the autopilot.",
    )  # fmt: skip
    rows = [np.column_stack([mode, total])[i : i + 2].ravel().tolist() for i in (0, 2)]
    A, _ = airframe(best.x[None, : len(LATERAL)], best.band.airspeed_m_s)
    roll_s = -1.0 / float(mode[4])
    return replace(
        facts,
        dutch_roll=DutchRoll.of(rows[0], std[:2].tolist()),
        flown=DutchRoll.of(rows[1], std[2:4].tolist()),
        verdict=_verdict(*gates, _uncertain(mode, total, 0)),
        flown_verdict=_verdict(*gates[1:], _uncertain(mode, total, 2), no_law),
        poles=[
            [float(x.real), float(x.imag)] for x in sorted(np.linalg.eigvals(A[0, :4, :4]), key=abs)
        ],
        roll_mode=TimeConstant(roll_s, float(total[4]) * roll_s**2) if roll_s > 0.0 else None,
        derivatives={
            name: Value(float(mode[5 + i]), float(total[5 + i])) for i, name in enumerate(NAMED)
        },
        law=RollLaw(
            k_roll=law.roll_gain,
            k_p=law.rate_gain,
            k_integral=law.integral_gain,
            r2=search.explained,
        ),
        share=share_of_turns(best),
        band_rad_s=[float(best.band.w[0]), float(best.band.w[-1])],
        spectrum=spectrum_of(best),
    )


def _gates(
    search: Search, fits: list[Fitted], mode: Floats, std: float, off: float
) -> tuple[tuple[bool, str, str, str], ...]:
    """Return the gates of fits but that of sigma; ``std`` of wn is noise, ``off`` a band's."""
    best, wn, share = fits[0], fits[0].wn, share_of_turns(fits[0])
    near, nyquist_hz = _near(best, NEAR), search.limit / USABLE / math.pi
    line = largest_line(best)
    above = float(np.median(best.band.Z[near, R, R].real / best.band.n[near]))
    above /= math.exp(2.0 * best.x[AT["log_sigma_r"]])
    others = [x.wn for x in fits[1:] if x.loss - best.loss < SAME_NATS]
    other = max(others, key=lambda x: abs(x - wn), default=wn)
    needed_hz = NARROW[1] * wn / USABLE / math.pi
    return (
        (share < SHARE, "only_feedback", f"turns make {share:.1%} of the roll rate near the mode, "
         f"{SHARE:.0%} are needed", _TURN),
        (needed_hz > nyquist_hz, "rate_too_low", f"the attitude comes at {nyquist_hz:.2g} Hz, for "
         f"a mode of {wn:.2g} rad/s {needed_hz:.2g} Hz are needed", "Record ATTITUDE faster."),
        (not 0.0 < mode[1] <= MOST_DAMPED, "too_damped", f"zeta is {mode[1]:.2f}: outside 0 to "
         f"{MOST_DAMPED:g} neither gusts nor turns show the mode", _DOUBLETS),
        (line > LINE, "line", f"an oscillation near the mode stands out by "
         f"{line:.1f} sigma, {LINE:g} are the most: a vibration, or a limit cycle of the roll "
         "hold", _DOUBLETS),
        (not mode[3] >= LEAST_FLOWN, "limit_cycle", "as flown zeta is "
         f"{mode[3]:.2f}, {LEAST_FLOWN:g} is needed: the roll hold may oscillate by itself",
         _DOUBLETS),
        (above < ABOVE_NOISE, "too_quiet", f"the yaw rate has {above:.1f} times the gyro's noise, "
         f"{ABOVE_NOISE:g} are needed", _TURN),
        (abs(other / wn - 1.0) > APART, "two_answers", f"wn may as well be {other:.2f} as {wn:.2f} "
         "rad/s", _TURN),
        (not off <= max(0.06 * wn, 2.5 * IN_GUSTS * std), "band_differs",
         f"a narrower band changes wn by {off / wn:.1%}", _TURN),
    )  # fmt: skip


def _with_sigma(search: Search, best: Fitted) -> tuple[Floats, Floats, Floats, Floats]:
    """Return a fit's values (9,), Whittle's sigmas, all of sigma, and what a narrow band changes.

    They are NaN where a fit shows no mode.
    """
    mode, std = values_of(best, search.law)
    narrow = search.again(best, best.wn, NARROW)
    softer = math.sqrt(1.0 - search.explained)
    stiffer = dataclasses.replace(
        search.found_law, roll_gain=(1.0 + softer) * search.found_law.roll_gain
    )
    under = fit(best.x, dataclasses.replace(best.band, law=stiffer))
    off, moved = (np.abs(values_of(x, search.law)[0] - mode) for x in (narrow, under))
    floors = np.zeros(9)
    floors[:4] = (
        FLOORS[0] * mode[0], math.hypot(FLOORS[1], FLOORS[2] * mode[1]),
        FLOORS_FLOWN[0] * mode[2], FLOORS_FLOWN[1],
    )  # fmt: skip
    parts = IN_GUSTS * std, floors, moved, OF_BAND * off
    return mode, std, np.linalg.norm(parts, axis=0), off


def values_of(found: Fitted, law: Law) -> tuple[Floats, Floats]:
    """Return wn, zeta, both as flown, the roll mode's pole and NAMED, and Whittle's sigmas (9,)."""
    change = DIFFERENCE * np.eye(len(found.x))[FREE]
    theta = np.vstack([found.x, found.x + change, found.x - change])[:, : len(LATERAL)]
    speed = found.band.airspeed_m_s
    bare, closed = modes(theta, speed), dutch_roll_closed(theta, speed, law)
    values = np.column_stack([bare[:, :2], closed, bare[:, 2], theta[:, [AT[x] for x in NAMED]]])
    J = (values[1 : len(FREE) + 1] - values[len(FREE) + 1 :]).T / (2.0 * DIFFERENCE)
    return values[0], np.sqrt(np.einsum("ij,jk,ik->i", J, found.covariance, J))


def share_of_turns(found: Fitted) -> float:
    """Return the part of p's power near the mode that the aileron's own part makes."""
    band, asked, near = found.band, found.band.inputs()[:, 0], _near(found, NEAR)
    made = np.abs(band.predict(found.x[None])[0][0, :, P, 0]) ** 2
    made *= np.einsum("bi,bij,bj->b", asked, band.Z, asked.conj()).real
    return float(made[near].sum() / band.Z[near, P, P].real.sum())


def largest_line(found: Fitted) -> float:
    """Return the largest line in p and r near the mode, in sigmas."""
    from scipy.ndimage import median_filter, uniform_filter1d  # takes 0.1 s: only a fit pays for it

    band, (G, S) = found.band, (y[0] for y in found.band.predict(found.x[None]))
    whiten = np.linalg.inv(np.linalg.cholesky(S))
    white = (whiten @ band.left_over(G)[1] @ whiten.conj().swapaxes(-1, -2)).real
    count = uniform_filter1d(band.n, 3, mode="mirror")
    mean = uniform_filter1d(np.einsum("bii->ib", white)[: R + 1], 3, mode="mirror") / count
    median = median_filter(mean, (1, 2 * ABOUT + 1), mode="mirror")
    lines = (mean / median - 1.0) * np.sqrt(3.0 * count)
    return float(lines[:, _near(found, SEARCHED)].max(initial=0.0))


def spectrum_of(found: Fitted) -> OrdinarySpectrum:
    """Return the spectra measured, and those of the fit with the inputs as they were."""
    band, (G, S) = found.band, (y[0] for y in found.band.predict(found.x[None]))
    by = G @ band.inputs()
    driven = by @ band.Z @ by.conj().swapaxes(-1, -2)
    both = band.Z, driven + band.n[:, None, None] * S
    measured, modelled = (
        {name: (x[:, i, i].real / band.n).tolist() for i, name in enumerate(("p", "r", "roll"))}
        for x in both
    )
    return OrdinarySpectrum(
        w_rad_s=band.w.tolist(), count=band.n.tolist(), measured=measured, modelled=modelled
    )


def _near(found: Fitted, part: tuple[float, float]) -> Bools:
    w = found.band.w / found.wn
    return np.asarray((w > part[0]) & (w < part[1]))


def _uncertain(mode: Floats, total: Floats, i: int) -> tuple[bool, str, str, str]:
    """Return the gate of the sigmas of wn, the value ``i``, and zeta after it."""
    part, of_zeta = float(total[i] / mode[i]), float(total[i + 1])
    text = (
        f"sigma is {part:.1%} of wn and {of_zeta:.3f} of zeta, "
        f"{KNOWN_WN:.0%} and {KNOWN_ZETA:g} are the most"
    )
    return not (part < KNOWN_WN and of_zeta < KNOWN_ZETA), "uncertain", text, _TURN


def _verdict(*gates: tuple[bool, str, str, str]) -> Verdict:
    """Return the verdict of gates: whether each stops the answer, its name, text and remedy.

    The reasons keep their order: the first one is the cause.
    """
    reasons = [Reason(name, text, remedy, "fatal") for stops, name, text, remedy in gates if stops]
    return Verdict(usable=not reasons, reasons=reasons)
