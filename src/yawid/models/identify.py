"""The models of a run: of a manoeuvre, of the flight, and of the bare airframe (``LinearModel``).

The yaw channel is in observer form: the first state is the yaw rate, each further one a sum of
earlier samples or of derivatives, and the elements of A and B are the coefficients themselves. The
bare airframe has the states of :mod:`yawid.lateral.model`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy import signal

from yawid.answers.run_summary import Bare, Manoeuvre, RunSummary, VerdictSummary
from yawid.blocks import Floats, SampleBlock
from yawid.config.estimator import ArmaxOrders
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, NotIdentifiable
from yawid.models.draws import drawn_aircraft, few, fits, pole_of
from yawid.models.fitted import Model
from yawid.models.linear import Form, LinearModel, Matrices, Signal, slopes_of
from yawid.models.refit import Rows
from yawid.physics.continuous import Transfer, transfer
from yawid.physics.derivatives import numerator_polynomial
from yawid.quantities.airspeed import GRAVITY
from yawid.quantities.units import HALF_TRAVEL, unit_of_derivative

HELD, MEAN = "held", "mean"
OF_NOISE, TOTAL = "of noise alone", "total"
_OUTPUT = Signal("r", "rad/s")
_STATES = (Signal("beta", "rad"), Signal("p", "rad/s"), _OUTPUT, Signal("roll", "rad"))


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run: its summary and configuration, its samples in blocks, the vehicle's parameters."""

    summary: RunSummary
    config: RunConfig
    sample_time_s: float
    samples: Iterable[SampleBlock]
    parameters: Mapping[str, float]

    @property
    def held(self) -> bool:
        """Whether the models' input is held: fits take off what means spread of a command."""
        return self.config.rudder_is == "commanded"

    @property
    def input_is(self) -> str:
        """How the record has the rudder, see :class:`LinearModel`.

        It is held from sample to sample where it is commanded and was logged as often. Any other
        one moved between the samples, which have its mean.
        """
        rudder = self.summary.channels.get("rudder")
        rate_hz = None if rudder is None else rudder.rate_hz
        return HELD if self.held and (rate_hz or np.inf) * self.sample_time_s < 1.02 else MEAN

    def rows(self, manoeuvres: Sequence[Manoeuvre]) -> list[Rows]:
        """Return the samples of manoeuvres, in one pass over those of the run."""
        found = [Rows(each) for each in manoeuvres]
        for block in self.samples:
            for each in found:
                each.add(block)
        return found

    def inputs(self, names: Sequence[str]) -> tuple[Signal, ...]:
        """Return inputs with their units."""
        return tuple(
            Signal(n, self.config.unit_of_rudder if n == "rudder" else HALF_TRAVEL) for n in names
        )


def model_of(run: Recorded, which: int | str) -> LinearModel:
    """Return the model of manoeuvre n, of the ``flight``, or of the ``bare`` airframe.

    Raises:
        ConfigError: there is no such manoeuvre, or the model's output is no yaw rate.
        NotIdentifiable: there is no answer of it.
    """
    if which == "bare":
        return _bare(run)
    if run.config.output != "yaw-rate":
        raise ConfigError(f"a model is that of the yaw rate, and the output is {run.config.output}")
    if which == "flight":
        return _flight(run)
    found = next((m for m in run.summary.manoeuvres or () if m.n == which), None)
    if found is None:
        numbers = ", ".join(str(each.n) for each in run.summary.manoeuvres or ()) or "none"
        has = f"a model is that of flight, bare or a manoeuvre ({numbers})"
        raise ConfigError(f"there is no model of {which!r}: {has}")
    return _manoeuvre(run, found)


def _manoeuvre(run: Recorded, found: Manoeuvre) -> LinearModel:
    [rows] = run.rows([found])
    drawn = rows.drawn(run.config, run.sample_time_s)
    if drawn is None:
        raise NotIdentifiable(f"manoeuvre {found.n} has no answer: {_why(found.verdict)}")
    model, inputs = drawn.model, run.inputs(found.inputs)
    discrete = _of_theta(model, inputs)
    delay_s = (model.orders.nk[0] - 1) * model.sample_time_s
    to_s = partial(
        _continuous_of, orders=model.orders, sample_time_s=model.sample_time_s, held=run.held
    )
    values, slopes = to_s(discrete.values), slopes_of(to_s, discrete.values, discrete.std)
    continuous = _observer(values, slopes @ discrete.covariance @ slopes.T, inputs)
    if not run.held:  # theta's own input is the mean of a measured rudder
        discrete = _sampled(continuous, model.sample_time_s, model.orders.nk[0] - 1)
    return LinearModel(
        of=f"manoeuvre {found.n}", **_judged(found.verdict), sigma_is=OF_NOISE,
        input_is=run.input_is,
        continuous=continuous, discrete=discrete, inputs=inputs,
        outputs=(_OUTPUT,), states=_chain(continuous),
        delay_s=delay_s, measured=drawn.judged, facts=_airspeed(found.airspeed_m_s),
    )  # fmt: skip


