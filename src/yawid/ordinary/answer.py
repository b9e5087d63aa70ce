"""The answer of an ordinary flight: the fit, its sigma, and the gates that it must pass.

    sigma^2 = (1.3 sigma_Whittle)^2 + floor^2 + (half of what a narrower band changes)^2

with floors of 2.5 % of wn, and of .015 and 8 % of zeta. Whittle's sigma is of noise alone: in calm
air the error was up to four times as large, for the model is not the aircraft.
"""

import math
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from yawid.answers.ordinary import OrdinaryAnswer, OrdinarySpectrum, RollLaw
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, TimeConstant, Value
from yawid.blocks import Floats
from yawid.lateral.model import AT, Law, airframe, modes
from yawid.lateral.roll_law import dutch_roll_closed
from yawid.ordinary.fit import Fitted
from yawid.ordinary.model import FREE_AT, OUTPUTS, full
from yawid.ordinary.pieces import Ordinary
from yawid.ordinary.search import Search, wn_of
from yawid.ordinary.spectra import P, R

IN_GUSTS, OF_BAND = 1.3, 0.5
FLOOR_WN, FLOOR_ZETA, SHARE_ZETA = 0.025, 0.015, 0.08
BY_GUSTS_WN, BY_GUSTS_ZETA = 0.04, 0.045
"""The floors as flown where hardly anything but gusts moves it: there zeta's RMS was .048."""
NARROW, NEAR = (0.45, 2.2), (0.6, 1.6)
LAW_KNOWN = 0.03, 0.05
"""The sigmas of the law's gains as parts of them."""
LONG_S = 290.0
"""Less has a wn off by up to 6 % with halves that agree."""
SHARE = 0.05
"""Less is no turns: wn was off by up to 30 % with a sigma of 2 to 9 %."""
KNOWN_WN, KNOWN_ZETA = 0.05, 0.06
MOST_DAMPED = 0.45
"""Beyond it there is no peak: the A320's wn (zeta .52) was off by up to 33 %."""
LEAST_DAMPED = 0.08
"""As flown: below it a limit cycle of the roll hold passes for the mode."""
ABOVE_NOISE = 5.0
"""The least power of r near the mode over the gyro's noise."""
SAME_NATS, APART = 6.0, 0.05
LEAST_LAW = 0.85
_DIFFERENCE = 1e-5
NAMED = ("L_p", "L_delta_a", "L_beta", "N_beta")


def answer_of(flight: Ordinary) -> OrdinaryAnswer:
    """Return what a flight answers. Gates that are facts come before any fit."""
    first, second = flight.halves()
    both = [*first, *second]
    facts = OrdinaryAnswer(seen_s=flight.seen_s, verdict=_verdict([]))
    sums = sum(both[1:], both[0]) if both else None
    if sums is not None:
        facts = replace(
            facts, seconds=sums.seconds, turns=sums.turns, windows=sums.windows,
            airspeed_m_s=sums.speed / sums.seconds,
        )  # fmt: skip
    reasons = list(facts_against(flight, facts))
    if reasons or sums is None or not sums.step_s:
        return replace(facts, verdict=_verdict(reasons))
    search = Search(sums)
    fits = search.fits()
    if not fits:
        return replace(facts, verdict=_verdict([_NO_MODE]))
    best, wn = fits[0], wn_of(fits[0])
    narrow = search.again(best, wn, parts=NARROW)
    halves = [search.again(best, wn, sum(x[1:], x[0])) if x else None for x in (first, second)]
    modes_of = [_modes(x, search.law) for x in (best, narrow, *halves)]
    (mode, std), others = modes_of[0], modes_of[1:]
    share, over_noise = share_of_turns(best), power_over_noise(best)
    facts = replace(facts, share=share, **_shown(best, search, mode, std))
    reasons = list(_against(best, fits, search.limit, over_noise))
    parts = []
    for i in (0, 2):
        floors = (BY_GUSTS_WN, BY_GUSTS_ZETA) if i and share < SHARE else (FLOOR_WN, FLOOR_ZETA)
        part = slice(i, i + 2)
        off = np.abs(others[0][0] - mode)[part]
        floor = np.array([floors[0] * mode[i], math.hypot(floors[1], SHARE_ZETA * mode[i + 1])])
        total = np.sqrt((IN_GUSTS * std[part]) ** 2 + floor**2 + (OF_BAND * off) ** 2)
        of_halves = [x[part] for each in others[1:] for x in each]
        doubts = _doubts(mode[part], total, std[part], off, of_halves)
        parts.append((mode[part], total, [*reasons, *doubts]))
    (bare, std_bare, against), (flown, std_flown, against_flown) = parts
    if share < SHARE:
        against.insert(0, _only_feedback(share))
    if search.explained < LEAST_LAW:
        against_flown.append(_no_law(search.explained))
    row, row_flown = (
        np.column_stack(x).ravel().tolist() for x in ((bare, std_bare), (flown, std_flown))
    )
    return replace(
        facts, dutch_roll=DutchRoll.of(row, std[:2].tolist()),
        flown=DutchRoll.of(row_flown, std[2:4].tolist()),
        verdict=_verdict(against), flown_verdict=_verdict(against_flown),
    )  # fmt: skip


