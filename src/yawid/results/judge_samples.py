"""Reasons that the samples give against an answer: rates, inputs, and how the aircraft was flown.

A wrong answer that looks right is the worst output this program could have. So everything that
speaks against an estimate is reported, and what speaks clearly enough makes it unusable.
"""

import math
from collections.abc import Iterator
from statistics import NormalDist

import numpy as np

from yawid.blocks import AIRSPEED_SHARE, WINDOW_S, Floats, shifted
from yawid.config.run import RATE_SLACK, RunConfig
from yawid.estimation.bank import Bank, SampleHistory
from yawid.results.excitation import LEAST_STROKE, ROWS_PER_LAG, Movement
from yawid.results.reasons import Reason

LEAST_RATE_HZ = 5.0
LOW_RATE_HZ = 10.0
"""Message rates below which there is no answer, and below which the damping is uncertain."""
REFUSED_RATIO, LOW_RATIO = 4.0, 10.0
"""Samples per Dutch-roll period below which there is no answer, and below which it is poor."""
RATE_CHANGED = 1.5
"""The factor above which a message rate has changed between the first seconds and the whole run."""
COLLINEAR = 0.995
"""The largest canonical correlation of two inputs' lags up to which their effects can be separated:
it is a condition number of 20."""
TURN_DOMINATED = 0.6
"""The correlation of yaw rate and turn rate above which the bank, not the rudder, makes the yaw
rate."""
TURN_BAND_HZ = (0.15, 3.0)
"""A band that leaves out the turns and keeps the Dutch rolls of small aircraft."""
CLOSED_LOOP = 0.8
"""An input of which yaw rate and roll explain a greater part reacts more than it excites."""
MOST_REACTION = 0.5
"""An aileron of which yaw rate and roll explain a greater part only holds the wings level: it is no
input."""
WORTH_PCT = 2.0
"""The points that a further input must add to the simulated fit in percent."""
RESPONSE_S, RESPONSE_STEP_S = 2.0, 0.1
"""The rudder's lags, up to how many s and how many s apart, that may explain the yaw rate."""
LEAST_RESPONSE = 0.5
"""The part of the yaw rate that a rudder must explain to move it clearly. It was 0.64 where a
receiver moved the servos of a disarmed autopilot, and 0.36 where an autopilot was only carried
along."""
MOSTLY_GROUNDED = 0.5
"""The share of samples on the ground above which the refusal of a rudder at rest says so."""
IF_IT_FLEW = "if the aircraft flew, take them by --airborne all"
NO_VALUE = "the rudder's channel holds no value: name the one that moves it by --rudder servo:N"
ROUNDING = 1e-9
"""The relative variation up to which a signal only varies by rounding."""
UNCERTAIN_WN, UNCERTAIN_ZETA = 0.1, 0.15
"""The relative sigma of wn, and the sigma of zeta, at which a Dutch roll is no longer of use. After
a first try they are :func:`narrower`."""
ROUGH_WN = 0.05
"""The relative sigma of wn above which a usable answer is only a rough value."""
SATURATED_SHARE = 0.05
"""The part of the time at the stops above which there is a warning."""
LAGS_COMPARED = 3
"""How many lags of two inputs are compared: as many as the default nb."""
WEAKEST = 1e-3
"""A combination of lags weaker than this part of the strongest is rounding, not movement."""


def narrower(tries: int) -> float:
    """Return the factor by which the limits of sigma are smaller for the last of several tries.

    A sigma below its limit says that an error of two sigmas is rare. Of several tries the first one
    that passes answers, so each may have only its share of that probability (Bonferroni 1936): the
    two sigmas are 2.28 for the second try and 2.43 for the third.
    """
    normal = NormalDist()
    return normal.inv_cdf(normal.cdf(-2.0)) / normal.inv_cdf(normal.cdf(-2.0) / tries)


def rough_reasons(wn_rad_s: float, wn_std: float) -> Iterator[Reason]:
    """Judge whether the total sigma of wn allows more than a rough value."""
    if wn_std > ROUGH_WN * wn_rad_s:
        yield Reason(
            "poorly_known",
            f"wn is only known to {100.0 * wn_std / wn_rad_s:.0f} % ({wn_rad_s:.3g} ± "
            f"{wn_std:.2g} rad/s, one sigma): usable up to {100 * UNCERTAIN_WN:.0f} %, but a rough "
            f"value above {100 * ROUGH_WN:.0f} %",
        )