def _flight(run: Recorded) -> LinearModel:
    flight = run.summary.flight
    if flight is None or flight.dutch_roll is None:
        why = _why(run.summary.deciding) or "no manoeuvre was found"
        raise NotIdentifiable(f"the flight has no answer: {why}")
    if flight.airspeed_m_s is None:
        raise NotIdentifiable("the airspeed is not known: take the model of one manoeuvre")
    used = [each for each in run.summary.manoeuvres or () if each.n in flight.used]
    if flight.orders is None:
        raise NotIdentifiable(
            "the manoeuvres have different orders: take the model of one, or replay with --orders"
        )
    orders = list(flight.orders.to_json().values())
    own = fits(run.config, run.sample_time_s, run.rows(few(used)), orders)
    pairs = [(each.model, speed) for each, speed in own]
    aircraft = drawn_aircraft(flight, pairs, (), held=run.held)
    if aircraft is None:
        raise NotIdentifiable("the manoeuvres, fitted again, do not give the flight's answer")
    draws = [_polynomials(aircraft.G, i) for i in range(len(aircraft.G))]
    wn, zeta = flight.dutch_roll.wn_rad_s, flight.dutch_roll.zeta
    pole = pole_of(wn, np.array([zeta]))
    to_s = partial(transfer, held=run.held)
    there = [to_s(m.theta[None], m.orders, m.sample_time_s).faster(flight.airspeed_m_s / at)
             for m, at in pairs]  # fmt: skip
    scaled = [_polynomials(each.with_pair(pole), 0) for each in there]
    n = max(len(each) for each in scaled)
    values = np.mean([each for each in scaled if len(each) == n], axis=0)
    some = np.array([each for each in draws if len(each) == n])
    inputs = run.inputs(("rudder",))
    continuous = _observer(values, np.cov(some.T), inputs)
    delay = pairs[0][0].orders.nk[0] - 1
    return LinearModel(
        of="flight", **_judged(flight.verdict), sigma_is=TOTAL, input_is=run.input_is,
        continuous=continuous, inputs=inputs,
        discrete=_sampled(continuous, run.sample_time_s, delay),
        outputs=(_OUTPUT,), states=_chain(continuous),
        delay_s=delay * run.sample_time_s,
        facts=_airspeed(flight.airspeed_m_s),
    )  # fmt: skip


def _polynomials(G: Transfer, row: int) -> Floats:
    """Return the coefficients of den and num without the leading 1, highest power first (2n,)."""
    kept = G.residues[row] != 0.0
    p, residues = G.poles[row][kept], G.residues[row][kept]
    num = numerator_polynomial(p[None], residues[None])[0][::-1]
    return np.concatenate([np.real(np.poly(p))[1:], num])


def _bare(run: Recorded) -> LinearModel:
    bare = run.summary.bare
    if bare is None or not bare or bare.derivatives is None or bare.airspeed_m_s is None:
        why = "replay the log with --lateral auto" if bare is None else _why(bare.verdict)
        raise NotIdentifiable(f"the bare airframe is not known: {why}")
    if bare.alpha_rad is None or bare.correlations is None:
        raise NotIdentifiable("the file is of an older version: replay the log with --lateral auto")
    known = {**bare.derivatives, "alpha_rad": bare.alpha_rad}
    names = tuple(known)
    values = np.array([each.value for each in known.values()], float)
    std = np.array([each.std or 0.0 for each in known.values()])
    covariance = np.array(bare.correlations)[: len(names), : len(names)] * np.outer(std, std)
    inputs = run.inputs(("aileron", "rudder"))
    matrices = partial(_airframe, names=names, airspeed_m_s=bare.airspeed_m_s)
    units = (
        *(unit_of_derivative(each, run.config.unit_of_rudder) for each in bare.derivatives),
        "rad",
    )
    continuous = Form(names, units, values, covariance, matrices)
    lag = {} if bare.servo_lag_s is None else {"servo_lag_s": bare.servo_lag_s.value or 0.0}
    return LinearModel(
        of="bare airframe", **_judged(bare.verdict), sigma_is=TOTAL, input_is=MEAN,
        continuous=continuous,
        discrete=_sampled(continuous, run.sample_time_s), inputs=inputs, outputs=_STATES,
        states=_STATES, facts=_airspeed(bare.airspeed_m_s) | lag,
        from_prior=tuple(bare.from_prior or ()),
    )  # fmt: skip


def _airframe(values: Floats, names: Sequence[str], airspeed_m_s: float) -> Matrices:
    """Return the matrices of the bare airframe; inputs are the deflections after the servos."""
    of = dict.fromkeys(Bare.NAMES, 0.0) | dict(zip(names, values.tolist(), strict=True))
    alpha = of["alpha_rad"]
    A = np.array([
        [of["Y_beta"], alpha, -1.0, GRAVITY / airspeed_m_s * np.cos(alpha)],
        [of["L_beta"], of["L_p"], of["L_r"], 0.0],
        [of["N_beta"], of["N_p"], of["N_r"], 0.0],
        [0.0, 1.0, np.tan(alpha), 0.0],
    ])  # fmt: skip
    columns = ((0.0, "L_delta_a", "N_delta_a"), ("Y_delta_r", "L_delta_r", "N_delta_r"))
    B = np.array([[of[n] if isinstance(n, str) else n for n in each] + [0.0] for each in columns]).T
    return A, B, np.eye(4), np.zeros((4, 2))


