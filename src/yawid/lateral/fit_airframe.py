"""The entry of the room: manoeuvres of one speed to the bare airframe, its sigma and verdict."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.airframe import Airframe, Known
from yawid.lateral.criterion import Criterion
from yawid.lateral.fit import NATS, Fit, fit, guesses
from yawid.lateral.gates import failed_gates, stopped_by
from yawid.lateral.large import fin_lost, small_motion
from yawid.lateral.mix import ROLLS_S, rudder_mixes
from yawid.lateral.model import AT, DERIVATIVES, NAMES, OF, Guess, Law, modes
from yawid.lateral.motion import Motion
from yawid.lateral.record import Record
from yawid.lateral.roll_law import dutch_roll_closed, roll_law

GIVEN_LAG_STD_S = 0.005
"""How well a servo lag is known that the user gives."""
FLOORS = {
    "wn_rad_s": (0.008, 0.0), "zeta": (0.03, 0.005), "roll_mode": (0.1, 0.0),
    "Y_beta": (0.3, 0.0), "Y_delta_r": (0.01, 0.0), "L_beta": (0.08, 0.0), "L_p": (0.07, 0.0),
    "L_r": (0.05, 0.0), "L_delta_a": (0.08, 0.0), "L_delta_r": (0.05, 0.0), "N_beta": (0.02, 0.0),
    "N_p": (0.01, 0.0), "N_r": (0.05, 0.0), "N_delta_a": (0.01, 0.0), "N_delta_r": (0.02, 0.0),
}  # fmt: skip
"""Least sigma as a share of the value, and as itself: what a linear model of an aircraft is worth,
and what a roll hold does between samples. Chosen on flights of JSBSim and of 24 drawn aircraft:
with noise alone L_p was up to 5 sigma off on the seed 701, L_beta 2.1 (RMS) on the drawn ones."""
FAST_S = 0.04
"""The sample time up to which they hold; beyond it they grow with it. At 10 Hz L_beta, L_p and
L_delta_r were else up to 5 sigma off, on the seed 701: jumps of the commands are less known."""
COUPLED = {"N_p": "L_p", "N_delta_a": "L_delta_a", "Y_delta_r": "N_delta_r"}
"""The numbers of which the least sigma of these is a share: they may be near 0."""
IN_GUSTS = 1.3
OTHERS_IN_GUSTS = {"zeta": 1.1}
"""Errors over the sigma of noise in JSBSim's turbulence of severity 2, seeds 701 and 812. The
innovations are white there, and a covariance that allows for colour is no larger: gusts also change
airspeed and angle of attack, and with them the airframe that is sought; zeta changes least."""
AGREES_SIGMAS = 1.0
"""Starts that end within this of the best one are of its minimum: false ones are 8 sigma and more
away, and steps in the likelihood, where a jump passes a sample's edge, hold some 0.6 away."""
COLOUR_S = 0.04
"""The time in s over which innovations should not be correlated: one sample at 25 Hz, for which the
limit was chosen. Over one sample of 50 Hz a smooth roll angle is (0.4 in SITL), and no harm."""
COMPARED = ("wn_rad_s", "zeta", "roll_mode")
"""The numbers in which parts of a record are compared. L_delta_a of a part in which the aileron
only follows the roll hold is wrong: 3.2 ± 1.8 for 13 in the first half of a T-6's, seed 701."""
OF_PRIOR = 0.7
"""A parameter is the prior's where its sigma is a larger part of the prior's: the record has less
than the prior's information."""
EXTRAPOLATED = 0.4
"""The part of what large motion changes in a number that is its sigma, too: the shape of what adds
to the linear motion is not known. Of 18 manoeuvres of drawn aircraft with a damper at its limits
zeta was 1.3 sigma off (RMS) with .3, and that of the linear fit 10."""
ANSWERED = (*DERIVATIVES, "alpha_rad", "servo_lag_s")
"""The numbers whose correlations are answered."""
HELD = 1.0
"""Sigma in scales by which a parameter of a part is held where the fit of the whole ended: half a
manoeuvre, in which the rudder rests, shows nothing of some."""
NUMBERS = (
    "wn_rad_s", "zeta", "roll_mode", "spiral", "Y_beta", *NAMES[1:], "wn_rad_s", "zeta",
    *["rudder_mix"] * len(ROLLS_S),
)  # fmt: skip
"""What a fit's numbers are, with Y_beta in place of its logarithm; wn and zeta come once more as
flown, and the rudder mix for each of ROLLS_S."""
_THETA = slice(4, 4 + len(NAMES))
_CLOSED, _MIXES = slice(_THETA.stop, -len(ROLLS_S)), slice(-len(ROLLS_S), None)
_Y_BETA, _Y_DELTA_R = NUMBERS.index("Y_beta"), NUMBERS.index("Y_delta_r")
NO_LAW = Law()
_STEP = 1e-4
"""Step of the modes' slopes, in scales of the parameters."""


