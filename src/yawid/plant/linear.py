"""A linear plant in state space: from its transfer function, and its response to a held input."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from yawid.blocks import Floats
from yawid.errors import ConfigError


@dataclass(frozen=True, slots=True)
class LinearPlant:
    """The plant x' = A x + B u, y = C x + D u, with the names of its inputs and outputs."""

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @classmethod
    def from_transfer(cls, numerator: ArrayLike, denominator: ArrayLike) -> "LinearPlant":
        """Return the plant with input u and output y that has this transfer function.

        ``numerator`` (m,) and ``denominator`` (n + 1,), for n states, begin with the highest power
        of s. The numerator has a lower degree than the denominator, whose first coefficient is 1.
        """
        A, B, C, D = signal.tf2ss(numerator, denominator)
        return cls(A, B, C, D, ("u",), ("y",))

    def simulate(self, u: ArrayLike, sample_time_s: float) -> Floats:
        """Return the outputs (n, outputs) at k Ts, from rest.

        ``u`` (n, inputs), or (n,) for one input, is held over [k Ts, (k+1) Ts). The result is
        exact, by the matrix exponential.

        Raises:
            ConfigError: u has the wrong number of inputs.
        """
        u = np.asarray(u, dtype=np.float64)
        u = u.reshape(-1, 1) if u.ndim == 1 else u
        if u.shape[1] != len(self.inputs):
            raise ConfigError(f"u has {u.shape[1]} columns for the inputs {self.inputs}")
        A, B = _discrete(self, sample_time_s)
        x, states = np.zeros(len(A)), np.empty((len(u), len(A)))
        driven = u @ B.T
        for k in range(len(u)):
            states[k] = x
            x = A @ x + driven[k]
        outputs: Floats = states @ self.C.T + u @ self.D.T
        return outputs


def _discrete(plant: LinearPlant, sample_time_s: float) -> tuple[Floats, Floats]:
    system: Any = (plant.A, plant.B, plant.C, plant.D)
    A, B, *_ = signal.cont2discrete(system, sample_time_s, method="zoh")
    return A, B


def sampled_theta(plant: LinearPlant, sample_time_s: float) -> Floats:
    """Return theta (2 na,) = [a1.., b1..], nk = 1, of a plant with one held input and one output.

    Raises:
        ConfigError: the input acts on the output without delay (nk would be 0).
    """
    if np.any(plant.D):
        raise ConfigError("theta with nk = 1 needs a plant that does not pass its input through")
    A, B = _discrete(plant, sample_time_s)
    numerator, denominator = signal.ss2tf(A, B, plant.C, plant.D)
    return np.concatenate([denominator[1:], numerator[0, 1:]])