def facts_against(flight: Ordinary, facts: OrdinaryAnswer) -> Iterator[Reason]:
    """Yield what speaks against an answer before any fit: length, turns, rate, and their causes."""
    lost = sorted(flight.lost_s.items(), key=lambda each: -each[1])
    if facts.seconds < LONG_S:
        cause, seconds = lost[0] if lost else ("", 0.0)
        why = f"; {seconds:.0f} s are {cause}" if seconds > 0.0 else ""
        yield _fatal(
            "rudder_moves" if "rudder" in cause and seconds > facts.seen_s / 2.0 else "too_short",
            f"{LONG_S:.0f} s of ordinary flight at one airspeed are needed, {facts.seconds:.0f} s "
            f"of {facts.seen_s:.0f} s are there{why}",
            "Fly twelve minutes with turns at one airspeed, without a yaw damper.",
        )
    elif not facts.turns:
        yield _fatal(
            "only_feedback", "no turn was flown: the aileron only answered the gusts", _TURN
        )


def share_of_turns(found: Fitted) -> float:
    """Return the part of p's power near the mode that the aileron's own part makes."""
    band, model = found.band, found.model
    near = _near(found)
    asked = model.inputs()[0]
    power = (asked @ band.Z @ asked).real[near]
    made = np.abs(model.predict(found.x, slopes=False).G[near, P, 0]) ** 2 * power
    return float(made.sum() / band.Z[near, P, P].real.sum())


def power_over_noise(found: Fitted) -> float:
    """Return r's power near the mode over that of the gyro's noise."""
    near = _near(found)
    power = found.band.Z[near, R, R].real / found.band.n[near]
    return float(np.median(power) / math.exp(2.0 * found.x[FREE_AT["log_sigma_r"]]))


def spectrum_of(found: Fitted) -> OrdinarySpectrum:
    """Return the spectra measured, and those of the fit with the inputs as they were."""
    band, at, U = found.band, found.model.predict(found.x, slopes=False), found.model.inputs()
    inputs = U @ band.Z @ U.conj().T
    modelled = at.G @ inputs @ at.G.conj().swapaxes(-1, -2) / band.n[:, None, None] + at.S
    measured = OUTPUTS @ band.Z @ OUTPUTS.T / band.n[:, None, None]
    names = ("p", "r", "roll")
    return OrdinarySpectrum(
        w_rad_s=band.w.tolist(), count=band.n.tolist(),
        measured={name: measured[:, i, i].real.tolist() for i, name in enumerate(names)},
        modelled={name: modelled[:, i, i].real.tolist() for i, name in enumerate(names)},
    )  # fmt: skip


def _near(found: Fitted) -> np.ndarray:
    w = found.band.w / wn_of(found)
    return np.asarray((w > NEAR[0]) & (w < NEAR[1]))


def _modes(found: Fitted | None, law: Law) -> tuple[Floats, Floats]:
    """Return wn, zeta, both as flown, the roll mode's pole and NAMED, and Whittle's sigmas (9,)."""
    if found is None:
        return np.full(9, math.nan), np.full(9, math.nan)
    x, n = found.x, len(found.x)
    change = _DIFFERENCE * np.maximum(np.abs(x), 0.1)
    every = np.vstack([x, x + np.diag(change), x - np.diag(change)])
    gains = np.array([law.roll_gain, law.rate_gain])
    speed = found.model.airspeed_m_s

    def of(every: Floats, law: Law) -> Floats:
        theta = full(every)
        bare = modes(theta, speed)
        closed = dutch_roll_closed(theta, speed, law)
        named = theta[:, [AT[name] for name in NAMED]]
        return np.column_stack([bare[:, :2], closed, bare[:, 2], named])

    values = of(every, law)
    J = (values[1 : n + 1] - values[n + 1 :]).T / (2.0 * change)
    variance = np.einsum("ij,jk,ik->i", J, found.covariance, J)
    for i, part in enumerate(LAW_KNOWN):
        step = 1e-4 * max(abs(gains[i]), 1e-3)
        other = Law(*(gains + step * np.eye(2)[i]))
        slope = (of(x[None], other)[0] - values[0]) / step
        variance += (slope * part * gains[i]) ** 2
    return values[0], np.sqrt(variance)


