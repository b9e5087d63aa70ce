"""One try to answer a manoeuvre: one fit over all of it, the choice of its inputs, the verdict.

``estimation/methods.py`` says which fit answers and which ones check it; ``manoeuvres/tries.py``
says which tries are made.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from yawid.answers.run_summary import Manoeuvre, MethodSummary, Orders
from yawid.blocks import EstimateBlock, Floats, SampleBlock
from yawid.config.run import BOTH, RunConfig
from yawid.estimation.bank import SampleHistory
from yawid.estimation.fit import fit_percent, simulate
from yawid.estimation.free_run import RudderEffect
from yawid.estimation.grids import Narrow, as_held, narrowed
from yawid.estimation.methods import IN_CALM_AIR, OF_STRUCTURES, of_a_record
from yawid.estimation.record_fit import (
    FittedModel,
    Record,
    fit_methods,
    held_back_pct,
    rudder_effect,
)
from yawid.manoeuvres.airspeed_check import of_one_manoeuvre
from yawid.manoeuvres.calm_air import apart_reasons, is_calm
from yawid.manoeuvres.candidate import OTHER_SPEED, speed_factors, speed_rows
from yawid.manoeuvres.conditions import conditions, without_airspeed
from yawid.manoeuvres.feedback import fed_back_reasons, rate_feedback
from yawid.quantities.vehicles import AIRFRAME, WITH_ROLL_LOOP
from yawid.results.excitation import LEAST_STROKE, excitation, own_part
from yawid.results.judge_estimate import Evidence, bank_verdict
from yawid.results.judge_rudder import rudder_reasons, rudder_shifts
from yawid.results.judge_samples import (
    COLLINEAR,
    MOST_REACTION,
    TURN_DOMINATED,
    WORTH_PCT,
    closeness,
    reaction_shares,
    turn_correlation,
)
from yawid.results.reasons import Reason, Verdict
from yawid.results.structures import (
    HIDDEN_ZETA,
    NEXT,
    NOTHING_KNOWN,
    Spread,
    hidden_share,
    spread_of,
)
from yawid.results.summary import as_summary, described, dutch_roll_in, modes_in

OTHER_ORDERS = (*NEXT, 1)
"""Second candidate orders; one of the two is chosen for the whole flight, from all manoeuvres."""
LEAST_SWINGS = 2
"""The least number of strokes of the rudder, there and back."""
LEAST_PERIODS, LEAST_PERIODS_SURE = 3.0, 2.5
"""The least length of a manoeuvre in periods of its Dutch roll, and where wn is surely known."""
SURE_WN = 0.03
"""The total sigma of wn, as a part of wn, below which wn is surely known."""
LEAST_ALONE_PCT = 60.0
"""The least simulated fit in percent where nothing could be held back. Steps of the pedals in turns
and landings had 40 to 64 %, and were wrong."""


@dataclass(frozen=True, slots=True)
class ManoeuvreSetting:
    """What all manoeuvres of a run have in common.

    ``rates_hz`` holds the rates of yaw and rudder messages, ``modes_of`` autopilot and vehicle
    type.
    """

    config: RunConfig
    sample_time_s: float
    rates_hz: tuple[float, float]
    modes_of: tuple[int, int]

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods: the one that answers, then those shown next to it."""
        return of_a_record(self.config.bank_methods())


