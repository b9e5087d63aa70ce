"""The part of sigma that noise does not explain: results of other structures from the same samples.

The sigma of a fit says how far noise moves it if the structure is right. The structure never is:
the roll and its loop, the rudder's servo and the air are left out, and each structure is biased by
them in its own way. So a few other structures are fitted to the same samples, two of them on the
same grid and three on a coarser one with twelve samples a period. A fine grid gives weight to fast
errors of the model, a coarse one to slow errors; over JSBSim's aircraft the two differ by about as
much as either is wrong. Each structure's weight is by how well it predicts samples that were held
back. The variance of the model average (Buckland and others 1997) is that of noise plus the
weighted mean square of the distances from the answer.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from yawid.answers.run_summary import Orders
from yawid.blocks import EstimateBlock, Floats
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.config.run import RATE_SLACK, RunConfig
from yawid.estimation.methods import IN_CALM_AIR, OF_STRUCTURES
from yawid.estimation.record_fit import FittedModel, fit_record, held_back_pct
from yawid.physics.derivatives import summary_of
from yawid.physics.modes import dutch_roll_of, modes
from yawid.quantities.table import REDUCTION_ERROR
from yawid.results.judge_samples import LOW_RATE_HZ, LOW_RATIO, UNCERTAIN_WN

NEXT, AFTER_NEXT = (4, 4, 3), (5, 5, 4)
"""The richer structure (na, nb, nc) that is fitted on the same grid; the second is for where the
first is the answer's own."""
SIMPLE, COARSE = (2, 2, 2), ((3, 3, 2), NEXT, AFTER_NEXT)
"""A simpler structure on the same grid, and the structures on the coarse grid."""
COARSE_PER_PERIOD = 12
ALIKE = 2.0
"""A structure whose wn differs by more than this factor found another mode."""
WEIGHT_PCT = 3.0
"""A held-back fit that is lower by this many points reduces a structure's weight to 1/e."""
EQUAL = {"omega_beta": "wn_rad_s", "xi_beta": "zeta"}
"""Names of eq. 23 for the Dutch roll's own numbers, which have the same sigmas. They are not taken
from eq. 23 because not every structure's model is a yaw channel."""
MOVED = ("wn_rad_s", "zeta")
"""The numbers whose shift by a structure or a rate a warning gives, in the order of the shifts."""
LEAST = {"wn_rad_s": 0.005, "zeta": 0.005}
"""The sigma that is left where all structures agree: relative for wn, absolute for zeta."""
LEAST_BY_ROLL = 0.002
"""The same for zeta where roll shows what a closed roll loop hides."""
HIDDEN_ZETA, MOST_HIDDEN = 0.04, 0.11
"""The part of zeta that a closed roll loop may hide where roll does not show it, and the most that
roll may say of it. The loop's own poles are one pair more than a model of three poles has, and in
the yaw rate all structures leave it out alike. Fitted to the linear models of JSBSim's aircraft
with a roll hold, at 20 airspeeds, three poles are .036 of zeta off (RMS), those of a T38 .11."""
SEEN_IN_ROLL, SAME_MODE = 0.2, 1.2
"""Of a fit to roll: the part of roll that its errors stay below, and the factor within which its
pair has the answer's wn."""
SHOWN, UNSEEN = 0.7, 1.5
"""A difference of zeta in roll of fewer sigmas than the first is chance. At least the second times
the answer's sigma of noise may be hidden, up to HIDDEN_ZETA. Both were chosen on 180 flights."""
NEAR_ENOUGH = 1e-9
"""The relative gain in loss that ends these fits: a thousandth of sigma, in half the time."""
SPREAD_MEMORIES, NEWEST = 2.0, 2**13
"""The samples of a stream that are used: the newest two memories, 7 minutes at 20 Hz at most."""


@dataclass(frozen=True, slots=True)
class Opinion:
    """The result of one structure, on a grid ``every`` samples wide.

    ``dutch_roll`` is (wn, wn_std, zeta, zeta_std) with sigmas of noise. ``values`` and ``sigmas``
    hold the numbers of eq. 22-23 by name, and also ``wn_rad_s`` and ``zeta``.
    """

    orders: tuple[int, int, int, int]
    every: int
    dutch_roll: Floats
    values: Mapping[str, float]
    sigmas: Mapping[str, float]
    held_back_pct: float


