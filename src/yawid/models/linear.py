"""A linear model with sigma: parameters with their covariance, and the state space made of them.

Sigma of all that is made of the parameters is that of the delta method, by central differences over
a thousandth of a sigma along each axis of their covariance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy import signal

from yawid.answers.identified_model import ModelSignal
from yawid.blocks import Floats
from yawid.errors import ConfigError, library
from yawid.models.answered import changes_of
from yawid.models.flown import Flown
from yawid.physics.frequency_response import FrequencyResponse
from yawid.physics.modes import Complexes

Matrices = tuple[Floats, Floats, Floats, Floats]
"""A (n, n), B (n, inputs), C (outputs, n), D (outputs, inputs)."""
COHERENT = 0.6
"""The least coherence at which the response has a sigma: below it the model does not explain what
was measured there. Signals that have nothing in common reach it in .6 % of records of 4 segments,
(1 - .6)^(n - 1) for the n = 6.65 independent averages of 7 that overlap by half."""


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


@dataclass(frozen=True, slots=True)
class LinearModel:
    """An identified model: of a manoeuvre, of the flight, or of the bare airframe.

    ``of`` says which, ``usable`` and ``reasons`` whether its answer may be used. ``input_is`` says
    how the record has the rudder: "mean" of each sample, or "held" from one to the next. The model
    answers the rudder itself, in discrete time one that is held for ``sample_time_s``. Inputs move
    from their trim; a unit of them is that of their channel. The ``matrices`` are a function of the
    parameters, which have ``names`` and ``units`` (p,), ``values`` and their ``covariance``.
    ``measured`` has the samples of a manoeuvre, else None. ``holds_rad_s`` are the frequencies
    between which the response has a sigma, None where it has one at all. ``facts`` are further
    numbers.
    """

    of: str
    usable: bool
    reasons: tuple[str, ...]
    input_is: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats
    matrices: Callable[[Floats], Matrices]
    sample_time_s: float
    inputs: tuple[ModelSignal, ...]
    outputs: tuple[ModelSignal, ...]
    states: tuple[ModelSignal, ...]
    measured: Flown | None = None
    holds_rad_s: tuple[float, float] | None = None
    facts: dict[str, float] = field(default_factory=dict)
    from_prior: tuple[str, ...] = ()
    """The parameters that what is known beforehand determines more than the record does."""

    @property
    def std(self) -> Floats:
        """The sigmas (p,) of the parameters."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def _with_changes(
        self, of: Callable[[Matrices], np.ndarray], *, discrete: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what is made of the matrices, and its changes, see :func:`changes_of`."""

        def made(values: Floats) -> np.ndarray:
            found = self.matrices(values)
            return of(signal.cont2discrete(found, self.sample_time_s)[:4] if discrete else found)

        return made(self.values), changes_of(made, self.values, self.covariance)

    def ss(self, *, discrete: bool = False) -> StateSpace:
        """Return the state space with the sigmas of its elements.

        A discrete one has the inputs held from sample to sample.
        """
        *_, C, D = self.matrices(self.values)
        both = (self._with_changes(itemgetter(i), discrete=discrete) for i in (0, 1))
        (A, A_std), (B, B_std) = ((x, np.linalg.norm(change, axis=-1)) for x, change in both)
        return StateSpace(A, B, C, D, A_std, B_std, self.sample_time_s * discrete)

    def tf(
        self, input: str | None = None, output: str | None = None, *, discrete: bool = False
    ) -> TransferFunction:
        """Return the transfer function from an input to an output with sigmas.

        Raises:
            ConfigError: the model has no such input or output.
        """
        i, o = self.place_of(self.inputs, input), self.place_of(self.outputs, output)
        both = partial(_polynomials, i=i, o=o)
        (num, den), changes = self._with_changes(both, discrete=discrete)
        num_std, den_std = np.linalg.norm(changes, axis=-1)
        first = int(np.argmax(np.abs(num) > 1e-12 * np.abs(num).max()))
        Ts = self.sample_time_s * discrete
        return TransferFunction(num[first:], den, num_std[first:], den_std, Ts)

    @staticmethod
    def place_of(signals: Sequence[ModelSignal], name: str | None) -> int:
        """Return the place of a signal by its name; without one, of yaw rate or rudder.

        Raises:
            ConfigError: there is no such signal.
        """
        names = [each.name for each in signals]
        for i, each in enumerate(names):
            if each == name or (name is None and each in ("r", "rudder")):
                return i
        raise ConfigError(f"the model has no {name!r}: {', '.join(names)}")

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
            num, den = _polynomials(m, i, o)
            return np.asarray(np.polyval(num, 1j * w) / np.polyval(den, 1j * w))

        G, changes = self._with_changes(response)
        part = changes / G[:, None]
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
        _, y, _ = signal.dlsim((*self.ss(discrete=True)[:4], self.sample_time_s), u)
        return np.asarray(y[:, 0] if y.shape[1] == 1 else y, np.float64)

    def to_control(self, *, discrete: bool = False) -> object:
        """Return a ``control.StateSpace`` of python-control with the signals' names.

        Raises:
            ConfigError: python-control is not installed.
        """
        found = self.ss(discrete=discrete)
        inputs, outputs = ([each.name for each in of] for of in (self.inputs, self.outputs))
        return library("control").ss(
            *found[:4], found.sample_time_s, inputs=inputs, outputs=outputs
        )


def _polynomials(m: Matrices, i: int, o: int) -> Floats:
    """Return num and den (2, n + 1) from one input to one output, highest power first."""
    num, den = signal.ss2tf(*m, input=i)
    return np.stack([num[o], den])
