"""The part of sigma that noise does not explain: what other structures say of the same samples.

Sigma of a fit tells how far noise moves it, if the structure is right. It never is: the roll and
its loop, the rudder's servo and the air are left out, and each structure bends to them in its own
way. So a few others are fitted to the same samples, two of them on the same grid and three on a
coarser one, of twelve samples a period: a fine grid weighs fast misfit, a coarse one slow misfit,
and measured over JSBSim's aircraft the two differ about as much as either is wrong. Each counts by
how well it tells what was held back. The model average's variance (Buckland and others 1997) is
that of noise and the weighted square of the distances from the answer.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from yawid.blocks import EstimateBlock, Floats
from yawid.config.estimator import EstimatorConfig
from yawid.config.run import RATE_SLACK, RunConfig
from yawid.estimation.methods import OF_STRUCTURES
from yawid.estimation.record_fit import FittedModel, fit_record, held_back_pct
from yawid.physics.derivatives import summary_of
from yawid.physics.modes import modes
from yawid.quantities.table import REDUCTION_ERROR
from yawid.results.judge_samples import LOW_RATE_HZ, LOW_RATIO, UNCERTAIN_WN

NEXT, AFTER_NEXT = (4, 4, 3), (5, 5, 4)
"""The structure (na, nb, nc) that tells on the same grid what a richer one says; the second where
the first answers."""
SIMPLE, COARSE = (2, 2, 2), ((3, 3, 2), NEXT, AFTER_NEXT)
COARSE_PER_PERIOD = 12
ALIKE = 2.0
"""A structure whose wn differs by more than this factor found another mode."""
WEIGHT_PCT = 3.0
"""Points of the held-back fit that cost a structure all but 1/e of its weight."""
EQUAL = {"omega_beta": "wn_rad_s", "xi_beta": "zeta"}
"""Names of eq. 23 for the Dutch roll's own numbers: they have its sigmas. Not every structure's
model is a yaw channel."""
MOVED = ("wn_rad_s", "zeta")
"""What a warning says a structure or a rate moves, in the order of a Dutch roll's numbers."""
LEAST = {"wn_rad_s": 0.005, "zeta": 0.005}
"""What is left where all structures agree: of wn in proportion, of zeta as it stands."""
NEAR_ENOUGH = 1e-9
"""The relative gain in loss that ends these fits: a thousandth of sigma, in half the time."""
SPREAD_MEMORIES, NEWEST = 2.0, 2**13
"""Of a stream the newest two memories are looked at, 7 minutes at 20 Hz at most."""


@dataclass(frozen=True, slots=True)
class Opinion:
    """What one structure says, on a grid ``every`` samples wide.

    ``dutch_roll`` is (wn, wn_std, zeta, zeta_std) with sigmas of noise; ``values`` and ``sigmas``
    are those of eq. 22-23 by name, and of ``wn_rad_s`` and ``zeta``.
    """

    orders: tuple[int, int, int, int]
    every: int
    dutch_roll: Floats
    values: Mapping[str, float]
    sigmas: Mapping[str, float]
    held_back_pct: float