def fit_airframe(motions: Sequence[Motion], *, servo_lag_s: float | None = None) -> Airframe:
    """Return the bare airframe that these manoeuvres of one airspeed show.

    State at the start and trims are each manoeuvre's own, all else is shared. With ``servo_lag_s``
    the lag stays near it. Whether the result may be used is in ``failed``.

    Raises:
        ValueError: there is no manoeuvre, or no start has a predictor.
    """
    records, given = [Record(motion) for motion in motions], servo_lag_s is not None
    priors = {} if servo_lag_s is None else {"servo_lag": (servo_lag_s, GIVEN_LAG_STD_S)}
    starts = guesses(records, servo_lag_s)
    fits: list[Fit] = []
    law = roll_law(records[0]) if len(records) == 1 else None
    for guess in starts:
        of = Criterion(records, guess, priors)
        with suppress(np.linalg.LinAlgError):  # there is no predictor at this start
            fits.append(fit(of, before=fits[0] if fits else None))
        if not fits:
            continue
        fits.sort(key=lambda each: each.criterion - 2.0 * NATS * each.settled)
        airframe = _airframe(fits, law)
        failed = failed_gates(airframe, records, fits[0].settled)
        alone = stopped_by(
            {"several_minima" if given else "lag_unknown": _agreeing(fits, airframe)}
        )
        if not alone or failed.keys() - {"not_settled"}:
            break
    if not fits:
        raise ValueError("the fit of the bare airframe found no predictor from any start")
    failed = failed or alone
    if not failed and (small := small_motion(fits[0])) is not fits[0]:
        airframe = _airframe([small, *fits], law)
        failed = failed_gates(airframe, records, small.settled)
        failed |= stopped_by({"not_proportional": fin_lost(small)})
        fits[:0] = [small]
    failed = failed or stopped_by({"changes": _most_apart(fits[0])})
    if not failed and servo_lag_s is not None:
        airframe = replace(airframe, given_lag_s=Known(servo_lag_s, GIVEN_LAG_STD_S),
                           free_lag_s=_free_lag(fits[0], starts[0]))  # fmt: skip
    return replace(airframe, failed=failed)


def _free_lag(found: Fit, guess: Guess) -> Known:
    """Return the servo lag that the record shows by itself, of a fit that begins where one ended.

    What is known of a lag beforehand is then what is known of any servo.
    """
    free = Criterion(found.of.records, guess, {})
    free.fixed = found.of.theta(found.x[None])[0]
    try:
        ended = fit(free)
    except np.linalg.LinAlgError:
        return Known()
    i = free.names.index("servo_lag")
    std = IN_GUSTS * math.sqrt(ended.covariance[i, i]) * free.scale[i]
    return Known(float(ended.x[i] * free.scale[i]), float(std)) if ended.settled else Known()


def _most_apart(found: Fit) -> float:
    """Return by how many sigmas a part of the record differs in COMPARED from all parts.

    A fit of a manoeuvre in which flaps moved lies between two airframes, and noise that it takes
    for gusts explains the rest, so that its sigma does not show it. So each part is fitted from
    where the whole ended, its noise too: with the whole's noise an N_r that becomes 1.5 times as
    large is 2.7 sigma away, and with its own 3.8.
    """
    try:
        parts = [fit(found.of.part(each, found.x, HELD)) for each in _parts(found.of.records)]
    except (np.linalg.LinAlgError, ValueError):  # a part without samples or without any motion
        return 0.0
    numbers, at = [_numbers(part) for part in parts], [NUMBERS.index(name) for name in COMPARED]
    Ts = found.of.records[0].sample_time_s
    rows = np.array([(values[at], _stds(values, of, Ts)[at]) for values, of in numbers])
    value, std = rows.swapaxes(0, 1)
    weights = std**-2.0
    away = value - (weights * value).sum(axis=0) / weights.sum(axis=0)
    apart = np.abs(away) / np.sqrt(std**2 - 1.0 / weights.sum(axis=0))
    return float(np.nanmax(apart, initial=0.0))


