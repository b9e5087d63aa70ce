"""The models of a run: of a manoeuvre, of the flight, and of the bare airframe (``LinearModel``).

The yaw channel is in observer form: the first state is the yaw rate, each further one a sum of
derivatives, and the elements of A and B are the coefficients themselves. A manoeuvre's are those of
its answer's poles and residues, whose covariance the delta method takes over. The flight's are the
mean of its manoeuvres' in one form, and their covariance is that of the flight's draws. The
bare airframe has the states of :mod:`yawid.lateral.model`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import HIGHEST, LOWEST, Flight, Manoeuvre, RunSummary
from yawid.blocks import Floats, SampleBlock
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, NotIdentifiable
from yawid.lateral.model import NAMES, airframe
from yawid.models.answered import Answered, changes_of, why_not
from yawid.models.draws import drawn_aircraft
from yawid.models.flown import Flown
from yawid.models.linear import Form, LinearModel, Matrices, Signal
from yawid.physics.continuous import Transfer
from yawid.quantities.units import HALF_TRAVEL, unit_of_derivative

HELD, MEAN = "held", "mean"
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
    def input_is(self) -> str:
        """How the record has the rudder, see :class:`LinearModel`.

        It is held from sample to sample where it is commanded and was logged as often. Any other
        one moved between the samples, which have its mean.
        """
        rudder = self.summary.channels.get("rudder")
        rate_hz = None if rudder is None else rudder.rate_hz
        commanded = self.config.rudder_is == "commanded"
        return HELD if commanded and (rate_hz or np.inf) * self.sample_time_s < 1.02 else MEAN

    def flown(self, manoeuvres: Sequence[Manoeuvre]) -> list[Flown]:
        """Return the manoeuvres that have samples, with these."""
        if not (blocks := list(self.samples)):
            return []
        samples = SampleBlock.joined(blocks)
        found = (Flown.of(each, samples, self.config) for each in manoeuvres)
        return [each for each in found if each is not None]

    @property
    def used(self) -> list[Manoeuvre]:
        """The manoeuvres that the flight's answer uses."""
        of = () if self.summary.flight is None else self.summary.flight.used
        return [each for each in self.summary.manoeuvres or () if each.n in of]

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
    return model_of_answer(run, Answered.of(found), next(iter(run.flown([found])), None))


def model_of_answer(run: Recorded, model: Answered, flown: Flown | None) -> LinearModel:
    """Return the model of a manoeuvre's answer, ``flown`` being its samples."""
    values = _coefficients(model, model.x)
    changes = changes_of(partial(_coefficients, model), model.x, model.covariance)
    flown = None if flown is None else flown.with_model(model)
    of, wn = f"manoeuvre {model.found.n}", float(model.x[0])
    return _observer(
        run, of, model.found, model.inputs, wn, values, changes @ changes.T, measured=flown
    )


def _flight(run: Recorded) -> LinearModel:
    flight = run.summary.flight
    if flight is None or flight.dutch_roll is None:
        why = why_not(run.summary.deciding) or "no manoeuvre was found"
        raise NotIdentifiable(f"the flight has no answer: {why}")
    aircraft = drawn_aircraft(flight, [Answered.of(each) for each in run.used])
    if aircraft is None:
        raise NotIdentifiable("the airspeed is not known: take the model of one manoeuvre")
    values, wn = _polynomials(aircraft.central)[0], flight.dutch_roll.wn_rad_s
    apart = _polynomials(aircraft.alike) - values
    return _observer(run, "flight", flight, ("rudder",), wn, values, apart.T @ apart / len(apart))


