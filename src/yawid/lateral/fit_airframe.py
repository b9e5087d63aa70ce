"""The entry of the room: manoeuvres of one speed to the bare airframe, its sigma and verdict."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.airframe import Airframe, AsFlown, FailedGate, Known
from yawid.lateral.criterion import Criterion
from yawid.lateral.fit import Fit, fit, guesses
from yawid.lateral.gates import failed_gates
from yawid.lateral.mix import rudder_mixes
from yawid.lateral.model import AT, DERIVATIVES, NAMES, RUDDER, Guess, modes
from yawid.lateral.motion import Motion
from yawid.lateral.record import Record
from yawid.lateral.roll_law import dutch_roll_closed, roll_law, yaw_rate_closed

GIVEN_LAG_STD_S = 0.005
"""How well a servo lag is known that the user gives."""
FLOORS = {
    "wn_rad_s": (0.008, 0.0), "zeta": (0.03, 0.005), "roll_mode": (0.1, 0.0),
    "L_delta_a": (0.05, 0.0),
}  # fmt: skip
"""Least sigma as a share of the value, and as itself: what a linear model of an aircraft is worth,
measured on flights of JSBSim."""
IN_GUSTS = 1.3
OTHERS_IN_GUSTS = {"zeta": 1.1}
"""Errors over the sigma of noise in JSBSim's turbulence of severity 2, seeds 701 and 812. The
innovations are white there, and a covariance that allows for colour is no larger: gusts also change
airspeed and angle of attack, and with them the airframe that is sought; zeta changes least."""
NATS = 3.0
"""Starts whose log-likelihood is this near to the best one's count as answers, too, and one that
settled goes before one that did not."""
AGREES_SIGMAS = 1.0
"""Starts that end within this of the best one are of its minimum: false ones are 8 sigma and more
away, and steps in the likelihood, where a jump passes a sample's edge, hold some 0.6 away."""
COLOUR_S = 0.04
"""The time in s over which innovations should not be correlated: one sample at 25 Hz, for which the
limit was chosen. Over one sample of 50 Hz a smooth roll angle is (0.4 in SITL), and no harm."""
COMPARED = ("wn_rad_s", "zeta", "roll_mode")
"""The numbers in which parts of a record are compared. L_delta_a of a part in which the aileron
only follows the roll hold is wrong: 3.2 ± 1.8 for 13 in the first half of a T-6's, seed 701."""
PARTS_APART = 3.0
"""Sigmas by which parts of a record may differ in COMPARED: chance goes beyond in 1 %."""
OF_PRIOR = 0.7
"""A parameter is the prior's where its sigma is a larger part of the prior's: the record has less
than the prior's information."""
ANSWERED = (*DERIVATIVES, "alpha_rad", "servo_lag_s")
"""The numbers whose correlations are answered."""
HELD = 1.0
"""Sigma in scales by which a parameter of a part is held where the fit of the whole ended: half a
manoeuvre, in which the rudder rests, shows nothing of some."""
NUMBERS = ("wn_rad_s", "zeta", "roll_mode", "spiral", *NAMES)
"""What a fit's numbers are, with Y_beta as itself under its logarithm's name."""
_OF = {"Y_beta": "log_Y_beta", "alpha_rad": "alpha", "servo_lag_s": "servo_lag"}
"""The parameters that they are made of, where they have other names."""
_STEP = 1e-4
"""Step of the modes' slopes, in scales of the parameters."""


def fit_airframe(motions: Sequence[Motion], *, servo_lag_s: float | None = None) -> Airframe:
    """Return the bare airframe that these manoeuvres of one airspeed show.

    State at the start and trims are each manoeuvre's own, all else is shared. With ``servo_lag_s``
    the lag stays near it. Whether the result may be used is in ``failed``.

    Raises:
        ValueError: there is no manoeuvre, or no start has a predictor.
    """
    records = [Record(motion) for motion in motions]
    priors = {} if servo_lag_s is None else {"servo_lag": (servo_lag_s, GIVEN_LAG_STD_S)}
    fits: list[Fit] = []
    starts = guesses(records, servo_lag_s)
    for guess in starts:
        with suppress(np.linalg.LinAlgError):  # there is no predictor at this start
            fits.append(fit(Criterion(records, guess, priors)))
    if not fits:
        raise ValueError("the fit of the bare airframe found no predictor from any start")
    fits.sort(key=lambda each: each.criterion - 2.0 * NATS * each.settled)
    airspeed_m_s = float(np.mean([each.airspeed_m_s for each in records]))
    airframe = _airframe(fits, records, airspeed_m_s)
    agreeing, given = _agreeing(fits, airframe), servo_lag_s is not None
    gates = list(failed_gates(airframe, records, fits[0].settled, agreeing, given))
    if not gates and (apart := _most_apart(fits[0], airspeed_m_s)) > PARTS_APART:
        gates = [FailedGate("changes", apart, PARTS_APART)]
    if not gates and servo_lag_s is not None:
        airframe = replace(airframe, given_lag_s=Known(servo_lag_s, GIVEN_LAG_STD_S),
                           free_lag_s=_free_lag(fits[0], starts[0]))  # fmt: skip
    return replace(airframe, failed=tuple(gates))


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


