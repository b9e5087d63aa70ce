"""Reasons that the samples give against an answer: rates, the rudder's movement, who moved it."""

from collections.abc import Iterator

import numpy as np

from yawid.answers.reasons import Reason
from yawid.blocks import WINDOW_S, Floats, Held, shifted, words
from yawid.config.run import RATE_SLACK, RunConfig
from yawid.estimation.bank import Bank, SampleHistory
from yawid.results.excitation import LEAST_STROKE, ROWS_PER_LAG

LEAST_RATE_HZ = 5.0
LOW_RATE_HZ = 10.0
"""Message rates below which there is no answer, and below which the damping is uncertain."""
RATE_CHANGED = 1.5
"""The factor above which a message rate has changed between the first seconds and the whole run."""
COLLINEAR = 0.995
"""The largest canonical correlation of two inputs' lags up to which their effects can be separated:
it is a condition number of 20."""
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
LAGS_COMPARED = 3
"""How many lags of two inputs are compared: as many as the default nb."""
WEAKEST = 1e-3
"""A combination of lags weaker than this part of the strongest is rounding, not movement."""


def all_held(held: Held) -> Reason:
    """Return the reason that every sample is held, by the flags that they have."""
    why = ", ".join(words(flag) for flag in held)
    cures = {Held.ON_GROUND: IF_IT_FLEW, Held.RUDDER_INVALID: NO_VALUE}
    cure = "".join(f"; {said}" for flag, said in cures.items() if flag in held)
    return Reason("not_excited", f"every sample is held: {why}{cure}")


def message_rate_reasons(yaw_hz: float, rudder_hz: float) -> Iterator[Reason]:
    """Judge the rates of yaw and rudder messages by themselves."""
    slowest = min(yaw_hz, rudder_hz)
    said = f"yaw comes at {yaw_hz:.3g} Hz and the rudder at {rudder_hz:.3g} Hz"
    if slowest < LEAST_RATE_HZ * RATE_SLACK:
        text = f"{said}: at least {LEAST_RATE_HZ:g} Hz are needed"
        yield Reason("rate_too_low", text)
    elif slowest < LOW_RATE_HZ * RATE_SLACK:
        yield Reason("rate_low", f"{said}: below {LOW_RATE_HZ:g} Hz the damping is uncertain")


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
    most_whole: float, most_own: float, travel: str = "half its travel", grounded: float = 0.0
) -> Iterator[Reason]:
    """Judge whether the rudder moved, and whether it moved by itself or as the aileron's copy.

    ``most_whole`` and ``most_own`` are the largest strokes of the rudder and of its own part. It
    must have moved far enough within any five seconds: ten doublets in an hour are enough to
    learn from, a slow drift of the trim is not. ``travel`` names what the strokes are parts of;
    ``grounded`` is the share (0 to 1) of the samples that are held because they are on the ground.
    """
    needed, held = f"at least {100 * LEAST_STROKE:.0f} % is needed", ""
    if grounded > MOSTLY_GROUNDED:
        held = f"; {100 * grounded:.0f} % of the samples are held as on the ground: {IF_IT_FLEW}"
    if most_whole < LEAST_STROKE:
        yield Reason(
            "not_excited",
            f"the rudder's largest movement within {WINDOW_S:g} s is {100 * most_whole:.1f} "
            f"% of {travel}: {needed}{held}",
        )
    elif most_own < LEAST_STROKE:
        yield Reason(
            "mixed_rudder",
            f"the rudder follows the aileron: it moved by {100 * most_whole:.0f} % of "
            f"{travel} within {WINDOW_S:g} s, but at most {100 * most_own:.1f} % by itself, "
            f"and {needed}",
        )


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


def explained(target: Floats, causes: Floats) -> float:
    """Return R^2 of a linear regression with intercept, 0 for a target that hardly varies."""
    good = np.isfinite(causes).all(axis=1) & np.isfinite(target)
    target, causes = target[good], causes[good]
    if len(target) < 10 or target.std() <= ROUNDING * np.abs(target).max():
        return 0.0
    columns = np.column_stack([causes, np.ones(len(target))])
    left = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
    return 1.0 - float(np.var(left)) / float(np.var(target))


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