def _sampled(continuous: Form, sample_time_s: float, delay: int = 0) -> Form:
    """Return the form with the inputs held from sample to sample, ``delay`` samples late."""

    def matrices(values: Floats) -> Matrices:
        A, B, C, D, _ = signal.cont2discrete(continuous.matrices(values), sample_time_s)
        for _ in range(delay):  # the input of one sample before becomes a state
            n, m = B.shape
            A = np.block([[A, B], [np.zeros((m, n + m))]])
            B, C = np.vstack([np.zeros((n, m)), np.eye(m)]), np.hstack([C, D])
            D = np.zeros_like(D)
        return A, B, C, D

    return Form(
        continuous.names, continuous.units, continuous.values, continuous.covariance, matrices,
        sample_time_s,
    )  # fmt: skip


def _of_theta(model: Model, inputs: Sequence[Signal]) -> Form:
    """Return a manoeuvre's own coefficients as the discrete form."""
    orders, p = model.orders, model.orders.na + sum(model.orders.nb)
    names = [f"a{i + 1}" for i in range(orders.na)]
    units = ["1"] * orders.na
    for each, nb in zip(inputs, orders.nb, strict=True):
        names += [f"b{i + 1}_{each.name}" for i in range(nb)]
        units += [f"rad/s per {each.unit}"] * nb
    return Form(
        tuple(names), tuple(units), model.theta[:p], model.covariance[:p, :p],
        partial(_discrete, orders=orders), model.sample_time_s,
    )  # fmt: skip


def _discrete(theta: Floats, orders: ArmaxOrders) -> Matrices:
    lags = [nb + nk - 1 for nb, nk in zip(orders.nb, orders.nk, strict=True)]
    n = max(orders.na, *lags)
    A, B = np.eye(n, k=1), np.zeros((n, len(orders.nb)))
    A[: orders.na, 0] = -theta[: orders.na]
    first = orders.na
    for i, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        B[nk - 1 : nk - 1 + nb, i] = theta[first : first + nb]
        first += nb
    return A, B, np.eye(1, n), np.zeros((1, len(orders.nb)))


def _continuous_of(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float, *, held: bool
) -> Floats:
    """Return the coefficients of den, then of each input's num, without leading zeros (m,)."""
    found: list[Floats] = []
    lags, first = None, orders.na
    for nb, nk in zip(orders.nb, orders.nk, strict=True):
        one = ArmaxOrders(na=orders.na, nb=(nb,), nc=0, nk=(nk,))
        both = np.concatenate([theta[: orders.na], theta[first : first + nb]])
        try:
            G = transfer(both[None], one, sample_time_s, held=held, lags=lags)
        except ValueError as error:
            raise NotIdentifiable(f"there is no continuous model: {error}") from error
        lags, coefficients = G.poles, _polynomials(G, 0)
        found.append(coefficients if not found else coefficients[len(coefficients) // 2 :])
        first += nb
    return np.concatenate(found)


def _observer(values: Floats, covariance: Floats, inputs: Sequence[Signal]) -> Form:
    """Return the continuous form of den and num coefficients, n for each."""
    n = len(values) // (1 + len(inputs))
    names, units = [f"den_s{n - 1 - i}" for i in range(n)], [_power(i + 1) for i in range(n)]
    for each in inputs:
        names += [f"num_s{n - 1 - i}_{each.name}" for i in range(n)]
        units += [f"rad/s^{i + 2} per {each.unit}" for i in range(n)]

    def matrices(v: Floats) -> Matrices:
        A, B = np.eye(n, k=1), v[n:].reshape(len(inputs), n).T
        A[:, 0] = -v[:n]
        return A, B, np.eye(1, n), np.zeros((1, len(inputs)))

    return Form(tuple(names), tuple(units), values, covariance, matrices)


def _power(i: int) -> str:
    return "1/s" if i == 1 else f"1/s^{i}"


def _chain(form: Form) -> tuple[Signal, ...]:
    n = sum(name.startswith("den") for name in form.names)
    further = (Signal(f"x{i + 1}", f"rad/s^{i + 1}") for i in range(1, n))
    return (_OUTPUT, *further)


def _airspeed(airspeed_m_s: float | None) -> dict[str, float]:
    return {} if airspeed_m_s is None else {"airspeed_m_s": airspeed_m_s}


def _judged(verdict: VerdictSummary) -> dict[str, Any]:
    return {"usable": verdict.usable, "reasons": tuple(str(each) for each in verdict.reasons)}


def _why(verdict: VerdictSummary) -> str:
    return "; ".join(str(each) for each in verdict.fatal or verdict.reasons)