@dataclass(frozen=True, slots=True)
class Spread:
    """What is known beside the answer: other structures, and how much the record's parts scatter.

    ``scatter`` has the sigma that its parts tell, by the names of ``Opinion.values``; ``next`` is
    the richer structure on the same grid, ``slower`` the own one, or one like it, at a lower rate.
    ``own`` is the own structure fitted as the others are, where that is not the answer, and
    ``held_back_pct`` how much it explains of what was held back; ``is_slow`` says that the rate is
    one that may be warned of.
    """

    told: tuple[Opinion, ...]
    scatter: Mapping[str, float]
    next: Opinion | None = None
    slower: Opinion | None = None
    own: Opinion | None = None
    held_back_pct: float = math.nan
    is_slow: bool = False

    def around(self, wn: float) -> "Spread":
        """Return what tells of a mode of wn rad/s, and knows it itself."""

        def tells(each: Opinion | None) -> bool:
            if each is None:
                return False
            own, sigma = float(each.dutch_roll[0]), float(each.dutch_roll[1])
            return 1.0 / ALIKE < own / wn < ALIKE and sigma < UNCERTAIN_WN * own

        told = tuple(each for each in self.told if tells(each))
        slower = self.slower if tells(self.slower) else None
        richer = None if self._is_another_mode(wn) else self.next
        return replace(self, told=told, slower=slower, next=richer)

    def _is_another_mode(self, wn: float) -> bool:
        """Tell whether the next structure learned another mode: held-back samples say so."""
        if self.next is None or not self.next.held_back_pct < self.held_back_pct - WEIGHT_PCT:
            return False
        own = wn if self.own is None else float(self.own.dutch_roll[0])
        return abs(float(self.next.dutch_roll[0]) - own) > UNCERTAIN_WN * own

    @property
    def weights(self) -> Floats:
        """The structures' weights (n,), 1 for the best; what held nothing back counts fully."""
        pct = np.array([each.held_back_pct for each in self.told])
        best = np.nanmax(pct, initial=-np.inf)
        weights: Floats = np.where(np.isfinite(pct), np.exp((pct - best) / WEIGHT_PCT), 1.0)
        return weights

    def next_moves(self, wn: float, zeta: float) -> Floats:
        """Return how far the next richer structure moves wn and zeta (2,); NaN where unknown.

        It is compared with the own one, both fitted by the same method.
        """
        if self.own is not None:
            wn, zeta = self.own.dutch_roll[[0, 2]].tolist()
        return _apart(self.next, wn, zeta)

    def rate_moves(self, wn: float, zeta: float) -> Floats:
        """Return how far about the rate moves wn in rad/s and zeta (2,); NaN where unknown.

        Of an error that goes with the square of the interval half the rate adds three times as
        much.
        """
        every = 1 if self.slower is None else self.slower.every
        return _apart(self.slower, wn, zeta) / max(every**2 - 1.0, 1.0)

    def structures_std(self, name: str, value: float) -> float:
        """Return how far the structures are from this value, as a sigma; at least the least one."""
        pairs = zip(self.weights.tolist(), self.told, strict=True)
        known = [(w, each.values[name]) for w, each in pairs if name in each.values]
        total = sum(w for w, _ in known)
        squares = sum(w * (x - value) ** 2 for w, x in known)
        apart = math.sqrt(squares / total) if total > 0.0 else 0.0
        share = abs(value) if name == "wn_rad_s" else 1.0
        return math.hypot(apart, LEAST.get(name, 0.0) * share)

    def beyond(self, name: str, value: float) -> float:
        """Return the sigma of a value that noise does not explain.

        That of wn and zeta is at least what a warning may say that a richer structure or a higher
        rate moves.
        """
        apart = self.structures_std(name, value)
        if name not in MOVED:
            return apart
        moves = self.next_moves(value, value)
        if self.is_slow:
            moves = np.fmax(moves, self.rate_moves(value, value))
        return float(np.fmax(apart, moves[MOVED.index(name)]))

    def total(self, method: str, name: str, value: float, noise: float) -> float:
        """Return the total sigma of a value whose sigma of noise is known; NaN stays NaN.

        How far the structures are from what another method than theirs says has its noise in it,
        which must not count twice.
        """
        name = EQUAL.get(name, name)
        scatter = self.scatter.get(name, 0.0)
        own = max(noise, scatter) if math.isfinite(scatter) else noise
        apart = self.beyond(name, value)
        if method == OF_STRUCTURES:
            return math.hypot(own, apart)
        return max(own, apart) if math.isfinite(own) else own


def _apart(told: Opinion | None, wn: float, zeta: float) -> Floats:
    if told is None:
        return np.full(2, np.nan)
    return np.asarray(np.abs(told.dutch_roll[[0, 2]] - (wn, zeta)))


def _forgetting_nothing(config: RunConfig, sample_time_s: float) -> EstimatorConfig:
    """Return the structures' method of the configuration's orders, every sample counting alike."""
    return replace(config, memory=None, forgetting=1.0).estimator(OF_STRUCTURES, sample_time_s)