def _parts(records: Sequence[Record]) -> Sequence[Record]:
    """Return the records of several manoeuvres, and of a single one both halves.

    Each half has half of the yaw motion.
    """
    if len(records) > 1:
        return records
    of, energy = records[0].motion, np.cumsum(records[0].y[:, 1] ** 2)
    halves, middle = [], int(np.searchsorted(energy, 0.5 * energy[-1]))
    for rows in (slice(0, middle), slice(middle, None)):
        columns = {name: getattr(of, name)[rows] for name in ("p", "r", "roll", "pitch", "q")}
        start_s = of.commands_start_s - rows.start * of.sample_time_s
        halves.append(Record(replace(of, commands_start_s=start_s, **columns)))
        halves[-1].large, halves[-1].large_into = records[0].large[rows], records[0].large_into
    return halves


def floor(name: str, value: float) -> float:
    """Return the least sigma of a number, which does not fall with more manoeuvres; 0 of most.

    ``value`` is its own, or that of the number with which it is COUPLED.
    """
    share, least = FLOORS.get(name, (0.0, 0.0))
    return math.hypot(share * value, least)


def mean(value: Floats, std: Floats, name: str, others: Mapping[str, Known]) -> Known:
    """Return the weighted mean of a number (n,) of several airframes with these sigmas (n,).

    Sigma is larger where they scatter by more; what a linear model is worth stays in it whole.
    ``others`` are the means of those before.
    """
    known = np.isfinite(value) & np.isfinite(std) & (std > 0.0)
    if not known.any():
        return Known()
    value, weights = value[known], std[known] ** -2.0
    middle = float(weights @ value / weights.sum())
    scatter = float(weights @ (value - middle) ** 2) / max(len(value) - 1, 1)
    least = floor(name, others[COUPLED[name]].value if name in COUPLED else middle)
    variance = max(scatter, 1.0) / weights.sum() + least**2 * (1.0 - 1.0 / len(value))
    return Known(middle, math.sqrt(variance))


def _numbers(found: Fit, law: Law = NO_LAW) -> tuple[Floats, Floats]:
    """Return NUMBERS (m,) of a fit and their covariance (m, m) by the delta method, in gusts.

    Those of the Dutch roll as flown are the airframe's under a roll law.
    """
    theta = found.of.theta(np.vstack([found.x, found.x + _STEP * np.eye(len(found.x))]))
    airspeed_m_s = found.of.airspeed_m_s
    closed, mixes = dutch_roll_closed(theta, airspeed_m_s, law), rudder_mixes(theta, airspeed_m_s)
    numbers = np.hstack([modes(theta, airspeed_m_s), theta, closed, mixes])
    numbers[:, _Y_BETA] = -np.exp(numbers[:, _Y_BETA])
    in_gusts = np.array([OTHERS_IN_GUSTS.get(name, IN_GUSTS) for name in NUMBERS])
    slopes = in_gusts[:, None] * (numbers[1:] - numbers[0]).T / _STEP
    return numbers[0], slopes @ found.covariance @ slopes.T


def _stds(values: Floats, covariance: Floats, sample_time_s: float) -> Floats:
    """Return sigma (m,) of NUMBERS, with what a linear model is worth."""
    of = [NUMBERS.index(COUPLED[x]) if x in COUPLED else i for i, x in enumerate(NUMBERS)]
    slower = max(sample_time_s / FAST_S, 1.0)
    least = [slower * floor(*each) for each in zip(NUMBERS, values[of].tolist(), strict=True)]
    return np.asarray(np.sqrt(np.diag(covariance) + np.square(least)), np.float64)