@dataclass(frozen=True, slots=True)
class Spread:
    """The results of other structures next to an answer, and the scatter of the record's parts.

    ``opinions`` holds the results; ``scatter`` the sigmas from the record's parts, by the names of
    ``Opinion.values``. ``next`` is the richer structure on the same grid, ``slower`` the answer's
    own structure, or a similar one, at a lower rate. ``own`` is the own structure fitted like the
    others, where that fit is not the answer. ``held_back_pct`` is the own structure's fit of held
    back samples in percent. ``is_slow`` says that the verdict may warn of the rate. ``method`` is
    the one that all were fitted by. ``hidden`` is the part of zeta that a roll loop may hide.
    """

    opinions: tuple[Opinion, ...]
    scatter: Mapping[str, float]
    next: Opinion | None = None
    slower: Opinion | None = None
    own: Opinion | None = None
    held_back_pct: float = math.nan
    is_slow: bool = False
    method: str = OF_STRUCTURES
    hidden: float = 0.0

    def around(self, wn: float) -> "Spread":
        """Return it with only those structures that know a mode near wn rad/s to 10 %."""

        def knows(each: Opinion | None) -> bool:
            if each is None:
                return False
            own, sigma = float(each.dutch_roll[0]), float(each.dutch_roll[1])
            return 1.0 / ALIKE < own / wn < ALIKE and sigma < UNCERTAIN_WN * own

        opinions = tuple(each for each in self.opinions if knows(each))
        slower = self.slower if knows(self.slower) else None
        richer = None if self._is_another_mode(wn) else self.next
        return replace(self, opinions=opinions, slower=slower, next=richer)

    def _is_another_mode(self, wn: float) -> bool:
        """Return whether the richer structure found another mode, with a worse held-back fit."""
        if self.next is None or not self.next.held_back_pct < self.held_back_pct - WEIGHT_PCT:
            return False
        own = wn if self.own is None else float(self.own.dutch_roll[0])
        return abs(float(self.next.dutch_roll[0]) - own) > UNCERTAIN_WN * own

    @property
    def weights(self) -> Floats:
        """The structures' weights (n,), 1 for the best and for those without a held-back fit."""
        pct = np.array([each.held_back_pct for each in self.opinions])
        best = np.nanmax(pct, initial=-np.inf)
        weights: Floats = np.where(np.isfinite(pct), np.exp((pct - best) / WEIGHT_PCT), 1.0)
        return weights

    def two_poles(self) -> dict[str, dict[str, float]]:
        """Return the numbers of eq. 22-23 by a fit of two poles; empty where there is none.

        They stand in where the other poles of an answer lie too near the mode to be divided out.
        """
        opinions = [each for each in self.opinions if each.every == 1 and each.orders[:3] == SIMPLE]
        return {
            name: {"value": value, "std": each.sigmas[name]}
            for each in opinions
            for name, value in each.values.items()
            if name not in (*MOVED, *EQUAL)
        }

    def next_moves(self, wn: float, zeta: float) -> Floats:
        """Return how far the next richer structure moves wn and zeta (2,); NaN where unknown.

        It is compared with the own structure; both are fitted by the same method.
        """
        if self.own is not None:
            wn, zeta = self.own.dutch_roll[[0, 2]].tolist()
        return _apart(self.next, wn, zeta)

    def rate_moves(self, wn: float, zeta: float) -> Floats:
        """Return about how far the rate moves wn in rad/s and zeta (2,); NaN where unknown.

        Half the rate adds three times the error that is there already, if that goes with the square
        of the sample interval.
        """
        every = 1 if self.slower is None else self.slower.every
        return _apart(self.slower, wn, zeta) / max(every**2 - 1.0, 1.0)

    def structures_std(self, name: str, value: float) -> float:
        """Return the structures' distance from this value as a sigma, the least one included."""
        pairs = zip(self.weights.tolist(), self.opinions, strict=True)
        known = [(w, each.values[name]) for w, each in pairs if name in each.values]
        total = sum(w for w, _ in known)
        squares = sum(w * (x - value) ** 2 for w, x in known)
        apart = math.sqrt(squares / total) if total > 0.0 else 0.0
        least = LEAST.get(name, 0.0) * (abs(value) if name == "wn_rad_s" else 1.0)
        if name == "zeta" and self.hidden > 0.0:
            least = max(LEAST_BY_ROLL, self.hidden * value)
        return math.hypot(apart, least)

    def beyond(self, name: str, value: float) -> float:
        """Return the part of a value's sigma that noise does not explain.

        For wn and zeta it is at least the shift by a richer structure, or by a higher rate, that a
        warning may state.
        """
        apart = self.structures_std(name, value)
        if name not in MOVED:
            return apart
        moves = self.next_moves(value, value)
        if self.is_slow:
            moves = np.fmax(moves, self.rate_moves(value, value))
        return float(np.fmax(apart, moves[MOVED.index(name)]))

    def total(self, method: str, name: str, value: float, noise: float) -> float:
        """Return the total sigma of a value with this sigma of ``noise``; NaN stays NaN.

        The structures' distance from the value of another method than theirs already contains that
        method's noise, which must not count twice.
        """
        name = EQUAL.get(name, name)
        scatter = self.scatter.get(name, 0.0)
        own = max(noise, scatter) if math.isfinite(scatter) else noise
        apart = self.beyond(name, value)
        if method == self.method:
            return math.hypot(own, apart)
        return max(own, apart) if math.isfinite(own) else own