def _told(
    config: RunConfig, sample_time_s: float, model: FittedModel, u: Floats, y: Floats, every: int
) -> Opinion | None:
    """Return what a fit of the configuration's orders to u (n, inputs) and y (n,) says.

    None where it found no Dutch roll.
    """
    dutch_roll, values, sigmas = _said(config, sample_time_s, model, model.covariance)
    if not np.isfinite(dutch_roll[0]):
        return None
    pct = held_back_pct(model.config, u, y, NEAR_ENOUGH)
    return Opinion(config.four_orders, every, dutch_roll, values, sigmas, pct)


def _said(
    config: RunConfig, sample_time_s: float, model: FittedModel, covariance: Floats
) -> tuple[Floats, dict[str, float], dict[str, float]]:
    """Return the Dutch roll (4,), all values and all sigmas by name, with this covariance."""
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
) -> Spread:
    """Return what is known of the samples u (n, inputs) and y (n,) beside an answer of wn rad/s.

    ``answer`` is the fit of the configuration's own orders over them, if that is the answer, with
    its held-back fit in %: where it is not, it is one more structure. The others have the same nk.
    """
    tell, orders = partial(_others, config, sample_time_s, u, y), config.four_orders[:3]
    every = round(2.0 * math.pi / (wn * sample_time_s * COARSE_PER_PERIOD))
    richer = tell([AFTER_NEXT if orders == NEXT else NEXT], 1)
    if every > 1:
        coarse = tell(COARSE, every)
        told = [*tell([SIMPLE], 1), *richer, *coarse]
        slower = [each for each in coarse if each.orders[:3] == orders] or coarse
    else:
        told = [*richer, *tell(sorted({SIMPLE, *COARSE} - {each.orders[:3] for each in richer}), 1)]
        slower = tell([orders], 2)
    own, own_told = answer, None
    if own is None:
        own = fit_record(_forgetting_nothing(config, sample_time_s), u, y, NEAR_ENOUGH)
        own_told = _told(config, sample_time_s, own, u, y, 1)
    if own_told is not None:
        told, held_back = [*told, own_told], own_told.held_back_pct
    _, _, scatter = _said(config, sample_time_s, own, own.scatter)
    return Spread(
        tuple(told), scatter, next(iter(richer), None), next(iter(slower), None), own_told,
        held_back, _is_slow(config, sample_time_s, wn),
    )  # fmt: skip


def _is_slow(config: RunConfig, sample_time_s: float, wn: float) -> bool:
    """Tell whether the verdict may warn of the rate, which is the messages' unless it was given."""
    needed_hz = max(LOW_RATE_HZ, LOW_RATIO * wn / (2.0 * math.pi))
    return config.binds("rate") or needed_hz * sample_time_s > RATE_SLACK


def _others(
    config: RunConfig,
    sample_time_s: float,
    u: Floats,
    y: Floats,
    structures: Iterable[tuple[int, int, int]],
    every: int,
) -> list[Opinion]:
    """Return what these structures say, on a grid that is so many times as wide; not the own."""
    nk = (config.four_orders[3] - 1) // every + 1
    if every > 1:
        u, y = coarser(u, y, every, mean_output=config.output == "yaw")
    sample_time_s *= every
    found = []
    for each in structures:
        other = replace(config, orders=(*each, nk))
        if every > 1 or other.orders != config.orders:
            model = fit_record(_forgetting_nothing(other, sample_time_s), u, y, NEAR_ENOUGH)
            found.append(_told(other, sample_time_s, model, u, y, every))
    return [each for each in found if each is not None]


def coarser(u: Floats, y: Floats, every: int, *, mean_output: bool) -> tuple[Floats, Floats]:
    """Return the channels of a grid ``every`` times as wide: u (m, inputs) and y (m,).

    u(k) is the mean over the interval that follows t_k, y(k) stands at t_k, or is the mean over the
    interval before (``mean_output``). A held sample holds the whole interval.
    """
    m = len(y) // every
    u = u[: m * every].reshape(m, every, u.shape[1]).mean(axis=1)
    if not mean_output:
        return u, y[: m * every : every]
    before = np.concatenate([np.full(every - 1, np.nan), y])[: m * every]
    return u, before.reshape(m, every).mean(axis=1)
