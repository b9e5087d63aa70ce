"""The configuration of a run, from the command line or a TOML file: complete and frozen."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import tomli_w
from msgspec import Meta, ValidationError, convert

from yawid.config.estimator import ArmaxOrders, Engine, EstimatorConfig, forgetting_factor
from yawid.config.fields import Finite, NotNegative, Positive, Share, check_fields, fits, one_of
from yawid.config.names import ELS, RECURSIVE, RML
from yawid.errors import ConfigError, did_you_mean
from yawid.quantities.units import HALF_TRAVEL

BOTH = ("rudder", "aileron")
OF_RECORDS = ("columns", "units", "rudder_unit", "rudder_is", "least_stroke_deg")
"""Settings that say what the columns of CSV and Parquet hold; a log takes none of them."""
INPUTS = (("rudder",), BOTH)
_SERVO = r"([1-9]|[12]\d|3[0-2])"
_CHANNELS = rf"auto|servo:{_SERVO}|control:[0-7]|rc:([1-9]|1[0-8])"
_SAID = "auto, servo:N (1-32), control:K (0-7) or rc:N (1-18)"
Aileron = Annotated[str, Meta(pattern=rf"\A({_CHANNELS})\Z", description=f"be {_SAID}")]
_VTAIL = rf"\A({_CHANNELS}|vtail:{_SERVO},{_SERVO})\Z"
Rudder = Annotated[str, Meta(pattern=_VTAIL, description=f"be vtail:L,R, {_SAID}")]
DEFAULT_RATE_HZ = 20.0
DEFAULT_MEMORY_S = 60.0
LEAST_STROKE_DEG = 1.0
ORDINARY = "off"
"""What ``ordinary`` is where it is not given."""
RATE_SLACK = 0.98
"""The part of a rate limit that is enough: message rates jitter, so that 4.95 Hz counts as 5."""
BINDING = ("orders", "inputs", "turn")
"""Settings that are chosen for each manoeuvre unless the user gave them."""
GIVEN = (*BINDING, "rudder_sign")
"""Settings for which "given by the user" is recorded, even when equal to the default."""
COMMAND_LINE = "the command line"
"""Where settings stand that were given as options."""
_SOME = Meta(min_length=1)
_LISTS: dict[str, tuple[Any, str]] = {
    "orders": (
        Annotated[tuple[int, ...], _SOME],
        "na,nb,nc,nk, four whole numbers (yawid orders compares them)",
    ),
    "inputs": (Annotated[tuple[str, ...], _SOME], "rudder or rudder,aileron"),
    "given": (tuple[str, ...], "names of settings"),
    "columns": (tuple[str, ...], "NAME=COLUMN,..."),
    "band": (Annotated[tuple[float, ...], _SOME], "LO,HI in Hz"),
}
"""The settings that are lists, or a text with commas: their kind, and what errors ask for."""
_KINDS = {float: "a number", int: "a whole number", str: "a text"}
KEPT_ONLY = frozenset({"given", "rudder_stroke_rad"})
"""Settings that are in a run's file only: there is no option for them."""
FORGETTING = frozenset({"memory", "forgetting"})
ALIASES = {"from": "from_s", "to": "to_s", "maneuvers": "manoeuvres"}
"""Other names of settings: those of the command line, and the American spelling."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """One run of the pipeline; each field is the command-line option of the same name.

    - ``orders``: na, nb, nc, nk;
    - ``memory`` in s or ``forgetting`` as a factor, not both; without either, a memory of 60 s;
    - ``rate`` in Hz; None is 20 Hz, or the rate of the slower channel if that is lower;
    - ``band`` in Hz; None is no filter;
    - ``from_s`` and ``to_s`` in s since boot; ``boot``: the only boot of the vehicle whose samples
      count, from 1; None is all of them;
    - ``airborne``: "all" takes every sample as flown, None or "auto" holds those on the ground;
    - ``rudder_max_deg``: the full deflection; None makes one unit half the travel;
    - ``servo_tau``: the servo's lag in s; None is unknown;
    - ``lateral``: "auto" keeps and fits the whole lateral motion, None is "off"; ``servo_lag``: the
      lag of its servos in s, None is unknown;
    - ``ordinary``: "auto" answers flight without a manoeuvre, too, "only" makes that the run's
      verdict and searches for no manoeuvres, None is ``ORDINARY``;
    - ``manoeuvres``: whether they are searched for. Orders, inputs and turn apply to every
      manoeuvre if they differ from their defaults or are named in ``given``.

    For a record that never was MAVLink, ``columns`` has the names of its columns (NAME=COLUMN);
    ``units`` is the unit of its angles and ``rudder_unit`` that of its rudder, None where the
    record has them itself. ``rudder_stroke_rad`` is the rudder's largest stroke within 5 s, which
    replaces half of an unknown travel; there ``least_stroke_deg`` is the least stroke in deg for an
    estimate (None: 1). ``rudder_is`` says whether the rudder is measured, on straight lines between
    rows, or commanded, held from row to row (None: measured if in deg or rad).

    Raises:
        ConfigError: a value outside its limits.
    """

    orders: tuple[int, int, int, int] = (3, 3, 2, 1)
    method: Annotated[str, one_of(*RECURSIVE)] = ELS
    also: Annotated[str, one_of(*RECURSIVE, "none")] = RML
    engine: Engine = "numba"
    memory: Positive | None = None
    forgetting: Share | None = None
    rate: Annotated[float, Meta(ge=0.1, le=1e3, description="lie in 0.1 to 1000 Hz")] | None = None
    band: tuple[float, float] | None = None
    inputs: tuple[str, ...] = ("rudder",)
    output: Annotated[str, one_of("yaw-rate", "yaw")] = "yaw-rate"
    turn: Annotated[str, one_of("keep", "remove")] = "keep"
    rudder: Rudder = "auto"
    aileron: Aileron = "auto"
    rudder_sign: Annotated[str, one_of("nose-right", "nose-left")] = "nose-right"
    rudder_max_deg: (
        Annotated[float, Meta(gt=0.0, le=90.0, description="be > 0 and at most 90")] | None
    ) = None
    rudder_unit: Annotated[str, one_of("half-travel", "rad", "deg")] | None = None
    rudder_stroke_rad: Positive | None = None
    rudder_is: Annotated[str, one_of("measured", "commanded")] | None = None
    least_stroke_deg: Positive | None = None
    columns: tuple[str, ...] = ()
    units: Annotated[str, one_of("rad", "deg")] | None = None
    servo_tau: Positive | None = None
    from_s: Finite | None = None
    to_s: Finite | None = None
    sysid: Annotated[int, Meta(ge=1, le=255, description="be 1 to 255")] | None = None
    airborne: Annotated[str, one_of("auto", "all")] | None = None
    boot: Annotated[int, Meta(ge=1, description="be at least 1: boots count from 1")] | None = None
    manoeuvres: Annotated[str, one_of("auto", "off")] = "auto"
    lateral: Annotated[str, one_of("auto", "off")] | None = None
    servo_lag: NotNegative | None = None
    ordinary: Annotated[str, one_of("auto", "only", "off")] | None = None
    given: tuple[str, ...] = ()

    def binds(self, name: str) -> bool:
        """Return whether the user gave this setting, which then applies to every manoeuvre."""
        default = next(field.default for field in fields(self) if field.name == name)
        return name in self.given or getattr(self, name) != default

    @property
    def is_ordinary(self) -> bool:
        """Whether flight without a manoeuvre is answered."""
        return (self.ordinary or ORDINARY) != "off"

    @property
    def keeps_motion(self) -> bool:
        """Whether the lateral motion is read and kept."""
        return self.lateral == "auto" or self.is_ordinary

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
        self._check_lists()
        check_fields(self, lambda name: f"--{name.removesuffix('_s').replace('_', '-')}")
        if self.memory is not None and self.forgetting is not None:
            raise ConfigError("--memory and --forgetting mean the same: give only one of them")
        if self.from_s is not None and self.to_s is not None and not self.from_s < self.to_s:
            raise ConfigError(f"--from {self.from_s!r} must lie before --to {self.to_s!r}")

    def _check_lists(self) -> None:
        if unknown := set(self.given) - set(GIVEN):
            raise ConfigError(f"given must name some of {', '.join(GIVEN)}, got {min(unknown)!r}")
        if self.inputs not in INPUTS:
            given = ",".join(self.inputs)
            raise ConfigError(f"--inputs must be rudder or rudder,aileron, got {given}")
        self._check_orders(self.orders)
        self.armax_orders()
        if self.band is not None and (
            len(self.band) != 2 or not 0.0 < self.band[0] < self.band[1] < math.inf
        ):
            given = ",".join(f"{edge:g}" for edge in self.band)
            raise ConfigError(f"--band must be LO,HI in Hz with 0 < LO < HI, got {given}")

    @staticmethod
    def _check_orders(orders: tuple[int, ...]) -> None:
        if len(orders) != 4:
            given = ",".join(map(str, orders))
            raise ConfigError(f"--orders must be na,nb,nc,nk, got {given}")
        if orders[3] == 0:
            text = "nk = 0 is acausal, since u(k) is the mean after y(k); use nk >= 1"
            raise ConfigError(f"--orders: {text}")

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
        if self.travel_is_known:
            return 0.0
        return LEAST_STROKE_DEG if self.least_stroke_deg is None else self.least_stroke_deg

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
        factor = forgetting_factor(self.memory or DEFAULT_MEMORY_S, sample_time_s)
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
        return "".join(
            f"{name} = {_toml(value)}\n"
            for name, value in asdict(self).items()
            if value is not None
        )


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises:
        ConfigError: the file cannot be read or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(
            f"{path}: not a readable TOML file: {getattr(error, 'strerror', None) or error}"
        ) from error


def overruled(settings: Mapping[str, Any], by: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings overruled ``by`` others; both have been checked."""
    if by.keys() & FORGETTING:  # both say the same thing: the one given overrules both
        settings = {name: value for name, value in settings.items() if name not in FORGETTING}
    given = {*settings.get("given", ()), *by.get("given", ())}
    return {**settings, **by, "given": tuple(sorted(given))}