def _most_apart(found: Fit, airspeed_m_s: float) -> float:
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
    at, rows = [NUMBERS.index(name) for name in COMPARED], []
    for part in parts:
        values, slopes = (each[at] for each in _values(part, airspeed_m_s))
        rows.append((values, _stds(COMPARED, values, slopes, part.covariance)))
    value, std = np.array(rows).swapaxes(0, 1)
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
    return halves


def floor(name: str, value: float) -> float:
    """Return the least sigma of a number, which does not fall with more manoeuvres; 0 of most."""
    share, least = FLOORS.get(name, (0.0, 0.0))
    return math.hypot(share * value, least)


def mean(value: Floats, std: Floats, name: str) -> Known:
    """Return the weighted mean of a number (n,) of several airframes with these sigmas (n,).

    Sigma is larger where they scatter by more; what a linear model is worth stays in it whole.
    """
    known = np.isfinite(value) & np.isfinite(std) & (std > 0.0)
    if not known.any():
        return Known()
    value, weights = value[known], std[known] ** -2.0
    middle = float(weights @ value / weights.sum())
    scatter = float(weights @ (value - middle) ** 2) / max(len(value) - 1, 1)
    variance = max(scatter, 1.0) / weights.sum() + floor(name, middle) ** 2 * (
        1.0 - 1.0 / len(value)
    )
    return Known(middle, math.sqrt(variance))


def _in_gusts(names: Sequence[str]) -> Floats:
    """Return the errors of numbers (n,) over their sigma of noise."""
    return np.array([OTHERS_IN_GUSTS.get(name, IN_GUSTS) for name in names])


def _stds(names: Sequence[str], values: Floats, slopes: Floats, covariance: Floats) -> Floats:
    """Return sigma (m,) of numbers by the delta method, in gusts, with what a model is worth."""
    variances = _in_gusts(names) ** 2 * np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
    return _at_least(names, values, variances)


def _at_least(names: Sequence[str], values: Floats, variances: Floats) -> Floats:
    """Return sigma (m,) of numbers with these variances, and with what a linear model is worth."""
    least = [floor(*each) for each in zip(names, values.tolist(), strict=True)]
    return np.asarray(np.sqrt(variances + np.square(least)), np.float64)


def _values(found: Fit, airspeed_m_s: float) -> tuple[Floats, Floats]:
    """Return NUMBERS (m,) of a fit, and their slopes (m, n)."""
    return _of_theta(found, lambda theta: _numbers(theta, airspeed_m_s))