def _apart(opinion: Opinion | None, wn: float, zeta: float) -> Floats:
    if opinion is None:
        return np.full(2, np.nan)
    return np.asarray(np.abs(opinion.dutch_roll[[0, 2]] - (wn, zeta)))


@lru_cache(maxsize=64)
def _with_orders(
    config: RunConfig, orders: tuple[int, int, int, int], sample_time_s: float
) -> tuple[RunConfig, EstimatorConfig]:
    """Return the configuration with these orders, and its fit by the structures' method.

    All manoeuvres of a run need the same ones, and each is checked when it is made.
    """
    other = replace(config, orders=orders, memory=None, forgetting=1.0)
    fit = other.estimator(OF_STRUCTURES, sample_time_s)
    return replace(config, orders=orders), fit


def _opinion(
    config: RunConfig,
    sample_time_s: float,
    model: FittedModel,
    u: Floats,
    y: Floats,
    every: int,
    method: str,
) -> Opinion | None:
    """Return the result of a fit of the configuration's orders to u (n, inputs) and y (n,).

    None where the fit found no Dutch roll.
    """
    dutch_roll, values, sigmas = _said(config, sample_time_s, model, model.covariance)
    if not np.isfinite(dutch_roll[0]):
        return None
    pct = held_back_pct(model.config, u, y, NEAR_ENOUGH, method)
    return Opinion(config.four_orders, every, dutch_roll, values, sigmas, pct)


def _said(
    config: RunConfig, sample_time_s: float, model: FittedModel, covariance: Floats
) -> tuple[Floats, dict[str, float], dict[str, float]]:
    """Return the Dutch roll (4,), and values and sigmas by name, computed by this covariance."""
    row: EstimateBlock = model.row(covariance)
    mean_output, orders = config.output == "yaw", model.config.orders
    dutch_roll = modes(row, orders, sample_time_s, mean_output=mean_output).dutch_roll[-1]
    physics = summary_of(
        model.theta, covariance, orders, sample_time_s,
        mean_output=mean_output, servo_tau_s=config.servo_tau,
    )  # fmt: skip
    physics.pop(REDUCTION_ERROR, None)
    wn, wn_std, zeta, zeta_std = dutch_roll.tolist()
    values = {name: each["value"] for name, each in physics.items()}
    sigmas = {name: each["std"] for name, each in physics.items()}
    values |= {"wn_rad_s": wn, "zeta": zeta}
    return dutch_roll, values, sigmas | {"wn_rad_s": wn_std, "zeta": zeta_std}


NOTHING_KNOWN = Spread((), {})


def spread_of(
    config: RunConfig,
    sample_time_s: float,
    u: Floats,
    y: Floats,
    wn: float,
    answer: FittedModel | None = None,
    held_back: float = math.nan,
    method: str = OF_STRUCTURES,
) -> Spread:
    """Return the spread around an answer of wn rad/s, from the samples u (n, inputs) and y (n,).

    ``answer`` is the fit of the configuration's own orders to these samples, if that is the answer,
    and ``held_back`` its held-back fit in percent. If it is not, that fit is one more structure.
    All structures are fitted by ``method`` and have the own nk, which is converted to the coarse
    grid.
    """
    others, orders = partial(_others, config, sample_time_s, u, y, method), config.four_orders[:3]
    every = round(2.0 * math.pi / (wn * sample_time_s * COARSE_PER_PERIOD))
    richer = others([AFTER_NEXT if orders == NEXT else NEXT], 1)
    if every > 1:
        # A free run hardly distinguishes five poles from four, and takes long to find them.
        coarse = others(COARSE if method == OF_STRUCTURES else COARSE[:2], every)
        opinions = [*others([SIMPLE], 1), *richer, *coarse]
        slower = [each for each in coarse if each.orders[:3] == orders] or coarse
    else:
        opinions = [
            *richer,
            *others(sorted({SIMPLE, *COARSE} - {each.orders[:3] for each in richer}), 1),
        ]
        slower = others([orders], 2)
    own, own_opinion = answer, None
    if own is None:
        _, settings = _with_orders(config, config.four_orders, sample_time_s)
        own = fit_record(settings, u, y, NEAR_ENOUGH, method)
        own_opinion = _opinion(config, sample_time_s, own, u, y, 1, method)
    if own_opinion is not None:
        opinions, held_back = [*opinions, own_opinion], own_opinion.held_back_pct
    _, _, scatter = _said(config, sample_time_s, own, own.scatter)
    return Spread(
        tuple(opinions), scatter, next(iter(richer), None), next(iter(slower), None), own_opinion,
        held_back, _is_slow(config, sample_time_s, wn), method,
    )  # fmt: skip