def _observer(
    run: Recorded,
    of: str,
    answer: Manoeuvre | Flight,
    names: Sequence[str],
    wn_rad_s: float,
    values: Floats,
    covariance: Floats,
    measured: Flown | None = None,
) -> LinearModel:
    """Return the model of the yaw rate with den and num coefficients, n for each, as ``values``."""
    inputs, speed = run.inputs(names), answer.airspeed_m_s
    n = len(values) // (1 + len(inputs))
    powers = [f"s{n - 1 - i}" for i in range(n)]
    units = ["1/s", *(f"1/s^{i + 1}" for i in range(1, n))]
    units += [f"rad/s^{i + 2} per {each.unit}" for each in inputs for i in range(n)]

    def matrices(v: Floats) -> Matrices:
        A, B = np.eye(n, k=1), v[n:].reshape(len(inputs), n).T
        A[:, 0] = -v[:n]
        return A, B, np.eye(1, n), np.zeros((1, len(inputs)))

    coefficients = [f"den_{power}" for power in powers]
    coefficients += [f"num_{power}_{each.name}" for each in inputs for power in powers]
    return LinearModel(
        of=of, **_judged(answer.verdict), input_is=run.input_is,
        continuous=Form(tuple(coefficients), tuple(units), values, covariance, matrices),
        sample_time_s=run.sample_time_s, inputs=inputs, outputs=(_OUTPUT,),
        states=(_OUTPUT, *(Signal(f"x{i + 1}", f"rad/s^{i + 1}") for i in range(1, n))),
        facts={} if speed is None else {"airspeed_m_s": speed}, measured=measured,
        holds_rad_s=(LOWEST * wn_rad_s, HIGHEST * wn_rad_s),
    )  # fmt: skip


def _coefficients(model: Answered, x: Floats) -> Floats:
    """Return the coefficients of den, then of each input's num, for the numbers x (p,)."""
    n = model.order
    each = [_polynomials(model.transfer(x[None], i))[0] for i in range(len(model.inputs))]
    return np.concatenate([each[0][:n], *(both[n:] for both in each)])


def _polynomials(G: Transfer) -> Floats:
    """Return the coefficients (n, 2m) of den and num without its leading 1, high powers first."""
    found = []
    for p, residues in zip(G.poles, G.residues, strict=True):
        parts = [r * np.poly(np.delete(p, i)) for i, r in enumerate(residues)]
        found.append(np.concatenate([np.poly(p)[1:], np.sum(parts, axis=0)]).real)
    return np.stack(found)


def _bare(run: Recorded) -> LinearModel:
    bare = run.summary.bare
    if bare is None or not bare or bare.derivatives is None or bare.airspeed_m_s is None:
        why = "replay the log with --lateral auto" if bare is None else why_not(bare.verdict)
        raise NotIdentifiable(f"the bare airframe is not known: {why}")
    if bare.alpha_rad is None or bare.correlations is None:
        raise NotIdentifiable("its covariance is missing: replay the log with --lateral auto")
    known = {**bare.derivatives, "alpha_rad": bare.alpha_rad}
    names, n = tuple(known), len(known)
    value, std = np.array([(each.value, each.std or 0.0) for each in known.values()], float).T
    covariance = np.array(bare.correlations)[:n, :n] * np.outer(std, std)
    matrices = partial(_airframe, names=names, airspeed_m_s=bare.airspeed_m_s)
    units = [unit_of_derivative(each, run.config.unit_of_rudder) for each in bare.derivatives]
    return LinearModel(
        of="bare airframe", **_judged(bare.verdict), input_is=MEAN,
        continuous=Form(names, (*units, "rad"), value, covariance, matrices),
        sample_time_s=run.sample_time_s, inputs=run.inputs(("aileron", "rudder")), outputs=_STATES,
        states=_STATES, facts={"airspeed_m_s": bare.airspeed_m_s} | (
            {} if bare.servo_lag_s is None else {"servo_lag_s": bare.servo_lag_s.value or 0.0}
        ),
        from_prior=tuple(bare.from_prior or ()),
    )  # fmt: skip


def _airframe(values: Floats, names: Sequence[str], airspeed_m_s: float) -> Matrices:
    """Return the matrices of the bare airframe; inputs are the deflections after the servos."""
    of = dict(zip(names, values.tolist(), strict=True))
    of |= {"alpha": of["alpha_rad"], "log_Y_beta": math.log(-of["Y_beta"])}
    A, B = airframe(np.array([[of.get(name, 0.0) for name in NAMES]]), airspeed_m_s)
    return A[0, :4, :4], B[0, :4, :2], np.eye(4), np.zeros((4, 2))


def _judged(verdict: Verdict) -> dict[str, Any]:
    return {"usable": verdict.usable, "reasons": tuple(str(each) for each in verdict.reasons)}