def _airframe(fits: Sequence[Fit], law: Law | None) -> Airframe:
    """Return the airframe of the first fit; sigma has the ends of the others that are as likely.

    What large motion changed, from the first fit without it, counts in sigma as well.

    Of p, r and roll alone, a side force of the rudder, one of sideslip and damping in yaw may trade
    places. What the rudder's side force is away from 0, which is known of it, therefore counts in
    sigma: without that N_r of an A320 and of a T-6 was up to 10 sigma wrong, where wn and zeta were
    right. The rudder mix has the scatter between rolls of different lengths.
    """
    best, records = fits[0], fits[0].of.records
    values, covariance = _numbers(best, law or NO_LAW)
    side = -covariance[:, _Y_DELTA_R] / covariance[_Y_DELTA_R, _Y_DELTA_R] * values[_Y_DELTA_R]
    side[_Y_BETA] = values[_Y_BETA] * np.expm1(side[_Y_BETA] / values[_Y_BETA])  # of a logarithm
    near = [0.0 * values, *(
        _numbers(each, law or NO_LAW)[0] - values
        for each in fits[1:] if each.criterion - best.criterion < 2.0 * NATS
    )]  # fmt: skip
    covariance = covariance + np.transpose(near) @ near / len(near)
    linear = next(each for each in fits if not len(each.of.records[0].large_into))
    if linear is not best:
        beyond = EXTRAPOLATED * (_numbers(linear, law or NO_LAW)[0] - values)
        covariance += np.outer(beyond, beyond)
    covariance[_THETA, _THETA] += np.outer(side[_THETA], side[_THETA])
    known = list(
        map(Known, values.tolist(), _stds(values, covariance, records[0].sample_time_s).tolist())
    )
    by_name = dict(zip(NAMES, known[_THETA], strict=True))
    by_name["Y_beta"] = by_name["log_Y_beta"]
    by_name |= dict.fromkeys({"L_delta_a", "N_delta_a"} - set(best.of.names), Known())
    variance = covariance[_MIXES, _MIXES].mean() + np.var(values[_MIXES], ddof=1)
    mix = Known(float(values[_MIXES].mean()), math.sqrt(max(float(variance), 0.0)))
    return Airframe(
        wn_rad_s=known[0], zeta=known[1],
        roll_s=_time_constant(known[2]), spiral_s=_time_constant(known[3]),
        derivatives={name: by_name[name] for name in DERIVATIVES},
        alpha_rad=by_name["alpha"], correlations=_correlations(covariance[_THETA, _THETA]),
        from_prior=tuple(_from_prior(best)), servo_lag_s=by_name["servo_lag"],
        delay_s=by_name["delay"],
        rudder_mix=mix if math.isfinite(by_name["N_delta_a"].value) else Known(),
        gust_std_rad=math.exp(by_name["log_gust"].value) * best.noise_scale,
        rho1=autocorrelation([part.e for part in best.at.parts], records),
        airspeed_m_s=best.of.airspeed_m_s,
        as_flown=None if law is None else (known[_CLOSED][0], known[_CLOSED][1]),
    )  # fmt: skip


def _correlations(covariance: Floats) -> Floats:
    """Return those of the parameters in ANSWERED (14, 14); 0 of one that was not estimated."""
    at = [AT[OF.get(name, name)] for name in ANSWERED]
    some = covariance[np.ix_(at, at)]
    std = np.sqrt(np.maximum(np.diag(some), np.finfo(float).tiny))
    found = np.asarray(some / np.outer(std, std), np.float64)
    np.fill_diagonal(found, 1.0)
    return found


def _from_prior(found: Fit) -> Iterator[str]:
    """Yield the names of ANSWERED of which the record says little: sigma is nearly the prior's."""
    of = found.of
    share = np.sqrt(np.diag(found.covariance)) * of.scale / of.spread
    known = dict(zip(of.names, share.tolist(), strict=True))
    yield from (name for name in ANSWERED if known.get(OF.get(name, name), 0.0) > OF_PRIOR)


def _time_constant(pole: Known) -> Known:
    """Return the time constant in s of a real pole in 1/s."""
    if not math.isfinite(pole.value) or pole.value == 0.0:
        return Known()
    return Known(-1.0 / pole.value, pole.std / pole.value**2)


def autocorrelation(errors: Sequence[Floats], records: Sequence[Record]) -> float:
    """Return the largest of the innovations of p, r and roll after COLOUR_S, in any scale."""
    products, power = np.zeros(3), np.zeros(3)
    later = max(1, round(COLOUR_S / records[0].sample_time_s))
    for each, error in zip(records, errors, strict=True):
        e, both = error[: each.y.size].reshape(-1, 3), ~(each.unused[later:] | each.unused[:-later])
        products += (e[later:] * e[:-later])[both].sum(axis=0)
        power += (e**2).sum(axis=0)
    rho = products / np.maximum(power, np.finfo(float).tiny)
    return float(rho[np.argmax(np.abs(rho))])


def _agreeing(fits: Sequence[Fit], airframe: Airframe) -> int:
    """Return how many starts end where the best one does, itself among them.

    Their wn, zeta and roll mode are within AGREES_SIGMAS.
    """
    wn, zeta, roll = airframe.wn_rad_s, airframe.zeta, airframe.roll_s
    theta = np.vstack([each.of.theta(each.x[None]) for each in fits])
    found = modes(theta, airframe.airspeed_m_s)[:, :3]
    apart = np.abs(found - found[0]) / np.array([wn.std, zeta.std, roll.std / roll.value**2])
    return int((~(apart > AGREES_SIGMAS)).all(axis=1).sum())
