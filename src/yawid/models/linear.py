"""A linear model with sigma: parameters with their covariance, and the state space made of them.

Sigma of all that is made of the parameters is that of the delta method, by central differences over
a thousandth of a sigma along each axis of their covariance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy import signal

from yawid.blocks import Floats
from yawid.errors import ConfigError
from yawid.models.answered import changes_of
from yawid.models.flown import Flown
from yawid.physics.modes import Complexes

Matrices = tuple[Floats, Floats, Floats, Floats]
"""A (n, n), B (n, inputs), C (outputs, n), D (outputs, inputs)."""
COHERENT = 0.6
"""The least coherence at which the response has a sigma: below it the model does not explain what
was measured there. Signals that have nothing in common reach it in .6 % of records of 4 segments,
(1 - .6)^(n - 1) for the n = 6.65 independent averages of 7 that overlap by half."""


class Signal(NamedTuple):
    """The name and the unit of an input, an output or a state."""

    name: str
    unit: str


class TransferFunction(NamedTuple):
    """num and den, highest power first, of one input to one output, with their sigmas.

    In s, or in z where ``sample_time_s`` is not 0.
    """

    num: Floats
    den: Floats
    num_std: Floats
    den_std: Floats
    sample_time_s: float


class StateSpace(NamedTuple):
    """x' = A x + B u, y = C x + D u, or x(k+1) = A x(k) + B u(k) where ``sample_time_s`` is not 0.

    ``A_std`` and ``B_std`` are the sigmas of the elements, 0 where they are known.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    A_std: Floats
    B_std: Floats
    sample_time_s: float


class FrequencyResponse(NamedTuple):
    """G at ``w`` (k,) in rad/s from one input to one output, in y per u.

    ``magnitude_std`` (k,) in y per u and ``phase_std_rad`` (k,) are sigmas of |G| and of its angle,
    NaN where the model does not hold. ``coherence`` (k,) is the squared coherence of what was
    measured and what the model makes of it, NaN where there is none.
    """

    w: Floats
    G: Complexes
    magnitude_std: Floats
    phase_std_rad: Floats
    coherence: Floats