def rate_reasons(
    yaw_hz: float, rudder_hz: float, rate_hz: float, dutch_roll: Floats
) -> Iterator[Reason]:
    """Judge the message rates and, if wn is known to 10 %, whether the grid is fine enough for it.

    ``yaw_hz`` and ``rudder_hz`` are the messages' rates, ``rate_hz`` the grid's; ``dutch_roll`` is
    (wn, wn_std, zeta, zeta_std).
    """
    wn_rad_s, wn_std = float(dutch_roll[0]), float(dutch_roll[1])
    known = wn_std < UNCERTAIN_WN * wn_rad_s
    slowest = min(yaw_hz, rudder_hz)
    said = f"yaw {yaw_hz:.3g} Hz, rudder {rudder_hz:.3g} Hz"
    if slowest < LEAST_RATE_HZ * RATE_SLACK:
        text = f"{said}: at least {LEAST_RATE_HZ:g} Hz are needed"
        yield Reason("rate_too_low", text)
    elif slowest < LOW_RATE_HZ * RATE_SLACK:
        yield Reason("rate_low", f"{said}: below {LOW_RATE_HZ:g} Hz the damping is uncertain")
    if known:
        yield from _against_the_mode(min(slowest, rate_hz), slowest, wn_rad_s / (2.0 * math.pi))


def _against_the_mode(have_hz: float, own_hz: float, found_hz: float) -> Iterator[Reason]:
    """Judge the rate there is, and the messages' own, against the natural frequency found."""
    if have_hz < REFUSED_RATIO * found_hz:
        yield Reason(
            "rate_too_low",
            f"the rate is {have_hz:.3g} Hz: at least {REFUSED_RATIO:g} times the natural frequency "
            f"found is needed, which is {REFUSED_RATIO * found_hz:.3g} Hz",
        )
    elif have_hz < LOW_RATIO * found_hz:
        better = f"; the log allows --rate {own_hz:.3g}" if own_hz > 1.05 * have_hz else ""
        yield Reason(
            "rate_low",
            f"the rate of {have_hz:.3g} Hz is only {have_hz / found_hz:.1f} times the natural "
            f"frequency found: {LOW_RATIO:g} times is better{better}",
        )


def changed_rates(
    yaw_hz: float, rudder_hz: float, later_yaw_hz: float, later_rudder_hz: float
) -> Iterator[Reason]:
    """Compare the rates of the first seconds, which set the grid, with those of the whole run."""
    pairs = (("yaw", yaw_hz, later_yaw_hz), ("rudder", rudder_hz, later_rudder_hz))
    for name, first, later in pairs:
        if later > RATE_CHANGED * first or first > RATE_CHANGED * later:
            text = (
                f"{name} came at {first:.3g} Hz when the grid's rate was chosen and over the whole "
                f"run at {later:.3g} Hz: choose the rate with --rate"
            )
            yield Reason("rate_changed", text)
            return


def excitation_reasons(
    found: Movement, travel: str = "half its travel", grounded: float = 0.0
) -> Iterator[Reason]:
    """Judge whether the rudder moved, and whether it moved by itself or as the aileron's copy.

    It must have moved far enough within any five seconds: ten doublets in an hour are enough to
    learn from, a slow drift of the trim is not. ``travel`` names what the strokes are parts of;
    ``grounded`` is the share (0 to 1) of the samples that are held because they are on the ground.
    """
    needed, held = f"at least {100 * LEAST_STROKE:.0f} % is needed", ""
    if grounded > MOSTLY_GROUNDED:
        held = f"; {100 * grounded:.0f} % of the samples are held as on the ground: {IF_IT_FLEW}"
    if found.most_whole < LEAST_STROKE:
        yield Reason(
            "not_excited",
            f"the rudder's largest movement within {WINDOW_S:g} s is {100 * found.most_whole:.1f} "
            f"% of {travel}: {needed}{held}",
        )
    elif found.most_own < LEAST_STROKE:
        yield Reason(
            "mixed_rudder",
            f"the rudder follows the aileron: it moved by {100 * found.most_whole:.0f} % of "
            f"{travel} within {WINDOW_S:g} s, but at most {100 * found.most_own:.1f} % by itself, "
            f"and {needed}",
        )


