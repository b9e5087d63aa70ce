"""Configuration: frozen, complete and validated when built.

A change is ``dataclasses.replace`` and a new estimator; nothing is ever reset.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

from yawid.errors import ConfigError

Engine = Literal["numba", "filterpy"]
ELS, RML = "els", "rml"
RECURSIVE = (ELS, RML)
"""The methods that recurse. What else there is to say of them: ``estimation/methods.py``."""
ENGINES: tuple[Engine, ...] = ("numba", "filterpy")


@dataclass(frozen=True, slots=True)
class ArmaxOrders:
    """Orders of ``A(q) y(k) = B(q) u(k) + C(q) e(k)``, paper eq. 28-29.

    ``nb`` and ``nk`` have one entry per input; an int means one input. ``nk`` counts as MATLAB
    does: with nk = 1 the newest input used is u(k-1).

    Raises:
        ConfigError: an order is negative or no int, nb and nk differ in length, or theta would be
        empty.
    """

    na: int
    nb: tuple[int, ...]
    nc: int
    nk: tuple[int, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "nb", _entries("nb", self.nb))
        object.__setattr__(self, "nk", _entries("nk", self.nk))
        for name in ("na", "nc"):
            _check_order(name, getattr(self, name))
        if len(self.nb) != len(self.nk):
            raise ConfigError(
                f"nb has {len(self.nb)} entries and nk {len(self.nk)}: one per input each"
            )
        if self.na + sum(self.nb) + self.nc == 0:
            raise ConfigError("orders of zero everywhere: na, nb or nc must be at least 1")

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return len(self.nb)

    @property
    def n_theta(self) -> int:
        """Number of polynomial coefficients in theta, without the bias."""
        return self.na + sum(self.nb) + self.nc


def forgetting_factor(memory_s: float, sample_time_s: float) -> float:
    """Return lambda = exp(-Ts / memory): a sample as old as the memory weighs 1/e.

    Raises:
        ConfigError: either is not > 0, or the sample time is not finite.
    """
    if not memory_s > 0.0:
        raise ConfigError(f"memory must be > 0 s, got {memory_s!r}")
    if not 0.0 < sample_time_s < math.inf:
        raise ConfigError(f"sample_time_s must be > 0 and finite, got {sample_time_s!r}")
    return math.exp(-sample_time_s / memory_s)


def _entries(name: str, value: Any) -> tuple[int, ...]:
    entries = (value,) if isinstance(value, int) else tuple(value)
    for entry in entries:
        _check_order(name, entry)
    return entries


def _check_order(name: str, value: Any) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 50:
        raise ConfigError(f"{name} must be an int from 0 to 50, got {value!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorConfig:
    """All that defines a :class:`yawid.RecursiveArmax`.

    ``forgetting_factor`` is lambda after start-up; ``forgetting_start`` and ``forgetting_rate``
    give the schedule ``lambda(t) = rate * lambda(t-1) + (1 - rate) * lambda_inf``. ``P0`` is the
    starting variance of each parameter on scaled signals. ``information_floor`` bounds what
    forgetting may take: P[i, i] stays below 1 + 0.03 / floor times its usual least (0: no bound;
    None: 0.1 where lambda < 1, else 0). ``scale_window`` counts the samples that set the scale (0:
    none), ``start_buffer`` those given to one Gauss-Newton fit (0: none); both wait until each
    channel's standard deviation over them exceeds ``scale_minimum``, in the channel's unit.
    ``residual_lags`` counts the lags of the residual's autocorrelation for whiteness and sigma;
    0 leaves both out.

    Raises:
        ConfigError: a value outside its limits.
    """

    orders: ArmaxOrders
    sample_time_s: float
    forgetting_factor: float = 1.0
    method: str = ELS
    bias: bool = True
    P0: float = 100.0
    forgetting_start: float = 0.95
    forgetting_rate: float = 0.995
    start_buffer: int = 0
    information_floor: float | None = None
    scale_window: int = 100
    scale_minimum: float = 1e-3
    residual_lags: int = 20

    def __post_init__(self) -> None:
        if not isinstance(self.orders, ArmaxOrders):
            raise ConfigError(f"orders must be ArmaxOrders, got {self.orders!r}")
        if self.method not in RECURSIVE:
            raise ConfigError(f"method must be one of {', '.join(RECURSIVE)}, got {self.method!r}")
        for name in ("sample_time_s", "P0"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ConfigError(f"{name} must be > 0 and finite, got {getattr(self, name)!r}")
        for name in ("forgetting_factor", "forgetting_start"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise ConfigError(f"{name} must lie in (0, 1], got {getattr(self, name)!r}")
        if not 0.0 <= self.forgetting_rate < 1.0:
            raise ConfigError(f"forgetting_rate must lie in [0, 1), got {self.forgetting_rate!r}")
        for name in ("start_buffer", "scale_window", "residual_lags"):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < 0:
                raise ConfigError(f"{name} must be an int >= 0, got {value!r}")
        if not 0.0 <= self.scale_minimum < math.inf:
            raise ConfigError(f"scale_minimum must be >= 0, got {self.scale_minimum!r}")
        if self.information_floor is None:
            floor = 0.1 if self.forgetting_factor < 1.0 else 0.0
            object.__setattr__(self, "information_floor", floor)
        elif not 0.0 <= self.information_floor < math.inf:
            raise ConfigError(f"information_floor must be >= 0, got {self.information_floor!r}")

    @property
    def n_theta(self) -> int:
        """Number of parameters, the bias included."""
        return self.orders.n_theta + int(self.bias)