def _of_theta(found: Fit, function: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Return a function (v, l) -> (v, m) of the parameters (m,), and its slopes (m, n) to x."""
    points = np.vstack([found.x, found.x + _STEP * np.eye(len(found.x))])
    values = function(found.of.theta(points))
    return values[0], (values[1:] - values[0]).T / _STEP


def _numbers(theta: Floats, airspeed_m_s: float) -> Floats:
    """Return modes and parameters (v, 4 + len(PARAMETERS)), Y_beta as itself."""
    values = np.hstack([modes(theta, airspeed_m_s), theta])
    values[:, 4 + AT["log_Y_beta"]] = -np.exp(theta[:, AT["log_Y_beta"]])
    return np.asarray(values, np.float64)


def _to_prior(found: Fit, name: str, airspeed_m_s: float) -> Floats:
    """Return the values of :func:`_values` if a parameter had its prior's mean, the others by it.

    Of p, r and roll alone, a side force of the rudder, one of sideslip and damping in yaw may trade
    places. What the rudder's side force is away from what is known of it therefore counts in sigma:
    without that N_r of an A320 and of a T-6 was up to 10 sigma wrong, where wn and zeta were right.
    """
    of, i = found.of, found.of.names.index(name)
    away = of.mean[i] / of.scale[i] - found.x[i]
    x = found.x + found.covariance[:, i] / found.covariance[i, i] * away
    return np.asarray(_numbers(of.theta(x[None]), airspeed_m_s)[0], np.float64)


def _airframe(fits: Sequence[Fit], records: Sequence[Record], airspeed_m_s: float) -> Airframe:
    best = fits[0]
    values, slopes = _values(best, airspeed_m_s)
    near = [each for each in fits if each.criterion - best.criterion < 2.0 * NATS]
    others = np.array([_values(each, airspeed_m_s)[0] for each in near]) - values
    slopes = _in_gusts(NUMBERS)[:, None] * slopes
    whole = slopes @ best.covariance @ slopes.T + others.T @ others / len(near)
    side = _to_prior(best, "Y_delta_r", airspeed_m_s)[4:] - values[4:]
    whole[4:, 4:] += np.outer(side, side)
    stds = _at_least(NUMBERS, values, np.diag(whole))
    wn, zeta, roll, spiral = map(Known, values[:4].tolist(), stds[:4].tolist())
    by_name = dict(zip(NAMES, map(Known, values[4:].tolist(), stds[4:].tolist()), strict=True))
    by_name["Y_beta"] = by_name["log_Y_beta"]
    for name in {"L_delta_a", "N_delta_a"} - set(best.of.names):
        by_name[name] = Known()
    mix = _mix(best, airspeed_m_s) if np.isfinite(by_name["N_delta_a"].value) else Known()
    gust = math.exp(by_name["log_gust"].value) * best.noise_scale
    return Airframe(
        wn_rad_s=wn, zeta=zeta, roll_s=_time_constant(roll), spiral_s=_time_constant(spiral),
        derivatives={name: by_name[name] for name in DERIVATIVES},
        alpha_rad=by_name["alpha"], correlations=_correlations(whole[4:, 4:]),
        from_prior=tuple(_from_prior(best)), servo_lag_s=by_name["servo_lag"],
        delay_s=by_name["delay"], rudder_mix=mix,
        gust_std_rad=gust, rho1=autocorrelation(best.errors, records),
        airspeed_m_s=airspeed_m_s, aileron_fed_back=max(each.fed_back for each in records),
        names=best.of.names, theta=best.x * best.of.scale,
        as_flown=_as_flown(best, records[0]) if len(records) == 1 else None,
    )  # fmt: skip


def _mix(found: Fit, airspeed_m_s: float) -> Known:
    """Return the rudder mix; its sigma also has the scatter between rolls of different lengths."""
    rolls, slopes = _of_theta(found, lambda theta: rudder_mixes(theta, airspeed_m_s))
    mean = slopes.mean(axis=0)
    variance = IN_GUSTS**2 * mean @ found.covariance @ mean + np.var(rolls, ddof=1)
    return Known(float(rolls.mean()), math.sqrt(max(float(variance), 0.0)))


def _as_flown(found: Fit, record: Record) -> AsFlown | None:
    """Return the airframe closed with the roll law of the manoeuvre; None where none is found."""
    law = roll_law(record)
    if law is None:
        return None
    pair, slopes = _of_theta(
        found, lambda theta: dutch_roll_closed(theta, record.airspeed_m_s, law)
    )
    stds = _stds(("wn_rad_s", "zeta"), pair, slopes, found.covariance)
    wn, zeta = map(Known, pair.tolist(), stds.tolist())
    yaw_rate = yaw_rate_closed(found.of.theta(found.x[None])[0], record, law)
    return AsFlown(wn, zeta, record.inputs(0.0, 0.0)[:, RUDDER], yaw_rate)


def _correlations(covariance: Floats) -> Floats:
    """Return those of the parameters in ANSWERED (14, 14); 0 of one that was not estimated."""
    at = [AT[_OF.get(name, name)] for name in ANSWERED]
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
    yield from (name for name in ANSWERED if known.get(_OF.get(name, name), 0.0) > OF_PRIOR)


def _time_constant(pole: Known) -> Known:
    """Return the time constant in s of a real pole in 1/s."""
    if not math.isfinite(pole.value) or pole.value == 0.0:
        return Known()
    return Known(-1.0 / pole.value, pole.std / pole.value**2)


def autocorrelation(errors: Floats, records: Sequence[Record]) -> float:
    """Return the largest of the innovations of p, r and roll after COLOUR_S, of a fit's errors."""
    start, products, power = 0, np.zeros(3), np.zeros(3)
    later = max(1, round(COLOUR_S / records[0].sample_time_s))
    for each in records:
        n = len(each.y)
        e = errors[start : start + 3 * n].reshape(n, 3)
        both = ~(each.unused[later:] | each.unused[:-later])
        products += (e[later:] * e[:-later])[both].sum(axis=0)
        power += (e**2).sum(axis=0)
        start += 3 * n + len(each.jumps)
    rho = products / np.maximum(power, np.finfo(float).tiny)
    return float(rho[np.argmax(np.abs(rho))])


def _agreeing(fits: Sequence[Fit], airframe: Airframe) -> int:
    """Return how many starts end where the best one does, itself among them.

    Their wn, zeta and roll mode are within AGREES_SIGMAS.
    """
    roll = airframe.roll_s
    stds = airframe.wn_rad_s.std, airframe.zeta.std, roll.std / roll.value**2
    found = np.array([_values(each, airframe.airspeed_m_s)[0][:3] for each in fits])
    apart = np.abs(found - found[0]) / np.array(stds)
    return int((~(apart > AGREES_SIGMAS)).all(axis=1).sum())