def input_reasons(inputs: tuple[str, ...], u: Floats, stop: float) -> Iterator[Reason]:
    """Judge the inputs ``u`` (n, inputs): the rudder at its stops, inputs that move together.

    ``stop`` is the rudder's full deflection in the unit of ``u``.
    """
    rows = u[np.isfinite(u).all(axis=1)]
    if len(rows) < 2:
        yield Reason("not_excited", "no sample has both rudder and yaw rate")
        return
    stops = float(np.mean(np.abs(rows[:, 0]) >= 0.99 * stop))
    if stops > SATURATED_SHARE:
        text = f"the rudder was at its stops for {100 * stops:.0f} % of the time"
        yield Reason("saturated", text)
    for i in range(1, len(inputs)):
        close = closeness(u[:, 0], u[:, i])
        if close > COLLINEAR:
            r = _correlation(rows[:, 0], rows[:, i])
            condition = math.sqrt((1.0 + close) / max(1.0 - close, 1e-12))
            yield Reason(
                "collinear_inputs",
                f"{inputs[0]} and {inputs[i]} move together (correlation {r:.4f}, condition "
                f"number of their lags {condition:.3g}): their effects cannot be separated",
            )


def flight_reasons(history: SampleHistory, turn: str) -> Iterator[Reason]:
    """Judge how it was flown: turns that hide the rudder, and an airspeed that changed."""
    y, u = history.y, history.u[:, 0]
    rows = np.isfinite(y) & np.isfinite(u)
    r = turn_correlation(np.where(rows, y, np.nan), history.turn_rate)
    if turn == "keep" and r > TURN_DOMINATED:
        yield Reason(
            "turn_dominated",
            f"the yaw rate follows the bank and not the rudder: its correlation with the turn rate "
            f"is {r:+.2f}, and at most {TURN_DOMINATED:g} is allowed",
            {"turn": "remove", "band": TURN_BAND_HZ},
        )
    speed = history.airspeed[rows & np.isfinite(history.airspeed)]
    if len(speed) > 1:
        low, middle, high = np.percentile(speed, [5.0, 50.0, 95.0])
        # A sensor on an aircraft at rest may report 0.
        share = (high - low) / (2.0 * middle) if middle > 0.0 else float(high > low)
        # The limit is more than the sigma of any usable answer.
        if share > AIRSPEED_SHARE:
            yield Reason(
                "airspeed_changed",
                f"the airspeed ranged from {low:.1f} to {high:.1f} m/s: wn and the gain vary with "
                f"it, by ± {100.0 * share:.0f} %",
            )


def feedback_reasons(inputs: tuple[str, ...], history: SampleHistory) -> Iterator[Reason]:
    """Judge whether inputs only react: yaw rate, roll and the previous roll explain most of them.

    Past yaw rates are left out: they contain what the rudder did a moment ago, and would explain 80
    to 87 % even of a rudder that excites.
    """
    said = [
        f"{100 * share:.0f} % of the {name}"
        for name, share in zip(inputs, reaction_shares(history), strict=True)
        if share > CLOSED_LOOP
    ]
    if said:
        text = f"yaw rate and roll explain {' and '.join(said)}: it reacts more than it excites"
        yield Reason("closed_loop", text)


def damper_reasons(history: SampleHistory, share: float, early_response: float) -> Iterator[Reason]:
    """Judge whether a controller was identified in place of the aircraft.

    A rudder that yaw rate and roll explain, and that turns the nose the other way, only reacts: the
    model found is then the inverse of the controller. It is a yaw damper if the rudder opposes the
    yaw rate. ``share`` is the rudder's part from :func:`reaction_shares`; ``early_response`` is
    that of an estimate's ``Evidence``.
    """
    if not (share > CLOSED_LOOP and early_response < 0.0):
        return
    rows = np.isfinite(history.u[:, 0]) & np.isfinite(history.y)
    r = _correlation(history.u[rows, 0], history.y[rows])
    if r > 0.0:
        yield Reason(
            "mode_not_driven",
            f"the rudder follows the yaw rate (correlation {r:+.2f}; yaw rate and roll explain "
            f"{100 * share:.0f} % of it), but in the model it turns the nose the other way: it "
            "moves as in a coordinated turn, or --rudder-sign is wrong",
        )
    else:
        yield Reason(
            "mode_not_driven",
            f"the rudder opposes the yaw as a yaw damper does (yaw rate and roll explain "
            f"{100 * share:.0f} % of it): the model is that of the damper, not of the aircraft",
        )