def _shown(best: Fitted, search: Search, mode: Floats, std: Floats) -> dict[str, object]:
    """Return the rest of what the answer shows of the best fit."""
    poles = np.linalg.eigvals(airframe(full(best.x[None]), search.airspeed_m_s)[0][0, :4, :4])
    law = RollLaw(k_roll=search.law.roll_gain, k_p=search.law.rate_gain, r2=search.explained)
    found: dict[str, object] = {
        "poles": [[float(x.real), float(x.imag)] for x in sorted(poles, key=abs)],
        "derivatives": {
            name: Value(float(mode[5 + i]), float(IN_GUSTS * std[5 + i]))
            for i, name in enumerate(NAMED)
        },
        "law": law, "spectrum": spectrum_of(best),
        "band_rad_s": [float(best.band.w[0]), float(best.band.w[-1])],
    }  # fmt: skip
    if mode[4] < 0.0:
        found["roll_mode"] = TimeConstant(
            -1.0 / float(mode[4]), float(IN_GUSTS * std[4] / mode[4] ** 2)
        )
    return found


def _against(best: Fitted, fits: list[Fitted], limit: float, over_noise: float) -> Iterator[Reason]:
    """Yield what speaks against bare and flown alike."""
    (wn, zeta, _, flown, *_), _ = _modes(best, best.model.law)
    if NARROW[1] * wn > limit:
        yield _fatal(
            "rate_too_low",
            f"the attitude comes at {limit / 0.8 / math.pi:.2g} Hz, for a mode of {wn:.2g} rad/s "
            f"{NARROW[1] * wn / 0.8 / math.pi:.2g} Hz are needed",
            "Record ATTITUDE at a higher rate.",
        )
    if zeta > MOST_DAMPED:
        yield _fatal(
            "too_damped",
            f"zeta is {zeta:.2f}: beyond {MOST_DAMPED:g} gusts and turns show no mode",
            "Fly rudder doublets.",
        )
    if flown < LEAST_DAMPED:
        yield _fatal(
            "limit_cycle", f"as flown zeta is {flown:.2f}: the roll hold may oscillate by itself",
            "Lower the gains of the roll hold, or fly rudder doublets.",
        )  # fmt: skip
    if over_noise < ABOVE_NOISE:
        yield _fatal(
            "too_quiet",
            f"the yaw rate is {over_noise:.1f} times the gyro's noise, {ABOVE_NOISE:g} are needed",
            "Fly more turns, or in more wind.",
        )
    for each in fits[1:]:
        if each.loss - best.loss < SAME_NATS and abs(wn_of(each) / wn - 1.0) > APART:
            yield _fatal(
                "two_answers", f"wn may as well be {wn_of(each):.2f} as {wn:.2f} rad/s",
                "Fly longer, with more turns.",
            )  # fmt: skip


def _doubts(
    value: Floats, total: Floats, std: Floats, off: Floats, halves: list[Floats]
) -> Iterator[Reason]:
    """Yield what speaks against wn and zeta (2,): their sigma, the band, and the halves.

    ``halves`` are the values and sigmas of the first, then those of the second.
    """
    if not (total[0] < KNOWN_WN * value[0] and total[1] < KNOWN_ZETA):
        yield _fatal(
            "uncertain", f"sigma is {total[0] / value[0]:.1%} of wn and {total[1]:.3f} of zeta: "
            f"{KNOWN_WN:.0%} and {KNOWN_ZETA:g} are the most", "Fly longer, with more turns.",
        )  # fmt: skip
    if not off[0] <= max(0.06 * value[0], 2.5 * IN_GUSTS * std[0]):
        yield _fatal(
            "band_differs", f"a narrower band changes wn by {off[0] / value[0]:.1%}", _TURN
        )
    first, of_first, second, of_second = halves
    apart = np.abs(first - second)
    noise = IN_GUSTS * np.hypot(of_first, of_second)
    most = 3.0 * np.hypot(noise, [FLOOR_WN * value[0], 0.02])
    if not (apart < np.minimum(most, [0.12 * value[0], math.inf])).all():
        yield _fatal(
            "halves_differ", f"the halves of the flight differ by {apart[0] / value[0]:.1%} of wn "
            f"and {apart[1]:.3f} of zeta", "Fly at one airspeed, mass and configuration.",
        )  # fmt: skip


def _verdict(reasons: list[Reason]) -> Verdict:
    """Return the verdict with the reasons in their order: the first one is the cause."""
    return Verdict(usable=not reasons, reasons=reasons)


def _fatal(name: str, text: str, remedy: str) -> Reason:
    return Reason(name, text, remedy, "fatal")


def _only_feedback(share: float) -> Reason:
    return _fatal(
        "only_feedback",
        f"turns make {share:.1%} of the roll rate near the mode, {SHARE:.0%} are needed",
        _TURN,
    )


def _no_law(explained: float) -> Reason:
    return _fatal(
        "no_roll_law",
        f"roll and p explain {explained:.2f} of the aileron, {LEAST_LAW:g} are needed",
        "Use the answer without the autopilot.",
    )


_TURN = "Fly twelve minutes with turns of 20 degrees of bank or more."
_NO_MODE = _fatal("no_mode", "no fit shows an oscillation", _TURN)