def hidden_share(
    config: RunConfig,
    sample_time_s: float,
    u: Floats,
    roll: Floats,
    dutch_roll: Floats,
    method: str,
) -> float:
    """Return the part of zeta that a closed roll loop hides from the yaw rate, as roll shows it.

    Yaw rate and roll have the same poles. Roll swings far with the loop's own pair, so that a fit
    of two pairs to ``roll`` (n,) in rad and ``u`` (n, inputs) finds both even where they are near
    each other. How far its zeta is from that of the answer ``dutch_roll`` (4,), whose sigmas are of
    noise, is what the answer's structure leaves out. Where roll has no such pair it is HIDDEN_ZETA.
    """
    _, settings = _with_orders(config, (*NEXT, config.four_orders[3]), sample_time_s)
    model = fit_record(settings, u, roll, NEAR_ENOUGH, method)
    wn, _, zeta, noise = dutch_roll.tolist()
    own = wn * complex(-zeta, math.sqrt(max(1.0 - zeta**2, 0.0)))
    found, scatter = (
        modes(model.row(each), model.config.orders, sample_time_s)
        for each in (model.covariance, model.scatter)
    )
    pairs = np.flatnonzero(found.poles[0].imag > 0.0)
    if not len(pairs) or not model.innovation_std < SEEN_IN_ROLL * np.nanstd(roll):
        return HIDDEN_ZETA
    pair = int(pairs[np.argmin(np.abs(np.log(found.poles[0, pairs] / own)))])
    if not 1.0 / SAME_MODE < found.wn[0, pair] / wn < SAME_MODE:
        return HIDDEN_ZETA
    apart = abs(float(found.zeta[0, pair]) - zeta)
    sigma = float(np.fmax(found.zeta_std[0, pair], scatter.zeta_std[0, pair]))
    shown = min(apart / zeta, MOST_HIDDEN) if apart > SHOWN * sigma else 0.0
    return float(max(shown, min(UNSEEN * noise / zeta, HIDDEN_ZETA)))


def seen_in(orders: Orders, sample_time_s: float, u: Floats, y: Floats) -> Floats:
    """Return wn in rad/s and zeta (2,) that a model of these orders sees; NaN without.

    It is the one nearest in output error to the yaw rate ``y`` (n,) of the rudder ``u`` (n, 1).
    """
    of = ArmaxOrders(orders.na, (orders.nb,), orders.nc, (orders.nk,))
    settings = EstimatorConfig(orders=of, sample_time_s=sample_time_s)
    model = fit_record(settings, u, y, NEAR_ENOUGH, IN_CALM_AIR)
    return dutch_roll_of(model.theta, of, sample_time_s)


def _is_slow(config: RunConfig, sample_time_s: float, wn: float) -> bool:
    """Return whether the verdict may warn of the rate.

    A rate that was given always may be warned of, since the messages' own may be lower.
    """
    needed_hz = max(LOW_RATE_HZ, LOW_RATIO * wn / (2.0 * math.pi))
    return config.binds("rate") or needed_hz * sample_time_s > RATE_SLACK


def _others(
    config: RunConfig,
    sample_time_s: float,
    u: Floats,
    y: Floats,
    method: str,
    structures: Iterable[tuple[int, int, int]],
    every: int,
) -> list[Opinion]:
    """Return the results of these structures on a grid ``every`` times as wide.

    The own structure is left out on the run's grid.
    """
    nk = (config.four_orders[3] - 1) // every + 1
    if every > 1:
        u, y = coarser(u, y, every, mean_output=config.output == "yaw")
    sample_time_s *= every
    found = []
    for each in structures:
        other, settings = _with_orders(config, (*each, nk), sample_time_s)
        if every > 1 or other.orders != config.orders:
            model = fit_record(settings, u, y, NEAR_ENOUGH, method)
            found.append(_opinion(other, sample_time_s, model, u, y, every, method))
    return [each for each in found if each is not None]


def coarser(u: Floats, y: Floats, every: int, *, mean_output: bool) -> tuple[Floats, Floats]:
    """Return the channels on a grid ``every`` times as wide: u (m, inputs) and y (m,).

    u(k) is the mean over the interval that follows t_k. y(k) is the value at t_k or, with
    ``mean_output``, the mean over the interval before it. One held sample (NaN) makes such a mean
    NaN too.
    """
    m = len(y) // every
    u = u[: m * every].reshape(m, every, u.shape[1]).mean(axis=1)
    if not mean_output:
        return u, y[: m * every : every]
    before = np.concatenate([np.full(every - 1, np.nan), y])[: m * every]
    return u, before.reshape(m, every).mean(axis=1)