def reaction_shares(history: SampleHistory) -> list[float]:
    """Return the part (0 to 1) of each input that yaw rate, roll and the previous roll explain."""
    before = np.concatenate([[np.nan], history.roll[:-1]])
    causes = np.column_stack([history.y, history.roll, before])
    return [explained(u, causes) for u in history.u.T]


def why_believed(config: RunConfig, bank: Bank | None) -> str:
    """Return why the rudder is believed though its autopilot is not in command; "" if it is not."""
    if config.binds("rudder"):
        return f"--rudder {config.rudder} says that this channel moves the rudder"
    return "" if bank is None else why_rudder_moves_yaw(bank.history(), bank.sample_time_s)


def why_rudder_moves_yaw(history: SampleHistory, sample_time_s: float) -> str:
    """Return in words how clearly the rudder moves the yaw, whoever commands it; "" if it does not.

    An autopilot that is only carried along computes its rudder from the yaw rate. There the rudder
    after an instant explains the yaw rate better than the rudder before it.
    """
    lags = response_lags(sample_time_s)
    u = history.u[:, 0]
    if np.count_nonzero(np.isfinite(u + history.y)) < ROWS_PER_LAG * len(lags):
        return ""
    before, after = (
        explained(history.y, np.column_stack([shifted(u, sign * i) for i in lags]))
        for sign in (1, -1)
    )
    if before < LEAST_RESPONSE or before <= after:
        return ""
    return f"the rudder explains {100 * before:.0f} % of the yaw rate that follows it"


def response_lags(sample_time_s: float) -> range:
    """Return the rudder's lags in samples that may explain the yaw rate."""
    step = max(1, round(RESPONSE_STEP_S / sample_time_s))
    return range(1, round(RESPONSE_S / sample_time_s) + 1, step)


def turn_correlation(y: Floats, turn: Floats) -> float:
    """Return the correlation of output and turn rate (n,) over the samples that have both."""
    rows = np.isfinite(y) & np.isfinite(turn)
    return _correlation(y[rows], turn[rows])


def _correlation(a: Floats, b: Floats) -> float:
    if len(a) < 3 or a.std() == 0.0 or b.std() == 0.0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def explained(target: Floats, causes: Floats) -> float:
    """Return R^2 of a linear regression with intercept, 0 for a target that hardly varies."""
    good = np.isfinite(causes).all(axis=1) & np.isfinite(target)
    target, causes = target[good], causes[good]
    if len(target) < 10 or target.std() <= ROUNDING * np.abs(target).max():
        return 0.0
    return 1.0 - variance_left(target, causes) / float(np.var(target))


def variance_left(target: Floats, causes: Floats) -> float:
    """Return the variance that a regression on ``causes`` (n, m), with intercept, leaves."""
    columns = np.column_stack([causes, np.ones(len(target))])
    coefficients = np.linalg.lstsq(columns, target, rcond=None)[0]
    return float(np.var(target - columns @ coefficients))


def closeness(a: Floats, b: Floats) -> float:
    """Return the largest canonical correlation of the lags of ``a`` and ``b`` (n,), 0 if unknown.

    An aileron that follows the rudder one sample later adds as little as an exact copy, though the
    two hardly correlate. What counts is whether any combination of the lags of one input equals a
    combination of the lags of the other. Rows with NaN in any lag are left out.
    """
    lagged = [np.column_stack([shifted(x, -i) for i in range(LAGS_COMPARED)]) for x in (a, b)]
    rows = np.isfinite(np.concatenate(lagged, axis=1)).all(axis=1)
    if int(rows.sum()) < 10 * LAGS_COMPARED:
        return 0.0
    bases = [_basis(block[rows]) for block in lagged]
    if 0 in (bases[0].shape[1], bases[1].shape[1]):
        return 0.0
    cosines = np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
    return min(float(cosines[0]), 1.0)


def _basis(columns: Floats) -> Floats:
    """Return an orthonormal basis of the columns (n, lags), without their means and rounding."""
    centred = columns - columns.mean(axis=0)
    power, directions = np.linalg.eigh(centred.T @ centred)
    strong = power > max(WEAKEST**2 * float(power[-1]), 1e-12)
    basis: Floats = centred @ directions[:, strong] / np.sqrt(power[strong])
    return basis
