"""The configuration of an estimator: frozen, complete, and validated when it is made.

To change it, make a copy by ``dataclasses.replace`` and a new estimator; nothing is ever reset.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from yawid.config.fields import Count, NotNegative, Positive, Share, check_fields, one_of
from yawid.config.names import ELS, RECURSIVE
from yawid.errors import ConfigError

Engine = Annotated[Literal["numba", "filterpy"], Meta(description="be one of numba, filterpy")]
Order = Annotated[int, Meta(ge=0, le=50, description="be an int from 0 to 50")]


@dataclass(frozen=True, slots=True)
class ArmaxOrders:
    """The orders of ``A(q) y(k) = B(q) u(k) + C(q) e(k)``, paper eq. 28-29.

    ``nb`` and ``nk`` have one entry for each input; an int means one input. ``nk`` counts as in
    MATLAB: with nk = 1 the newest input used is u(k-1).

    Raises:
        ConfigError: an order is negative or no int, nb and nk differ in length, or theta would be
        empty.
    """

    na: Order
    nb: tuple[Order, ...]
    nc: Order
    nk: tuple[Order, ...]

    def __post_init__(self) -> None:
        for name in ("nb", "nk"):
            each = getattr(self, name)
            object.__setattr__(self, name, (each,) if isinstance(each, int) else tuple(each))
        check_fields(self)
        if len(self.nb) != len(self.nk):
            raise ConfigError(
                f"nb has {len(self.nb)} entries and nk {len(self.nk)}: one per input each"
            )
        if self.na + sum(self.nb) + self.nc == 0:
            raise ConfigError("orders of zero everywhere: na, nb or nc must be at least 1")

    @property
    def n_inputs(self) -> int:
        """The number of inputs."""
        return len(self.nb)

    @property
    def n_theta(self) -> int:
        """The number of polynomial coefficients in theta, without the bias."""
        return self.na + sum(self.nb) + self.nc


def forgetting_factor(memory_s: float, sample_time_s: float) -> float:
    """Return lambda = exp(-Ts / memory): a sample as old as the memory has the weight 1/e.

    Raises:
        ConfigError: either is not > 0, or the sample time is not finite.
    """
    if not memory_s > 0.0:
        raise ConfigError(f"memory must be > 0 s, got {memory_s!r}")
    if not 0.0 < sample_time_s < math.inf:
        raise ConfigError(f"sample_time_s must be > 0 and finite, got {sample_time_s!r}")
    return math.exp(-sample_time_s / memory_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorConfig:
    """All that defines a :class:`yawid.RecursiveArmax`.

    ``forgetting_factor`` is lambda after start-up; ``forgetting_start`` and ``forgetting_rate``
    give the schedule ``lambda(t) = rate * lambda(t-1) + (1 - rate) * lambda_inf``. ``P0`` is the
    initial variance of each parameter on scaled signals. ``information_floor`` limits what
    forgetting may remove: P[i, i] stays below 1 + 0.03 / floor times its usual least (0: no limit;
    None: 0.1 where lambda < 1, else 0). ``scale_window`` is the number of samples that set the
    scale (0: none), ``start_buffer`` that of the samples for one prediction-error fit (0: none, as
    with filterpy always); both wait until each channel's standard deviation over them exceeds
    ``scale_minimum``, in the channel's unit. ``residual_lags`` is the number of lags of the
    residual's autocorrelation for whiteness and sigma; 0 leaves both out.

    Raises:
        ConfigError: a value outside its limits.
    """

    orders: ArmaxOrders
    sample_time_s: Positive
    forgetting_factor: Share = 1.0
    method: Annotated[str, one_of(*RECURSIVE)] = ELS
    bias: bool = True
    P0: Positive = 100.0
    forgetting_start: Share = 0.95
    forgetting_rate: Annotated[float, Meta(ge=0.0, lt=1.0, description="lie in [0, 1)")] = 0.995
    start_buffer: Count = 0
    information_floor: NotNegative | None = None
    scale_window: Count = 100
    scale_minimum: NotNegative = 1e-3
    residual_lags: Count = 20

    def __post_init__(self) -> None:
        check_fields(self)
        if self.information_floor is None:
            floor = 0.1 if self.forgetting_factor < 1.0 else 0.0
            object.__setattr__(self, "information_floor", floor)

    @property
    def n_theta(self) -> int:
        """The number of parameters, the bias included."""
        return self.orders.n_theta + int(self.bias)
