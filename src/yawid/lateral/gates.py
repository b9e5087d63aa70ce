"""The gates that an airframe has to pass, each with what it means and what to do."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from yawid.lateral.airframe import Airframe, FailedGate
from yawid.lateral.fit import ITERATIONS
from yawid.lateral.record import Record

COPIED, COLOURED, TOO_COARSE = 0.98, 0.35, 0.25
WN_KNOWN, AILERON_KNOWN, RUDDER_SIGMAS = 0.04, 0.25, 3.0
FED_BACK = 0.85
"""R squared of the aileron on roll and p above which it follows them."""
LONG_LAG = 0.5
"""The servo's lag over the time 1/wn beyond which one manoeuvre with such an aileron does not show
it: SITL's, at 1.4, had roll modes 18 to 28 % too slow and wn up to 2.5 sigma low."""
LEAST_STARTS_AGREEING = 2
_COPY_DELAYS_S = (0.0, 0.05, 0.1, 0.15)


@dataclass(frozen=True, slots=True)
class Gate:
    """A gate's words: a sentence with ``{found}`` and ``{limit}``, and what to do."""

    sentence: str
    remedy: str


GATES = {
    "no_aileron": Gate(
        "no aileron was found", "name the aileron's output, or record all servo outputs"
    ),
    "commands_on_grid": Gate(
        "the commands are known on the grid of the samples only",
        "replay the log itself, whose servo messages have their own stamps",
    ),
    "rudder_copies_aileron": Gate(
        "the aileron explains {found:.3f} of the rudder's variance (limit {limit:g})",
        "move the rudder on its own",
    ),
    "rudder_feeds_back": Gate(
        "{found:.2f} of the rudder near the mode is feedback of the yaw rate (limit {limit:g})",
        "switch the yaw damper off for the manoeuvre",
    ),
    "changes": Gate(
        "the airframe changes within it: parts of the record are {found:.1f} sigma apart (limit "
        "{limit:g})",
        "keep flaps, power and airspeed as they are, or choose a part by --from and --to",
    ),
    "too_slow": Gate(
        "in one sample the fastest mode turns or decays by {found:.2f} rad (limit {limit:g})",
        "send the attitude at a higher rate",
    ),
    "coloured": Gate(
        "the innovations predict {found:.2f} of those 40 ms later (limit {limit:g})",
        "send the attitude without smoothing, at a higher rate",
    ),
    "rudder_without_effect": Gate(
        "N_delta_r is {found:.1f} sigma from 0 ({limit:g} needed)", "move the rudder more"
    ),
    "several_minima": Gate(
        "from other starts the fit ends in another airframe ({found:g} of 3 agree, {limit:g} are "
        "needed)",
        "move the aileron on its own, or fly more manoeuvres at one speed",
    ),
    "only_feedback": Gate(
        "roll and p explain {found:.2f} of the aileron (limit {limit:g}), which does not show the "
        "servo's lag",
        "give the servo's lag (--servo-lag), or move the aileron on its own",
    ),
    "aileron_uncertain": Gate(
        "sigma of L_delta_a is {found:.2f} of it (limit {limit:g})",
        "move the aileron on its own, not by the roll hold alone",
    ),
    "lag_unknown": Gate(
        "only {found:g} starts of the servo lag agree with the best one ({limit:g} needed)",
        "give the servo's lag (--servo-lag), or pool several manoeuvres of one speed",
    ),
    "wn_uncertain": Gate(
        "sigma of wn is {found:.3f} of it (limit {limit:g})",
        "move the rudder more, and the aileron on its own",
    ),
    "differs_from_flown": Gate(
        "with the aileron moved as it was, the airframe differs from the answer as flown by "
        "{found:.1f} times the sum of both sigmas (limit {limit:g})",
        "check --servo-lag, and in gusts repeat the manoeuvre in calmer air",
    ),
    "not_settled": Gate(
        "the fit did not settle within {limit:g} steps",
        "move the rudder more, and the aileron on its own",
    ),
    "no_dutch_roll": Gate("no mode of the airframe oscillates", "check the channels' signs"),
}
"""Every gate by its name, in the order in which they decide: what is wrong with the record comes
before what the fit makes of it."""


def failed_gates(
    airframe: Airframe,
    records: Sequence[Record],
    settled: bool,
    starts_agreeing: int,
    lag_given: bool,
) -> Iterator[FailedGate]:
    """Yield the gates that stop an airframe."""
    if not all(each.motion.aileron_known for each in records):
        yield FailedGate("no_aileron", math.nan, math.nan)
    if not all(each.motion.commands_exact for each in records):
        yield FailedGate("commands_on_grid", math.nan, math.nan)
    if (copied := copied_share(records)) > COPIED:
        yield FailedGate("rudder_copies_aileron", copied, COPIED)
    if not settled:
        yield FailedGate("not_settled", math.nan, ITERATIONS)
    if starts_agreeing < LEAST_STARTS_AGREEING:
        name = "several_minima" if lag_given else "lag_unknown"
        yield FailedGate(name, starts_agreeing, LEAST_STARTS_AGREEING)
    fed_back = airframe.aileron_fed_back
    is_long = airframe.servo_lag_s.value * airframe.wn_rad_s.value > LONG_LAG
    if not lag_given and (len(records) > 1 or is_long) and fed_back > FED_BACK:
        # four flights of SITL together were 10 % low with a sigma of 1.7 %
        yield FailedGate("only_feedback", fed_back, FED_BACK)
    if not airframe.rho1 < COLOURED:
        yield FailedGate("coloured", airframe.rho1, COLOURED)
    if not math.isfinite(airframe.wn_rad_s.value):
        yield FailedGate("no_dutch_roll", math.nan, math.nan)
        return
    fastest = max(airframe.wn_rad_s.value, abs(1.0 / airframe.roll_s.value))
    if not (turned := records[0].sample_time_s * fastest) < TOO_COARSE:
        yield FailedGate("too_slow", turned, TOO_COARSE)
    yield from _uncertain(airframe, any(each.aileron_moves for each in records))


def _uncertain(airframe: Airframe, aileron_moves: bool) -> Iterator[FailedGate]:
    share = airframe.wn_rad_s.std / airframe.wn_rad_s.value
    if not share < WN_KNOWN:
        yield FailedGate("wn_uncertain", share, WN_KNOWN)
    aileron, rudder = (airframe.derivatives[name] for name in ("L_delta_a", "N_delta_r"))
    if aileron_moves and not (share := aileron.std / abs(aileron.value)) < AILERON_KNOWN:
        yield FailedGate("aileron_uncertain", share, AILERON_KNOWN)
    if not (sigmas := abs(rudder.value) / rudder.std) > RUDDER_SIGMAS:
        yield FailedGate("rudder_without_effect", sigmas, RUDDER_SIGMAS)


def copied_share(records: Sequence[Record]) -> float:
    """Return R squared of the rudder on the aileron of up to 0.15 s before."""
    left = power = 0.0
    for each in records:
        if not each.aileron_moves:
            return 0.0
        columns = np.stack(
            [each.commanded(0.0, delay_s)[:, 0] for delay_s in _COPY_DELAYS_S]
            + [np.ones(len(each.times_s))],
            axis=1,
        )
        rudder = each.commanded(0.0, 0.0)[:, 1]
        found, *_ = np.linalg.lstsq(columns, rudder, rcond=1e-9)
        left += float(np.sum((rudder - columns @ found) ** 2))
        power += float(np.sum((rudder - rudder.mean()) ** 2))
    return 1.0 - left / max(power, np.finfo(float).tiny)
