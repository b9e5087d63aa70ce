"""The configuration of a run, from the command line or a TOML file: complete and frozen."""

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

import tomli_w

from yawid.config.estimator import (
    ELS,
    ENGINES,
    RECURSIVE,
    RML,
    ArmaxOrders,
    EstimatorConfig,
    forgetting_factor,
)
from yawid.errors import ConfigError

OUTPUTS = ("yaw-rate", "heading-rate", "yaw")
BOTH = ("rudder", "aileron")
INPUTS = (("rudder",), BOTH)
_SERVO = r"([1-9]|[12]\d|3[0-2])"
SELECTORS = {
    "rudder": re.compile(
        rf"auto|servo:{_SERVO}|vtail:{_SERVO},{_SERVO}|control:[0-7]|rc:([1-9]|1[0-8])"
    ),
    "aileron": re.compile(rf"auto|servo:{_SERVO}|control:[0-7]|rc:([1-9]|1[0-8])"),
}
DEFAULT_RATE_HZ = 20.0
DEFAULT_MEMORY_S = 60.0
_INTEGERS = ("sysid", "boot")
BINDING = ("orders", "inputs", "turn")
"""What is chosen for each manoeuvre unless the user gave it."""
GIVEN = (*BINDING, "rudder_sign")
"""What it matters of whether the user gave it, even where it is what it would be anyway."""
RUDDER_UNITS = ("half-travel", "rad", "deg")
_LIMITS: dict[str, tuple[Callable[[float], bool], str]] = {
    "memory": (lambda s: 0.0 < s < math.inf, "be > 0 and finite"),
    "forgetting": (lambda factor: 0.0 < factor <= 1.0, "lie in (0, 1]"),
    "rate": (lambda hz: 0.1 <= hz <= 1000.0, "lie in 0.1 to 1000 Hz"),
    "rudder_max_deg": (lambda deg: 0.0 < deg <= 90.0, "be > 0 and at most 90"),
    "rudder_stroke_rad": (lambda rad: 0.0 < rad < math.inf, "be > 0 and finite"),
    "servo_tau": (lambda s: 0.0 < s < math.inf, "be > 0 and finite"),
    "from_s": (math.isfinite, "be finite"),
    "to_s": (math.isfinite, "be finite"),
    "sysid": (lambda number: 1 <= number <= 255, "be 1 to 255"),
    "boot": (lambda number: number >= 1, "be at least 1: boots count from 1"),
}
"""What a value given must satisfy, and how to say so."""
_LISTS: dict[str, tuple[type, str]] = {
    "orders": (int, "na,nb,nc,nk, four whole numbers (auto: only replay, inspect and fleet)"),
    "inputs": (str, "rudder or rudder,aileron"),
    "given": (str, "names of settings"),
    "columns": (str, "NAME=COLUMN,..."),
    "band": (float, "LO,HI in Hz"),
}
_CHOICES: dict[str, tuple[str | None, ...]] = {
    "method": RECURSIVE,
    "also": (*RECURSIVE, "none"),
    "engine": ENGINES,
    "output": OUTPUTS,
    "turn": ("keep", "remove"),
    "manoeuvres": ("auto", "off"),
    "rudder_sign": ("nose-right", "nose-left"),
    "rudder_unit": (*RUDDER_UNITS, None),
    "units": ("rad", "deg", None),
}
_KINDS = {float: "a number", int: "a whole number", str: "a text"}
KEPT_ONLY = frozenset({"given", "rudder_stroke_rad"})
"""Settings that a run's file holds and no option is."""
FORGETTING = frozenset({"memory", "forgetting"})
_FLOATS = (
    *("memory", "forgetting", "rate", "rudder_max_deg", "rudder_stroke_rad"),
    *("servo_tau", "from_s", "to_s"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """One run of the pipeline; each field is the command-line option of the same name.

    ``orders`` are na, nb, nc, nk, or ``auto`` until they have been chosen by the log.
    ``memory`` in seconds or ``forgetting`` as a factor (not both; neither means a memory of 60 s),
    ``rate`` in Hz (None: 20, or the rate of the slower channel), ``band`` in Hz (None: no filter),
    ``from_s`` and ``to_s`` in seconds since boot, ``rudder_max_deg`` the deflection at full travel
    (None: one unit is half the travel), ``servo_tau`` the servo's lag in seconds (None: unknown),
    ``boot`` the only boot of the vehicle whose samples count, from 1 (None: all of them).
    ``manoeuvres`` says whether they are looked for. Orders, inputs and turn bind every manoeuvre
    where they differ from their defaults, or are named in ``given``.

    Of a record that never was MAVLink ``columns`` are the names of its columns (NAME=COLUMN),
    ``units`` those of its angles and ``rudder_unit`` the rudder's where it does not say them itself
    (None). ``rudder_stroke_rad`` is its largest stroke within 5 s, which stands in for half of a
    travel that is not known.

    Raises:
        ConfigError: a value outside its limits.
    """

    orders: tuple[int, int, int, int] | Literal["auto"] = (3, 3, 2, 1)
    method: str = ELS
    also: str = RML
    engine: str = "numba"
    memory: float | None = None
    forgetting: float | None = None
    rate: float | None = None
    band: tuple[float, float] | None = None
    inputs: tuple[str, ...] = ("rudder",)
    output: str = "yaw-rate"
    turn: str = "keep"
    rudder: str = "auto"
    aileron: str = "auto"
    rudder_sign: str = "nose-right"
    rudder_max_deg: float | None = None
    rudder_unit: str | None = None
    rudder_stroke_rad: float | None = None
    columns: tuple[str, ...] = ()
    units: str | None = None
    servo_tau: float | None = None
    from_s: float | None = None
    to_s: float | None = None
    sysid: int | None = None
    boot: int | None = None
    manoeuvres: str = "auto"
    given: tuple[str, ...] = ()

    def binds(self, name: str) -> bool:
        """Whether the user gave this setting, which then holds for every manoeuvre."""
        default = next(field.default for field in fields(self) if field.name == name)
        return name in self.given or getattr(self, name) != default

    @property
    def window_us(self) -> tuple[float, float]:
        """``from_s`` and ``to_s`` in microseconds since boot, infinite where they are not given."""
        low = -math.inf if self.from_s is None else 1e6 * self.from_s
        high = math.inf if self.to_s is None else 1e6 * self.to_s
        return low, high

    def __post_init__(self) -> None:
        if self.orders != "auto":
            object.__setattr__(self, "orders", tuple(self.orders))
        object.__setattr__(self, "inputs", tuple(self.inputs))
        object.__setattr__(self, "given", tuple(self.given))
        object.__setattr__(self, "columns", tuple(self.columns))
        self._check_model()
        self._check_channels()
        self._check_numbers()

    def _check_model(self) -> None:
        if self.orders != "auto" and len(self.orders) != 4:
            raise ConfigError(
                f"--orders must be na,nb,nc,nk, got {','.join(map(str, self.orders))}"
            )
        if self.orders[3] == 0:
            text = "nk = 0 is acausal, since u(k) is the mean after y(k); use nk >= 1"
            raise ConfigError(f"--orders: {text}")
        for name, choices in _CHOICES.items():
            if (value := getattr(self, name)) not in choices:
                option, names = name.replace("_", "-"), ", ".join(filter(None, choices))
                raise ConfigError(f"--{option} must be one of {names}, got {value!r}")
        if unknown := set(self.given) - set(GIVEN):
            raise ConfigError(f"given must name some of {', '.join(GIVEN)}, got {min(unknown)!r}")
        if self.memory is not None and self.forgetting is not None:
            raise ConfigError("--memory and --forgetting say the same thing: give one of them")

    def _check_channels(self) -> None:
        if self.inputs not in INPUTS:
            given = ",".join(self.inputs)
            raise ConfigError(f"--inputs must be rudder or rudder,aileron, got {given}")
        if self.orders != "auto":
            self.armax_orders()
        for name, allowed in SELECTORS.items():
            selector = getattr(self, name)
            if allowed.fullmatch(selector) is None:
                choices = "auto, servo:N (1-32), control:K (0-7) or rc:N (1-18)"
                choices = "vtail:L,R, " + choices if name == "rudder" else choices
                raise ConfigError(f"--{name} must be {choices}, got {selector!r}")

    def _check_numbers(self) -> None:
        for name, (is_sound, what) in _LIMITS.items():
            value = getattr(self, name)
            if value is not None and not is_sound(value):
                option = name.removesuffix("_s").replace("_", "-")
                raise ConfigError(f"--{option} must {what}, got {value!r}")
        if self.band is not None:
            object.__setattr__(self, "band", tuple(self.band))
            if len(self.band) != 2 or not 0.0 < self.band[0] < self.band[1] < math.inf:
                given = ",".join(f"{edge:g}" for edge in self.band)
                raise ConfigError(f"--band must be LO,HI in Hz with 0 < LO < HI, got {given}")
        if self.from_s is not None and self.to_s is not None and not self.from_s < self.to_s:
            raise ConfigError(f"--from {self.from_s!r} must lie before --to {self.to_s!r}")

    @property
    def half_travel(self) -> float:
        """What half the rudder's travel measures in the unit of u: 1, or its deflection in rad.

        Where nobody knows it the largest stroke stands in: what is judged by it is then relative.
        """
        if self.rudder_max_deg is not None:
            return math.radians(self.rudder_max_deg)
        return 1.0 if self.rudder_stroke_rad is None else self.rudder_stroke_rad

    @property
    def stop(self) -> float:
        """The rudder's full deflection in the unit of u, infinite where nobody knows it."""
        return self.half_travel if self.travel_is_known else math.inf

    @property
    def travel_said(self) -> str:
        """What ``half_travel`` is, in words."""
        if self.travel_is_known:
            return "half its travel"
        stroke_deg = math.degrees(self.half_travel)
        return f"its largest stroke in the record ({stroke_deg:.3g} deg; its travel is not known)"

    @property
    def travel_is_known(self) -> bool:
        """Whether it is known how far the rudder moves, in the unit of u."""
        return self.rudder_max_deg is not None or self.rudder_stroke_rad is None

    @property
    def in_rad(self) -> bool:
        """Whether u is the rudder in rad, not in half travels."""
        return self.rudder_max_deg is not None or self.rudder_unit in ("rad", "deg")

    @property
    def four_orders(self) -> tuple[int, int, int, int]:
        """na, nb, nc, nk.

        Raises:
            ConfigError: they are to be chosen by a log.
        """
        if self.orders == "auto":
            raise ConfigError(
                "--orders auto: only replay, inspect and fleet choose them by the log"
            )
        return self.orders

    def armax_orders(self) -> ArmaxOrders:
        """Return the orders with nb and nk for every input.

        With the yaw angle as output nb is one more: its difference quotient is the mean of the rate
        over the interval before, which answers to one input more than the rate at an instant.
        """
        na, nb, nc, nk = self.four_orders
        nb += self.output == "yaw"
        count = len(self.inputs)
        return ArmaxOrders(na=na, nb=(nb,) * count, nc=nc, nk=(nk,) * count)

    def forgetting_factor(self, sample_time_s: float) -> float:
        """Return lambda = exp(-Ts / memory), or what was asked for.

        Raises:
            ConfigError: the memory is so short that nothing of it is left.
        """
        if self.forgetting is not None:
            return self.forgetting
        factor = forgetting_factor(self.memory or DEFAULT_MEMORY_S, sample_time_s)
        if factor == 0.0:
            text = f"is far below one sample of {sample_time_s:g} s: give some periods of the mode"
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
        """Return the configuration as TOML; ``from_toml`` of it is equal."""
        return "".join(
            f"{name} = {_toml(value)}\n"
            for name, value in asdict(self).items()
            if value is not None
        )


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file holds.

    Raises:
        ConfigError: the file cannot be read or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path}: not a readable TOML file: {error}") from error


def overruled(settings: Mapping[str, Any], by: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with others in their place; both have been checked."""
    if by.keys() & FORGETTING:  # two names of one thing: the one given overrules both
        settings = {name: value for name, value in settings.items() if name not in FORGETTING}
    given = {*settings.get("given", ()), *by.get("given", ())}
    return {**settings, **by, "given": tuple(sorted(given))}


def check_settings(loaded: dict[str, Any], where: str) -> dict[str, Any]:
    """Return settings under their field names, after checking that each is known.

    ``given`` is added: those of orders, inputs and turn that are there, unless it is there itself.

    Raises:
        ConfigError: a setting is unknown or of the wrong type.
    """
    known = {field.name for field in fields(RunConfig)}
    settings = {}
    for raw, value in loaded.items():
        name = {"from": "from_s", "to": "to_s"}.get(raw, raw.replace("-", "_"))
        if name not in known:
            options = sorted(
                each.removesuffix("_s").replace("_", "-") for each in known - KEPT_ONLY
            )
            raise ConfigError(f"{where}: unknown setting {raw!r}; known are {', '.join(options)}")
        settings[name] = _typed(name, value, where)
    given = (name for name in GIVEN if settings.get(name, "auto") != "auto")
    settings.setdefault("given", tuple(given))
    return settings


def _typed(name: str, value: Any, where: str) -> Any:
    if (name, value) == ("orders", "auto"):
        return value
    if name in _LISTS:
        kind, wanted_list = _LISTS[name]
        try:
            parts = value.split(",") if isinstance(value, str) else tuple(value)
            typed = tuple(kind(part) for part in parts)
        except (TypeError, ValueError):
            parts = typed = ()
        # 3.5 is no order, and 3 none to put in its place.
        may_be_empty = name in ("given", "columns")
        if not (typed or may_be_empty) or not (isinstance(value, str) or typed == parts):
            raise ConfigError(f"{where}: {name} must be {wanted_list}, got {value!r}")
        return typed
    numeric = name in _FLOATS
    wanted: tuple[type, ...] = (int, float) if numeric else (int,) if name in _INTEGERS else (str,)
    if not isinstance(value, wanted) or isinstance(value, bool):
        raise ConfigError(f"{where}: {name} must be {_KINDS[wanted[-1]]}, got {value!r}")
    return value


def _toml(value: Any) -> str:
    if isinstance(value, tuple):  # tomli_w gives each entry a line of its own
        return "[" + ", ".join(_toml(entry) for entry in value) + "]"
    return tomli_w.dumps({"_": value}).removeprefix("_ = ").removesuffix("\n")
