"""The configuration of a run, from the command line or a TOML file: complete and frozen."""

import math
from collections.abc import Iterator
from dataclasses import Field, asdict, dataclass, field, fields
from typing import Annotated, Any

import tomli_w
from msgspec import Meta

from yawid.config.estimator import ArmaxOrders, Engine, EstimatorConfig, Order, forgetting_factor
from yawid.config.fields import (
    Finite,
    NotNegative,
    Positive,
    Said,
    Share,
    check_fields,
    one_of,
    option,
)
from yawid.config.names import ELS, RECURSIVE, RML
from yawid.errors import ConfigError
from yawid.quantities.units import HALF_TRAVEL

BOTH = ("rudder", "aileron")
INPUTS = (("rudder",), BOTH)
INPUT = "be rudder or rudder,aileron"
BAND = "be LO,HI in Hz with 0 < LO < HI"
DeadTime = Annotated[int, Meta(ge=1, le=50)]
_SERVO = r"([1-9]|[12]\d|3[0-2])"
_CHANNELS = rf"auto|servo:{_SERVO}|control:[0-7]|rc:([1-9]|1[0-8])"
_SAID = "auto, servo:N (1-32), control:K (0-7) or rc:N (1-18)"
Aileron = Annotated[str, Meta(pattern=rf"\A({_CHANNELS})\Z", description=f"be {_SAID}")]
_VTAIL = rf"\A({_CHANNELS}|vtail:{_SERVO},{_SERVO})\Z"
Rudder = Annotated[str, Meta(pattern=_VTAIL, description=f"be vtail:L,R, {_SAID}")]
DEFAULT_RATE_HZ = 20.0
DEFAULT_MEMORY_S = 60.0
LEAST_STROKE_DEG = 1.0
RATE_SLACK = 0.98
"""The part of a rate limit that is enough: message rates jitter, so that 4.95 Hz counts as 5."""
BINDING = ("orders", "inputs", "turn")
"""Settings that are chosen for each manoeuvre unless the user gave them."""
GIVEN = (*BINDING, "rudder_sign")
"""Settings for which "given by the user" is recorded, even when equal to the default."""
SAMPLES = "which samples"
AIRCRAFT = "the aircraft"
ANSWER = "the answer"
STREAM = "the running estimates, which change no answer"
COLUMNS = "the columns of CSV and Parquet"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """One run of the pipeline; each field is the command-line option of the same name.

    The words of an option, its group and its bounds stand on its field: parser, TOML, completion
    and ``yawid explain`` have them from there. None is what the words call the default.

    ``given`` names settings that the user gave: orders, inputs and turn apply to every manoeuvre if
    they are named there or differ from their defaults. ``rudder_stroke_rad`` is the rudder's
    largest stroke within 5 s, which replaces half of an unknown travel. Neither is an option.

    Raises:
        ConfigError: a value outside its limits.
    """

    orders: Annotated[
        tuple[Order, Order, Order, DeadTime],
        Meta(
            description="be na,nb,nc,nk, whole numbers, nk at least 1 (yawid orders compares them)"
        ),
    ] = field(
        default=(3, 3, 2, 1),
        metadata=option(
            STREAM, "NA,NB,NC,NK", "orders, nb and nk for every input (default: 3,3,2,1)"
        ),
    )
    method: Annotated[str, one_of(*RECURSIVE)] = field(
        default=ELS,
        metadata=option(STREAM, "|".join(RECURSIVE), f"the stream's estimator (default: {ELS})"),
    )
    also: Annotated[str, one_of(*RECURSIVE, "none")] = field(
        default=RML,
        metadata=option(
            STREAM, f"{'|'.join(RECURSIVE)}|none", f"a second one next to it (default: {RML})"
        ),
    )
    engine: Engine = field(
        default="numba",
        metadata=option(STREAM, "numba|filterpy", "what computes the recursion (default: numba)"),
    )
    memory: Annotated[float, Meta(gt=0.0, description="be a number > 0")] = field(
        default=DEFAULT_MEMORY_S,
        metadata=option(
            STREAM, "SECONDS", "forget with this memory; inf forgets nothing (default: 60)"
        ),
    )
    forgetting: Share | None = field(
        default=None,
        metadata=option(
            STREAM,
            "LAMBDA",
            "forgetting factor instead of a memory (default: from it)",
        ),
    )
    rate: Annotated[float, Meta(ge=0.1, le=1e3, description="lie in 0.1 to 1000 Hz")] | None = (
        field(
            default=None,
            metadata=option(
                ANSWER,
                "HZ",
                "rate of the grid (default: 20, or the slower channel's if that is lower)",
                usual=True,
            ),
        )
    )
    band: Annotated[tuple[Positive, Positive], Meta(description=BAND)] | None = field(
        default=None,
        metadata=option(
            ANSWER, "LO,HI", "band-pass rudder and yaw rate alike, in Hz (default: off)"
        ),
    )
    inputs: Annotated[tuple[str, ...], Meta(description=INPUT)] = field(
        default=("rudder",),
        metadata=option(ANSWER, "rudder[,aileron]", "inputs of the model (default: rudder)"),
    )
    output: Annotated[str, one_of("yaw-rate", "yaw")] = field(
        default="yaw-rate",
        metadata=option(ANSWER, "yaw-rate|yaw", "the model's output (default: yaw-rate)"),
    )
    turn: Annotated[str, one_of("keep", "remove")] = field(
        default="keep",
        metadata=option(
            ANSWER, "keep|remove", "subtract the turn rate that the bank implies (default: keep)"
        ),
    )
    rudder: Rudder = field(
        default="auto",
        metadata=option(
            AIRCRAFT,
            "CHANNEL",
            "auto, servo:N, vtail:L,R, control:K or rc:N (default: auto)",
            usual=True,
        ),
    )
    aileron: Aileron = field(
        default="auto",
        metadata=option(
            AIRCRAFT, "CHANNEL", "the same for the aileron, without vtail (default: auto)"
        ),
    )
    rudder_sign: Annotated[str, one_of("nose-right", "nose-left")] = field(
        default="nose-right",
        metadata=option(
            AIRCRAFT,
            "nose-right|nose-left",
            "where positive rudder turns the nose (default: nose-right)",
        ),
    )
    rudder_max_deg: (
        Annotated[float, Meta(gt=0.0, le=90.0, description="be > 0 and at most 90")] | None
    ) = field(
        default=None,
        metadata=option(
            AIRCRAFT,
            "DEG",
            "rudder at full travel in deg, for gains per rad (default: per half of the travel)",
        ),
    )
    rudder_unit: Annotated[str, one_of("half-travel", "rad", "deg")] | None = field(
        default=None,
        metadata=option(
            COLUMNS, "half-travel|rad|deg", "unit of a rudder that gives none (default: none)"
        ),
    )
    rudder_stroke_rad: Positive | None = None
    rudder_is: Annotated[str, one_of("measured", "commanded")] | None = field(
        default=None,
        metadata=option(
            COLUMNS,
            "measured|commanded",
            "on straight lines between rows, or held from row to row (default: by its unit)",
        ),
    )
    columns: tuple[str, ...] = field(
        default=(),
        metadata=option(
            COLUMNS,
            "NAME=COLUMN,...",
            "names of columns: rudder=delta_r,r=Rate[deg/s] (default: t, rudder, r, ...)",
        ),
    )
    units: Annotated[str, one_of("rad", "deg")] | None = field(
        default=None,
        metadata=option(
            COLUMNS, "rad|deg", "unit of angles and rates that give none (default: none)"
        ),
    )
    from_s: Finite | None = field(
        default=None,
        metadata=option(
            SAMPLES, "S", "first second since boot (default: the log's first)", usual=True
        ),
    )
    to_s: Finite | None = field(
        default=None,
        metadata=option(
            SAMPLES, "S", "last second since boot (default: the log's last)", usual=True
        ),
    )
    sysid: (
        Annotated[int, Meta(ge=1, le=255, description="be a whole number from 1 to 255")] | None
    ) = field(
        default=None,
        metadata=option(
            AIRCRAFT,
            "N",
            "system id of the vehicle, 1 to 255; live: or all (default: the first fixed wing)",
        ),
    )
    airborne: Annotated[str, one_of("auto", "all")] | None = field(
        default=None,
        metadata=option(
            SAMPLES,
            "auto|all",
            "all: use samples on the ground as well; auto: hold those (default: auto)",
        ),
    )
    boot: (
        Annotated[int, Meta(ge=1, description="be a whole number from 1, as boots count")] | None
    ) = field(
        default=None,
        metadata=option(
            SAMPLES, "N", "only the vehicle's Nth boot in the log, from 1 (default: all)"
        ),
    )
    manoeuvres: Annotated[str, one_of("auto", "off")] = field(
        default="auto",
        metadata=option(
            ANSWER,
            "auto|off",
            "find manoeuvres, answer each of them (default: auto)",
            aliases=("maneuvers",),
        ),
    )
    lateral: Annotated[str, one_of("auto", "off")] | None = field(
        default=None,
        metadata=option(
            ANSWER,
            "auto|off",
            "answer the aircraft without its autopilot, too "
            "(default: auto, of a CSV or Parquet file off)",
        ),
    )
    servo_lag: NotNegative | None = field(
        default=None,
        metadata=option(
            ANSWER, "SECONDS", "lag of both servos, for the bare airframe (default: unknown)"
        ),
    )
    ordinary: Annotated[str, one_of("auto", "only", "off")] | None = field(
        default=None,
        metadata=option(
            ANSWER,
            "auto|only|off",
            "answer flight without a manoeuvre, too; only: that is the verdict "
            "(default: auto, of a CSV or Parquet file off)",
        ),
    )
    given: tuple[str, ...] = ()

    def binds(self, name: str) -> bool:
        """Return whether the user gave this setting, which then applies to every manoeuvre."""
        return name in self.given or getattr(self, name) != getattr(RunConfig(), name)

    @property
    def is_ordinary(self) -> bool:
        """Whether flight without a manoeuvre is answered; of a record only where it is asked."""
        return (self.ordinary or ("off" if self.rudder_unit else "auto")) != "off"

    @property
    def is_lateral(self) -> bool:
        """Whether the bare airframe is looked for; of a record only where it is asked."""
        return (self.lateral or ("off" if self.rudder_unit else "auto")) != "off"

    @property
    def asks_motion(self) -> bool:
        """Whether an answer that needs the lateral motion was asked for."""
        return self.lateral == "auto" or self.ordinary in ("auto", "only")

    @property
    def keeps_motion(self) -> bool:
        """Whether the lateral motion is read and kept."""
        return self.is_lateral or self.is_ordinary

    @property
    def has_manoeuvres(self) -> bool:
        """Whether manoeuvres are searched for."""
        return self.manoeuvres != "off" and self.ordinary != "only"

    @property
    def window_us(self) -> tuple[float, float]:
        """The times ``from_s`` and ``to_s`` in us since boot, infinite where they are not given."""
        low = -math.inf if self.from_s is None else 1e6 * self.from_s
        high = math.inf if self.to_s is None else 1e6 * self.to_s
        return low, high

    def __post_init__(self) -> None:
        for name in ("orders", "inputs", "given", "columns", "band"):
            if not isinstance(each := getattr(self, name), str | None):
                object.__setattr__(self, name, tuple(each))
        check_fields(self, lambda name: f"--{option_name(name)}")
        if unknown := set(self.given) - set(GIVEN):
            raise ConfigError(f"given must name some of {', '.join(GIVEN)}, got {min(unknown)!r}")
        if self.inputs not in INPUTS:
            raise ConfigError(f"--inputs must {INPUT}, got {','.join(self.inputs)}")
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ConfigError(f"--band must {BAND}, got {self.band[0]:g},{self.band[1]:g}")
        if self.from_s is not None and self.to_s is not None and not self.from_s < self.to_s:
            raise ConfigError(f"--from {self.from_s!r} must lie before --to {self.to_s!r}")
        if self.forgetting is not None and self.memory != DEFAULT_MEMORY_S:
            raise ConfigError("--memory and --forgetting mean the same: give only one of them")

    @property
    def half_travel(self) -> float:
        """Half the rudder's travel in the unit of u: 1, or its full deflection in rad.

        Where that is unknown it is the largest stroke, and what is judged by it is only relative.
        """
        if self.rudder_max_deg is not None:
            return math.radians(self.rudder_max_deg)
        return 1.0 if self.rudder_stroke_rad is None else self.rudder_stroke_rad

    @property
    def stop(self) -> float:
        """The rudder's full deflection in the unit of u, infinite where it is unknown."""
        return self.half_travel if self.travel_is_known else math.inf

    @property
    def travel_said(self) -> str:
        """The meaning of ``half_travel`` in words."""
        if self.travel_is_known:
            return "half its travel"
        stroke_deg = math.degrees(self.half_travel)
        return f"its largest stroke in the record ({stroke_deg:.3g} deg; its travel is not known)"

    @property
    def travel_is_known(self) -> bool:
        """Whether the rudder's full deflection is known in the unit of u."""
        return self.rudder_max_deg is not None or self.rudder_stroke_rad is None

    @property
    def stroke_floor_deg(self) -> float:
        """The least stroke in deg of a rudder whose travel is unknown, 0 for any other rudder."""
        return 0.0 if self.travel_is_known else LEAST_STROKE_DEG

    @property
    def unit_of_rudder(self) -> str:
        """The unit of u: rad, or half travel."""
        is_angle = self.rudder_max_deg is not None or self.rudder_unit in ("rad", "deg")
        return "rad" if is_angle else HALF_TRAVEL

    def armax_orders(self) -> ArmaxOrders:
        """Return the orders with nb and nk for every input.

        With the yaw angle as output nb is larger by one: its difference quotient is the mean rate
        over the interval before, which depends on one more input than the rate at an instant.
        """
        na, nb, nc, nk = self.orders
        nb += self.output == "yaw"
        count = len(self.inputs)
        return ArmaxOrders(na=na, nb=(nb,) * count, nc=nc, nk=(nk,) * count)

    def forgetting_factor(self, sample_time_s: float) -> float:
        """Return lambda = exp(-Ts / memory), or the factor asked for.

        Raises:
            ConfigError: the memory is so short that lambda is 0.
        """
        if self.forgetting is not None:
            return self.forgetting
        factor = forgetting_factor(self.memory, sample_time_s)
        if factor == 0.0:
            text = (
                f"is far below one sample of {sample_time_s:g} s: give several periods of the mode"
            )
            raise ConfigError(f"--memory {self.memory!r} {text}")
        return factor

    def estimator(self, method: str, sample_time_s: float) -> EstimatorConfig:
        """Return the configuration of one estimator of the bank."""
        return EstimatorConfig(
            orders=self.armax_orders(),
            sample_time_s=sample_time_s,
            forgetting_factor=self.forgetting_factor(sample_time_s),
            method=method,
        )

    def bank_methods(self) -> tuple[str, ...]:
        """Return the methods to run, the one asked for first."""
        also = () if self.also in ("none", self.method) else (self.also,)
        return (self.method, *also)

    def to_toml(self) -> str:
        """Return the configuration as TOML, from which the same configuration can be read."""
        given = {name: value for name, value in asdict(self).items() if value is not None}
        return tomli_w.dumps(given, indent=1)


def option_name(field: str) -> str:
    """Return the name of a setting's option, without its dashes."""
    return field.removesuffix("_s").replace("_", "-")


def settings_declared() -> Iterator[tuple[Field[Any], Said]]:
    """Yield the fields that are options, each with its group, form and words."""
    for each in fields(RunConfig):
        if "said" in each.metadata:
            yield each, each.metadata["said"]


OF_RECORDS = tuple(each.name for each, said in settings_declared() if said.group == COLUMNS)
"""Settings that say what the columns of CSV and Parquet hold; a log takes none of them."""