@dataclass(frozen=True, slots=True)
class Structure:
    """A manoeuvre's result by some orders: Dutch roll (4,) and held-back fit in %.

    These sigmas are of noise; ``beyond`` holds the parts of the sigmas of wn and zeta that noise
    does not explain. ``physics`` has, by the name of a number of eq. 22-23, its value, its sigma of
    noise and that other part.
    """

    dutch_roll: Floats
    held_back_pct: float
    beyond: tuple[float, float]
    physics: Mapping[str, tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Answered:
    """A manoeuvre with its answer.

    ``span_ns`` is the Unix time of its first and last sample in ns; ``structures`` holds its
    results by orders, its own first.
    """

    found: Manoeuvre
    verdict: Verdict
    span_ns: tuple[int, int]
    structures: Mapping[tuple[int, ...], Structure]

    def with_reason(self, reason: Reason) -> "Answered":
        """Return the answer with a further reason in its verdict."""
        verdict = Verdict.of([*self.verdict.reasons, reason], self.verdict.method)
        found = msgspec.structs.replace(self.found, verdict=as_summary(verdict))
        return replace(self, found=found, verdict=verdict)


class Way(NamedTuple):
    """A way to fit a manoeuvre: turn, inputs and orders as in ``config``, and a band if any."""

    config: RunConfig
    narrow: Narrow | None = None


class Fits:
    """The fits of all methods over one manoeuvre, to be judged like a bank of estimators.

    ``y`` (n,) is the output, without the turn rate where ``config`` says so, and ``u`` (n, inputs)
    are the inputs as a model needs them (``as_held``); both are NaN where either is. ``estimator``
    is the configuration of the fits, which forget nothing. With ``narrow`` they are in its
    band, on its grid.
    """

    def __init__(
        self,
        setting: ManoeuvreSetting,
        config: RunConfig,
        samples: SampleBlock,
        narrow: Narrow | None = None,
    ) -> None:
        self.config = config
        self._is_narrow = narrow is not None
        self.methods = setting.methods
        self.sample_time_s, self._samples, self._mean_u, self.y = fitted_samples(
            setting, config, samples, narrow
        )
        self.u = self._mean_u if narrow else as_held(self._mean_u, samples.rudder_moves == 1.0)
        forgetting_nothing = replace(config, memory=None, forgetting=1.0)
        self.estimator = forgetting_nothing.estimator(config.method, self.sample_time_s)
        self._record = Record.of(self.estimator, self.u, self.y)
        models: list[FittedModel] = fit_methods(self._record, self.methods)
        self.estimators = dict(zip(self.methods, models, strict=True))

    def in_calm_air(self) -> None:
        """Let output error answer where the air is calm and the rudder moved by itself."""
        others, first = self.methods, self.methods[0]
        wn = float(dutch_roll_in(self, first, self.estimators[first].theta)[0])
        if first != OF_STRUCTURES or not wn > 0.0:
            return
        (model,) = fit_methods(self._record, [IN_CALM_AIR])
        left, innovations = (self.y - each.y_hat for each in (model, self.estimators[first]))
        if is_calm(left, innovations, self.u[:, 0], self.y, wn, self.sample_time_s):
            self.methods = (IN_CALM_AIR, *others)
            self.estimators = {IN_CALM_AIR: model, **self.estimators}

    @property
    def last(self) -> dict[str, EstimateBlock]:
        """The estimates by method, each a block of one row."""
        return {method: model.last for method, model in self.estimators.items()}

    def history(self) -> SampleHistory:
        """Return the samples that were fitted, with the inputs' means."""
        held = ~np.isfinite(self.y)
        names = ("roll", "turn_rate", "airspeed", "aileron", "mode")
        context = {n: np.where(held, np.nan, getattr(self._samples, n)) for n in names}
        y_hat = {method: model.y_hat for method, model in self.estimators.items()}
        return SampleHistory(u=self._mean_u, y=self.y, y_hat=y_hat, **context)

    def spread(self, held_back: float) -> Spread:
        """Return the spread around the answer; ``held_back`` is its held-back fit in percent."""
        first = self.methods[0]
        model = self.estimators[first]
        wn = float(dutch_roll_in(self, first, model.theta)[0])
        if not wn > 0.0:
            return NOTHING_KNOWN
        if first in (OF_STRUCTURES, IN_CALM_AIR):
            return spread_of(
                self.config, self.sample_time_s, self.u, self.y, wn, model, held_back, first
            )
        return spread_of(self.config, self.sample_time_s, self.u, self.y, wn)

    def hidden(self) -> float:
        """Return the part of zeta that a closed roll loop may hide, as roll shows it.

        In a band it does not show it, since a band leaves roll as it is.
        """
        first = self.methods[0]
        dutch_roll = modes_in(self, first).dutch_roll[-1]
        if self._is_narrow or not (dutch_roll[0] > 0.0 and dutch_roll[2] > 0.0):
            return HIDDEN_ZETA
        roll = np.where(np.isfinite(self.y), self._samples.roll, np.nan)
        return hidden_share(self.config, self.sample_time_s, self.u, roll, dutch_roll, first)

    def rudder_effect(self, wn_rad_s: float, *, shifted: bool) -> RudderEffect:
        """Return what the rudder adds to the fit of all; it is also ``shifted`` if asked."""
        model = self.estimators.get(OF_STRUCTURES, self.estimators[self.methods[0]])
        nb = model.config.orders.nb[0]
        shifts = rudder_shifts(wn_rad_s, self.sample_time_s, nb) if shifted else None
        return rudder_effect(model, self._record, shifts)

    def simulation_pct(self) -> float:
        """Return the free-running fit in percent of the method that answers."""
        model = self.estimators[self.methods[0]]
        orders, bias = model.config.orders, model.config.bias
        return fit_percent(self.y, simulate(model.theta, orders, bias, self.u, self.y))


def fitted_samples(
    setting: ManoeuvreSetting, config: RunConfig, samples: SampleBlock, narrow: Narrow | None
) -> tuple[float, SampleBlock, Floats, Floats]:
    """Return the sample time in s, the samples on that grid, and u (n, inputs) and y (n,) of a fit.

    u and y are NaN where either is.
    """
    removed = config.turn == "remove" and setting.config.turn == "keep"
    y = samples.y - samples.turn_rate if removed else samples.y
    u = samples.u[:, : len(config.inputs)]
    if len(config.inputs) > samples.u.shape[1]:
        u = np.column_stack([samples.u, samples.aileron])
    sample_time_s = setting.sample_time_s
    if narrow is not None:
        still = np.nan_to_num(samples.aileron)  # unknown, it must not hold the samples
        both, y = narrowed(np.column_stack([u, still]), y, sample_time_s, narrow)
        rows = np.arange(len(y)) * narrow.every
        aileron = np.where(np.isfinite(samples.aileron[rows]), both[:, -1], np.nan)
        samples, u = replace(samples.select(rows), aileron=aileron), both[:, :-1]
        sample_time_s *= narrow.every
    good = np.isfinite(y) & np.isfinite(u).all(axis=1)
    return sample_time_s, samples, np.where(good[:, None], u, np.nan), np.where(good, y, np.nan)


def answer_by(
    samples: SampleBlock, n: int, setting: ManoeuvreSetting, way: Way, tries: int = 1
) -> Answered:
    """Return the answer of the ``n``-th manoeuvre by a fit of its samples in this way.

    ``tries`` is the number of the try. After the first one the limits are narrower, and the rudder
    must always pass the test of being shifted in time.
    """
    found = conditions(samples, setting.modes_of)
    untrue = of_one_manoeuvre(samples)
    if untrue is not None:
        found = without_airspeed(found)
    config = way.config
    fits = Fits(setting, config, samples, way.narrow)
    if found.loop != WITH_ROLL_LOOP and may_have_aileron(fits):
        both = Fits(setting, replace(config, inputs=BOTH), samples, way.narrow)
        if both.simulation_pct() > fits.simulation_pct() + WORTH_PCT:
            fits = both
    fits.in_calm_air()
    first, history = fits.methods[0], fits.history()
    pct = {first: held_back_pct(fits.estimator, fits.u, fits.y, method=first)}
    hides_roll = found.loop != AIRFRAME and fits.config.inputs != BOTH
    spread = replace(fits.spread(pct[first]), hidden=fits.hidden() if hides_roll else 0.0)
    estimates, evidence = {}, {}
    for method in fits.methods:
        estimates[method], evidence[method] = described(
            fits, method, history, pct.get(method, math.nan), np.full(2, np.nan), spread
        )
        evidence[method] = replace(evidence[method], tries=tries)
    if found.loop != AIRFRAME:
        estimates = {method: each.without_level() for method, each in estimates.items()}
    alone = list(short_reasons(fits, history, evidence[first]))
    wn_rad_s = float(evidence[first].dutch_roll[0])
    if first == IN_CALM_AIR:
        alone += apart_reasons(wn_rad_s, float(evidence[OF_STRUCTURES].dutch_roll[0]))
    # What held-back samples or a check cannot confirm has to pass one more test.
    unchecked = tries > 1 or math.isnan(pct[first])
    unchecked |= any(math.isnan(each.dutch_roll[0]) for each in evidence.values())
    alone += rudder_reasons(fits.rudder_effect(wn_rad_s, shifted=unchecked), tries)
    if wn_rad_s > 0.0:
        # In every band: a damper goes on where the pilot's rudder rests, which a filter blurs.
        _, _, u, y = fitted_samples(setting, fits.config, samples, None)
        alone += fed_back_reasons(
            rate_feedback(u[:, 0], y, samples.aileron, wn_rad_s, setting.sample_time_s)
        )
    alone += [] if untrue is None else [untrue.reason]
    verdict = bank_verdict(fits, evidence, setting.rates_hz, alone, first_answers=True)
    config = fits.config
    manoeuvre = Manoeuvre(
        n=n,
        **asdict(found),
        inputs=list(config.inputs),
        orders=Orders(*config.orders),
        turn_removed=config.turn == "remove",
        estimates=estimates,
        verdict=as_summary(verdict),
    )
    span_ns = int(samples.unix_ns[0]), int(samples.unix_ns[-1])
    structures = _structures(fits, estimates[first], evidence[first], spread)
    return Answered(manoeuvre, verdict, span_ns, structures)


def short_reasons(fits: Fits, history: SampleHistory, evidence: Evidence) -> Iterator[Reason]:
    """Judge whether so short a record separates the mode from everything else that happened.

    Many models fit a rudder that goes one way and stays there, and two swings of the nose. Where
    nothing can be held back, the fit to the samples themselves must be better instead.
    """
    wn_rad_s, simulated = float(evidence.dutch_roll[0]), evidence.simulation_pct
    unit = fits.config.half_travel
    rudder = np.where(np.isfinite(history.y), history.u[:, 0], np.nan) / unit
    aileron = history.aileron[np.isfinite(history.aileron)]
    if len(aileron) and float(np.ptp(aileron)) > 0.0:  # an aileron at rest explains nothing
        rudder = own_part(rudder, history.aileron, history.mode, fits.sample_time_s)
    moves = swings(rudder[np.isfinite(rudder)], LEAST_STROKE)
    if moves < LEAST_SWINGS:
        yield Reason(
            "not_excited",
            f"the rudder moved by {100 * LEAST_STROKE:.0f} % of {fits.config.travel_said} or more "
            f"{'in one direction only' if moves else 'nowhere'}: a movement there and back is "
            "needed",
        )
    seconds = fits.sample_time_s * np.count_nonzero(np.isfinite(history.y))
    periods = seconds * wn_rad_s / (2.0 * math.pi)
    factors = speed_factors(history.airspeed, speed_rows(fits.sample_time_s))
    factors = factors[np.isfinite(factors)]
    if len(factors) and factors[-1] > OTHER_SPEED:
        yield Reason(
            "not_converged",
            f"the first and the last airspeed differ by a factor of {factors[-1]:.2f}, and wn "
            f"varies with the airspeed: at most {OTHER_SPEED:g} is allowed; choose a stretch by "
            "--from and --to",
        )
    is_sure = float(evidence.total_std[0]) < SURE_WN * wn_rad_s
    if periods < (LEAST_PERIODS_SURE if is_sure else LEAST_PERIODS):
        yield Reason(
            "not_converged",
            f"the {seconds:.1f} s hold only {periods:.1f} periods of the Dutch roll found: at "
            f"least {LEAST_PERIODS:g} are needed, or {LEAST_PERIODS_SURE:g} where the sigma of wn "
            f"is below {100 * SURE_WN:g} %",
        )
    if math.isnan(evidence.held_back_pct) and simulated < LEAST_ALONE_PCT:
        yield Reason(
            "poor_fit",
            f"the inputs explain only {max(simulated, 0.0):.0f} % of the yaw rate (free run): at "
            f"least {LEAST_ALONE_PCT:g} % is needed, as the manoeuvre is too short to hold a part "
            "of it back",
        )


def swings(x: Floats, least: float) -> int:
    """Return how many moves by at least ``least`` x (n,) made, in alternating directions."""
    count, low, high = 0, math.inf, -math.inf
    up = None
    for value in x.tolist():
        low, high = min(low, value), max(high, value)
        if up is not True and value - low >= least:
            up, high, count = True, value, count + 1
        elif up is not False and high - value >= least:
            up, low, count = False, value, count + 1
    return count


def first_way(samples: SampleBlock, setting: ManoeuvreSetting) -> Way:
    """Return the first way to fit, with ``turn = remove`` where turns would hide the rudder."""
    config = setting.config
    if not may_remove_turn(config):
        return Way(config)
    dominated = turn_correlation(samples.y, samples.turn_rate) > TURN_DOMINATED
    return Way(replace(config, turn="remove") if dominated else config)


def may_remove_turn(config: RunConfig) -> bool:
    """Return whether it is left to each manoeuvre to remove the turn."""
    return not (config.binds("turn") or config.band is not None or config.output == "yaw")


def may_have_aileron(fits: Fits) -> bool:
    """Return whether the aileron moved on its own, so that it may be tried as a further input."""
    config, history = fits.config, fits.history()
    if config.binds("inputs") or config.inputs == BOTH or not np.isfinite(history.aileron).any():
        return False
    rudder = history.u[:, 0] / config.half_travel
    moved = excitation(history.aileron, rudder, history.mode, 1.0, fits.sample_time_s)
    both = replace(history, u=np.column_stack([history.u, history.aileron]))
    return (
        moved.most_own >= LEAST_STROKE
        and closeness(history.u[:, 0], history.aileron) <= COLLINEAR
        and reaction_shares(both)[1] < MOST_REACTION
    )


def _structures(
    fits: Fits, found: MethodSummary, evidence: Evidence, spread: Spread
) -> dict[tuple[int, ...], Structure]:
    """Return the results of the own orders and, if those were not given, of the richer ones."""
    physics = {
        name: (each.value, each.std_noise)
        for name, each in (found.physics or {}).items()
        if each.value is not None and each.std_noise is not None
    }
    own = _structure(spread, evidence.dutch_roll, physics, evidence.held_back_pct)
    structures: dict[tuple[int, ...], Structure] = {fits.config.four_orders: own}
    richer = spread.next
    if richer is not None and not fits.config.binds("orders"):
        physics = {name: (each, richer.sigmas[name]) for name, each in richer.values.items()}
        structures[richer.orders] = _structure(
            spread, richer.dutch_roll, physics, richer.held_back_pct
        )
    return structures


def _structure(
    spread: Spread,
    dutch_roll: Floats,
    physics: Mapping[str, tuple[float, float]],
    held_back: float,
) -> Structure:
    if not math.isfinite(dutch_roll[0]):
        return Structure(dutch_roll, held_back, (math.nan,) * 2, {})
    spread = spread.around(float(dutch_roll[0]))
    wn = spread.beyond("wn_rad_s", float(dutch_roll[0]))
    zeta = spread.beyond("zeta", float(dutch_roll[2]))
    known = {n: (value, noise, spread.beyond(n, value)) for n, (value, noise) in physics.items()}
    return Structure(dutch_roll, held_back, (wn, zeta), known)
