"""The models of a run: of a manoeuvre, of the flight, and of the bare airframe (``LinearModel``).

The yaw channel is in observer form: the first state is the yaw rate, each further one a sum of
derivatives, and the elements of A and B are the coefficients themselves. A manoeuvre's are those of
its answer's poles and residues, whose covariance the delta method takes over. The flight's are the
mean of its manoeuvres' in one form, and their covariance is that of the flight's draws. The
bare airframe has the states of :mod:`yawid.lateral.model`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from yawid.answers.identified_model import ModelSignal
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import HIGHEST, LOWEST, Bare, Flight, Manoeuvre, RunSummary
from yawid.blocks import Floats, MotionBlock, SampleBlock
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, NotIdentifiable
from yawid.lateral.model import airframe, theta_of
from yawid.models.answered import Answered, changes_of, why_not
from yawid.models.draws import drawn_aircraft
from yawid.models.flown import Flown
from yawid.models.linear import LinearModel, Matrices
from yawid.physics.continuous import Transfer
from yawid.quantities.units import HALF_TRAVEL, unit_of_derivative

HELD, MEAN = "held", "mean"
_OUTPUT = ModelSignal("r", "rad/s")
_STATES = (
    ModelSignal("beta", "rad"),
    ModelSignal("p", "rad/s"),
    _OUTPUT,
    ModelSignal("roll", "rad"),
)


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run: its summary and configuration, its samples in one block or more, and parameters.

    ``motion`` is None where the run kept none.
    """

    summary: RunSummary
    config: RunConfig
    sample_time_s: float
    samples: Iterable[SampleBlock]
    parameters: Mapping[str, float]
    motion: MotionBlock | None = None

    @property
    def input_is(self) -> str:
        """How the record has the rudder, see :class:`LinearModel`.

        It is held from sample to sample where it is commanded and was logged as often. Any other
        one moved between the samples, which have its mean.
        """
        rudder = self.summary.channels.get("rudder")
        rate_hz = (rudder and rudder.rate_hz) or np.inf
        commanded = self.config.rudder_is == "commanded"
        return HELD if commanded and rate_hz * self.sample_time_s < 1.02 else MEAN

    def flown(self, manoeuvres: Sequence[Manoeuvre]) -> list[Flown]:
        """Return the manoeuvres that have samples, with these."""
        samples = SampleBlock.joined(list(self.samples))
        found = (Flown.of(each, samples, self.config) for each in manoeuvres)
        return [each for each in found if each is not None]

    @property
    def used(self) -> list[Manoeuvre]:
        """The manoeuvres that the flight's answer uses."""
        of = () if self.summary.flight is None else self.summary.flight.used
        return [each for each in self.summary.manoeuvres or () if each.n in of]

    def inputs(self, names: Sequence[str]) -> tuple[ModelSignal, ...]:
        """Return inputs with their units."""
        return tuple(
            ModelSignal(n, self.config.unit_of_rudder if n == "rudder" else HALF_TRAVEL)
            for n in names
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
        raise ConfigError(
            f"there is no model of {which!r}: a model is that of flight, bare or a manoeuvre "
            f"({numbers})"
        )
    return model_of_answer(run, Answered.of(found), next(iter(run.flown([found])), None))


def model_of_answer(run: Recorded, model: Answered, flown: Flown | None) -> LinearModel:
    """Return the model of a manoeuvre's answer, ``flown`` being its samples."""

    def coefficients(x: Floats) -> Floats:
        return np.asarray(_polynomials(model.transfers(x[None]))[0])

    values = coefficients(model.x)
    changes = changes_of(coefficients, model.x, model.covariance)
    return _observer(
        run, f"manoeuvre {model.found.n}", model.found, run.inputs(model.inputs), float(model.x[0]),
        values,
        changes @ changes.T, measured=flown and flown.with_model(model),
    )  # fmt: skip


def _flight(run: Recorded) -> LinearModel:
    flight = run.summary.flight
    if flight is None or flight.dutch_roll is None:
        why = why_not(run.summary.deciding) or "no manoeuvre was found"
        raise NotIdentifiable(f"the flight has no answer: {why}")
    aircraft = drawn_aircraft(flight, [Answered.of(each) for each in run.used])
    if aircraft is None:
        raise NotIdentifiable("the airspeed is not known: take the model of one manoeuvre")
    values, wn = _polynomials([aircraft.central])[0], flight.dutch_roll.wn_rad_s
    apart = _polynomials([aircraft.alike]) - values
    return _observer(
        run, "flight", flight, run.inputs(["rudder"]), wn, values, apart.T @ apart / len(apart)
    )


def _observer(
    run: Recorded,
    of: str,
    answer: Manoeuvre | Flight,
    inputs: tuple[ModelSignal, ...],
    wn_rad_s: float,
    values: Floats,
    covariance: Floats,
    measured: Flown | None = None,
) -> LinearModel:
    """Return the model of the yaw rate with den and num coefficients, n for each, as ``values``."""
    n, speed = len(values) // (1 + len(inputs)), answer.airspeed_m_s
    powers = [f"s{n - 1 - i}" for i in range(n)]
    den = [(f"den_{s}", f"1/s^{i}" if i > 1 else "1/s") for i, s in enumerate(powers, 1)]
    num = [
        (f"num_{s}_{each.name}", f"rad/s^{i} per {each.unit}")
        for each in inputs
        for i, s in enumerate(powers, 2)
    ]

    def matrices(v: Floats) -> Matrices:
        A, B = np.eye(n, k=1), v[n:].reshape(len(inputs), n).T
        A[:, 0] = -v[:n]
        return A, B, np.eye(1, n), np.zeros((1, len(inputs)))

    names, units = zip(*den, *num, strict=True)
    return LinearModel(
        of=of, **_judged(answer.verdict), input_is=run.input_is,
        names=names, units=units, values=values, covariance=covariance, matrices=matrices,
        sample_time_s=run.sample_time_s, inputs=inputs, outputs=(_OUTPUT,),
        states=(_OUTPUT, *(ModelSignal(f"x{i + 1}", f"rad/s^{i + 1}") for i in range(1, n))),
        facts={} if speed is None else {"airspeed_m_s": speed}, measured=measured,
        holds_rad_s=(LOWEST * wn_rad_s, HIGHEST * wn_rad_s),
    )  # fmt: skip


def _polynomials(every: Sequence[Transfer]) -> Floats:
    """Return the coefficients (n, m + m inputs) of den without its leading 1, then of each num.

    High powers come first; ``every`` has the transfer functions of each input, of the same poles.
    """
    found: list[Floats] = []
    for i, p in enumerate(every[0].poles):
        others = [np.poly(np.delete(p, j)) for j in range(len(p))]
        nums = [G.residues[i] @ others for G in every]
        found.append(np.concatenate([np.poly(p)[1:], *nums]).real)
    return np.stack(found)


def numbers_of(bare: Bare | None) -> tuple[tuple[str, ...], Floats, Floats, float]:
    """Return names, values and covariance of a flight's airframe, its servo lag last; its airspeed.

    Raises:
        NotIdentifiable: it is not known.
    """
    if bare is None or not bare or bare.derivatives is None or bare.airspeed_m_s is None:
        why = "replay the log" if bare is None else why_not(bare.verdict)
        raise NotIdentifiable(f"the bare airframe is not known: {why}")
    if bare.alpha_rad is None or bare.servo_lag_s is None or bare.correlations is None:
        raise NotIdentifiable("its covariance is missing: replay the log")
    known = {**bare.derivatives, "alpha_rad": bare.alpha_rad, "servo_lag_s": bare.servo_lag_s}
    value, std = np.array([(each.value, each.std or 0.0) for each in known.values()], float).T
    covariance = np.array(bare.correlations) * np.outer(std, std)
    return tuple(known), value, covariance, bare.airspeed_m_s


def _bare(run: Recorded) -> LinearModel:
    (*names, _), value, covariance, airspeed_m_s = numbers_of(bare := run.summary.bare)
    assert bare  # its numbers are known
    units = [unit_of_derivative(each, run.config.unit_of_rudder) for each in names[:-1]]
    return LinearModel(
        of="bare airframe", **_judged(bare.verdict), input_is=MEAN,
        names=tuple(names), units=(*units, "rad"), values=value[:-1],
        covariance=covariance[:-1, :-1],
        matrices=partial(_airframe, names=names, airspeed_m_s=airspeed_m_s),
        sample_time_s=run.sample_time_s, inputs=run.inputs(("aileron", "rudder")), outputs=_STATES,
        states=_STATES, facts={"airspeed_m_s": airspeed_m_s, "servo_lag_s": float(value[-1])},
        from_prior=tuple(bare.from_prior or ()),
    )  # fmt: skip


def _airframe(values: Floats, names: Sequence[str], airspeed_m_s: float) -> Matrices:
    """Return the matrices of the bare airframe; inputs are the deflections after the servos."""
    A, B = airframe(theta_of(names, values[None]), airspeed_m_s)
    return A[0, :4, :4], B[0, :4, :2], np.eye(4), np.zeros((4, 2))


def _judged(verdict: Verdict) -> dict[str, Any]:
    return {"usable": verdict.usable, "reasons": tuple(str(each) for each in verdict.reasons)}