def check_settings(loaded: dict[str, Any], where: str) -> dict[str, Any]:
    """Return settings by field names, after a check that each is known.

    ``given`` is added if it is missing: the settings of ``GIVEN`` that are there and not ``auto``.

    Raises:
        ConfigError: a setting is unknown or of the wrong type.
    """
    known = {field.name for field in fields(RunConfig)}
    settings = {}
    for raw, value in loaded.items():
        name = ALIASES.get(raw, raw.replace("-", "_"))
        if name not in known:
            options = sorted(
                each.removesuffix("_s").replace("_", "-") for each in known - KEPT_ONLY
            )
            said = did_you_mean(raw, options) or f"; known are {', '.join(options)}"
            raise ConfigError(f"{where}: unknown setting {raw!r}{said}")
        settings[name] = _typed(name, value, where)
    given = (name for name in GIVEN if settings.get(name, "auto") != "auto")
    settings.setdefault("given", tuple(given))
    return settings


def _typed(name: str, value: Any, where: str) -> Any:
    option = name.removesuffix("_s").replace("_", "-")
    named = f"--{option}" if where == COMMAND_LINE else f"{where}: {name}"
    if name in _LISTS:
        kind, wanted = _LISTS[name]
        is_text = isinstance(value, str)
        parts = value.split(",") if is_text else value
        if is_text and name in ("orders", "band"):
            parts = [part.strip() for part in parts]
        try:
            return convert(parts, kind, strict=not is_text)  # 3.5 is no order
        except ValidationError:
            raise ConfigError(f"{named} must be {wanted}, got {value!r}") from None
    hint = get_type_hints(RunConfig)[name]
    plain = next((each for each in (float, int) if each in (hint, *get_args(hint))), str)
    if not fits(value, plain):
        raise ConfigError(f"{named} must be {_KINDS[plain]}, got {value!r}")
    return value


def _toml(value: Any) -> str:
    if isinstance(value, tuple):  # tomli_w gives each entry a line of its own
        return "[" + ", ".join(_toml(entry) for entry in value) + "]"
    return tomli_w.dumps({"_": value}).removeprefix("_ = ").removesuffix("\n")