@dataclass(frozen=True, slots=True)
class Form:
    """Parameters (p,) by name and unit, their covariance (p, p), and the function to matrices."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats
    matrices: Callable[[Floats], Matrices]
    sample_time_s: float = 0.0

    @property
    def std(self) -> Floats:
        """The sigmas (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def held(self, sample_time_s: float) -> "Form":
        """Return it in discrete time, with the inputs held from sample to sample."""

        def matrices(values: Floats) -> Matrices:
            A, B, C, D, _ = signal.cont2discrete(self.matrices(values), sample_time_s)
            return A, B, C, D

        return replace(self, matrices=matrices, sample_time_s=sample_time_s)

    def changes(self, of: Callable[[Matrices], np.ndarray]) -> np.ndarray:
        """Return what :func:`changes_of` does, of what is made of the matrices."""
        return changes_of(lambda values: of(self.matrices(values)), self.values, self.covariance)


@dataclass(frozen=True, slots=True)
class LinearModel:
    """An identified model: of a manoeuvre, of the flight, or of the bare airframe.

    ``of`` says which, ``usable`` and ``reasons`` whether its answer may be used. ``input_is`` says
    how the record has the rudder: "mean" of each sample, or "held" from one to the next. The model
    answers the rudder itself, in discrete time one that is held for ``sample_time_s``. Inputs move
    from their trim; a unit of them is that of their channel. ``measured`` has the samples of a
    manoeuvre, else None. ``holds_rad_s`` are the frequencies between which the response has a
    sigma, None where it has one at all. ``facts`` are further numbers.
    """

    of: str
    usable: bool
    reasons: tuple[str, ...]
    input_is: str
    continuous: Form
    sample_time_s: float
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    states: tuple[Signal, ...]
    measured: Flown | None = None
    holds_rad_s: tuple[float, float] | None = None
    facts: dict[str, float] = field(default_factory=dict)
    from_prior: tuple[str, ...] = ()
    """The parameters that what is known beforehand determines more than the record does."""

    def form(self, *, discrete: bool) -> Form:
        """Return the continuous form, or that whose inputs are held from sample to sample."""
        return self.continuous.held(self.sample_time_s) if discrete else self.continuous

    def ss(self, *, discrete: bool = False) -> StateSpace:
        """Return the state space with the sigmas of its elements.

        A discrete one has the inputs held from sample to sample.
        """
        form = self.form(discrete=discrete)
        A, B, C, D = form.matrices(form.values)
        A_std, B_std = (np.linalg.norm(form.changes(itemgetter(i)), axis=-1) for i in (0, 1))
        return StateSpace(A, B, C, D, A_std, B_std, form.sample_time_s)

    def tf(
        self, input: str | None = None, output: str | None = None, *, discrete: bool = False
    ) -> TransferFunction:
        """Return the transfer function from an input to an output with sigmas.

        Raises:
            ConfigError: the model has no such input or output.
        """
        i, o = self.place_of(self.inputs, input), self.place_of(self.outputs, output)
        form = self.form(discrete=discrete)

        def polynomials(m: Matrices) -> Floats:
            num, den = signal.ss2tf(*m, input=i)
            return np.stack([num[o], den])

        num, den = polynomials(form.matrices(form.values))
        num_std, den_std = np.linalg.norm(form.changes(polynomials), axis=-1)
        first = len(num) - len(np.trim_zeros(np.abs(num) > 1e-12 * np.abs(num).max(), "f"))
        first = min(first, len(num) - 1)
        return TransferFunction(num[first:], den, num_std[first:], den_std, form.sample_time_s)

    @staticmethod
    def place_of(signals: Sequence[Signal], name: str | None) -> int:
        """Return the place of a signal by its name; without one, of yaw rate or rudder.

        Raises:
            ConfigError: there is no such signal.
        """
        names = [each.name for each in signals]
        wanted = {"r", "rudder"} if name is None else {name}
        if not wanted & set(names):
            raise ConfigError(f"the model has no {name!r}: {', '.join(names)}")
        return next(i for i, each in enumerate(names) if each in wanted)

    def frequency_response(
        self, w: Sequence[float] | Floats, input: str | None = None, output: str | None = None
    ) -> FrequencyResponse:
        """Return G(jw) of the continuous model at ``w`` (k,) in rad/s, with sigmas.

        Raises:
            ConfigError: the model has no such input or output, or a frequency is not above 0.
        """
        i, o = self.place_of(self.inputs, input), self.place_of(self.outputs, output)
        w = np.atleast_1d(np.asarray(w, np.float64))
        if not (w > 0.0).all():
            raise ConfigError("frequencies w must be above 0 rad/s")

        def response(m: Matrices) -> Complexes:
            A, B, C, D = m
            x = np.linalg.solve(1j * w[:, None, None] * np.eye(len(A)) - A, B[:, i, None])
            return np.asarray((C[o] @ x)[:, 0] + D[o, i], np.complex128)

        G = response(self.continuous.matrices(self.continuous.values))
        part = self.continuous.changes(response) / G[:, None]
        known = np.full(len(w), np.nan) if self.measured is None else self.measured.coherence(w)
        low, high = self.holds_rad_s or (0.0, np.inf)
        lost = (w < low) | (w > high) | (known < COHERENT)
        along, across = np.where(lost, np.nan, np.linalg.norm([part.real, part.imag], axis=-1))
        return FrequencyResponse(w, G, np.abs(G) * along, across, known)

    def simulate(self, u: Sequence[float] | Floats) -> Floats:
        """Return the outputs of the model at rest for inputs on its grid: (n,), or (n, outputs).

        ``u`` (n,) is the first input, or (n, inputs) all of them, about their trim. The value
        of sample k is held until sample k + 1. A run's own samples are means, to which
        ``measured.simulated`` has the answer: held, they lose (w Ts)^2 / 12 of what moves at w.

        Raises:
            ConfigError: u has another number of inputs.
        """
        u = np.atleast_2d(np.asarray(u, np.float64).T).T
        if u.ndim != 2 or u.shape[1] > len(self.inputs):
            names = ", ".join(each.name for each in self.inputs)
            raise ConfigError(f"u must be (n,) or (n, {len(self.inputs)}) for {names}: {u.shape}")
        u = np.pad(u, ((0, 0), (0, len(self.inputs) - u.shape[1])))
        form = self.form(discrete=True)
        _, y, _ = signal.dlsim((*form.matrices(form.values), form.sample_time_s), u)
        return np.asarray(y[:, 0] if y.shape[1] == 1 else y, np.float64)

    def to_control(self, *, discrete: bool = False) -> object:
        """Return a ``control.StateSpace`` of python-control with the signals' names.

        Raises:
            ConfigError: python-control is not installed.
        """
        try:
            import control
        except ImportError as error:
            text = "to_control needs python-control: pip install control"
            raise ConfigError(f"{text} ({error})") from error
        found = self.ss(discrete=discrete)
        inputs, outputs = ([name for name, _ in each] for each in (self.inputs, self.outputs))
        return control.ss(*found[:4], found.sample_time_s, inputs=inputs, outputs=outputs)
