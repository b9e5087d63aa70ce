"""Parts of a model in an answer: its modes, its numbers, and how well it fits."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Final

from yawid.answers.part import Count, Number, Part, Positive, named, says
from yawid.quantities.flying_qualities import dutch_roll_level
from yawid.quantities.table import REDUCTION_ERROR, YAW_CHANNEL

DERIVATIVES: Final = named(
    Y_beta="side force by sideslip, per airspeed, 1/s; -a_z_beta",
    L_beta="rolling moment by sideslip, 1/s^2; -a_mx_beta",
    L_p="roll damping, 1/s; -a_mx_omega_x",
    L_r="rolling moment by yaw rate, 1/s; a_mx_omega_y",
    L_delta_a="aileron effectiveness, 1/s^2 per unit of aileron, positive "
    "rolls right; a_mx_delta_b",
    L_delta_r="rolling moment by rudder, 1/s^2 per unit of rudder",
    N_beta="weathercock stability, 1/s^2; a_my_beta",
    N_p="yawing moment by roll rate, 1/s; a_my_omega_x",
    N_r="yaw damping, 1/s; -a_my_omega_y",
    N_delta_a="yawing moment by aileron, 1/s^2 per unit of aileron",
    N_delta_r="rudder effectiveness, 1/s^2 per unit of rudder; a_my_delta_h",
    Y_delta_r="side force by rudder, per airspeed, 1/s per unit of rudder",
)
"""The dimensional derivatives."""
EQ_22_23: Final = named(*YAW_CHANNEL, REDUCTION_ERROR)
"""The numbers of eq. 22-23."""


class Mode(Part, frozen=True, kw_only=True):
    """One mode, a real pole or a pair: frequency in rad/s, times in s, sigmas of noise alone."""

    kind: Annotated[str, says("oscillatory or real", enum=["oscillatory", "real"])]
    wn_rad_s: Number | None = None
    wn_std: Annotated[Number | None, says("sigma of wn_rad_s, of noise alone", "rad/s")] = None
    zeta: Number | None = None
    zeta_std: Annotated[Number | None, says("sigma of zeta, of noise alone", "1")] = None
    period_s: Annotated[Number | None, says("2 pi over the damped frequency", "s")] = None
    time_constant_s: Annotated[Number | None, says("until it has decayed to 1/e", "s")] = None


class Fit(Part, frozen=True):
    """How much of the measurements the model explains, in percent, and its residuals."""

    one_step_pct: Number | None = None
    simulation_pct: Number | None = None
    innovation_std: Annotated[Number | None, says(unit="rad/s, or rad with --output yaw")] = None
    residual_std: Annotated[Number | None, says(unit="rad/s, or rad with --output yaw")] = None
    whiteness_p: Number | None = None
    spr_margin: Number | None = None


MOST_TURN: Final = 0.6
"""The most, in rad, by which the fastest mode of an airframe may turn or decay in one sample: of
JSBSim's aircraft of the seed 701 L_p was 5 % off up to it, and 13 to 37 % at .8 to 1.2."""
LEAST_HZ: Final = 10.0
"""The least rate of attitudes for an airframe: what a lower one costs was not measured."""


class DutchRoll(Part, frozen=True, kw_only=True):
    """The answer: natural frequency in rad/s, damping ratio, their sigmas, MIL-F-8785C's level.

    Of a flight ``*_std`` is the sigma of the next manoeuvre, ``*_std_mean`` that of the mean.
    ``*_std`` is the total sigma; ``*_std_noise`` is the part that noise alone explains. Where that
    is None, as of the running estimates, ``*_std`` is the sigma of noise.
    """

    wn_rad_s: Positive
    wn_std: Number | None = None
    wn_std_noise: Number | None = None
    wn_std_mean: Annotated[
        Number | None,
        says(
            "sigma of the mean over a flight's manoeuvres; wn_std is that of the next one", "rad/s"
        ),
    ] = None
    zeta: Number
    zeta_std: Number | None = None
    zeta_std_noise: Number | None = None
    zeta_std_mean: Annotated[
        Number | None,
        says("sigma of the mean over a flight's manoeuvres; zeta_std is that of the next one", "1"),
    ] = None
    level: Count | None = None

    @property
    def airframe_hz(self) -> float:
        """The rate of attitudes that an airframe with this mode needs."""
        return max(self.wn_rad_s / MOST_TURN, LEAST_HZ)

    @staticmethod
    def of(
        row: Sequence[float],
        noise: Sequence[float] = (math.nan,) * 2,
        of_mean: Sequence[float] = (math.nan,) * 2,
        *,
        has_level: bool = False,
    ) -> "DutchRoll | None":
        """Return it from a row of wn, its sigma, zeta and its sigma, None if wn or zeta is NaN.

        ``noise`` has the two sigmas that noise explains, ``of_mean`` those of a flight's mean.
        """
        numbers = (float(x) if math.isfinite(x) else None for x in (*row, *noise, *of_mean))
        wn, wn_std, zeta, zeta_std, wn_noise, zeta_noise, wn_mean, zeta_mean = numbers
        if wn is None or zeta is None or not wn > 0.0:
            return None
        return DutchRoll(
            wn_rad_s=wn, wn_std=wn_std, wn_std_noise=wn_noise, wn_std_mean=wn_mean,
            zeta=zeta, zeta_std=zeta_std, zeta_std_noise=zeta_noise, zeta_std_mean=zeta_mean,
            level=dutch_roll_level(wn, zeta) if has_level else None,
        )  # fmt: skip


class Value(Part, frozen=True):
    """A coefficient of eq. 22-23, its total sigma, and the part of it that noise explains.

    Without that part ``std`` is of noise alone.
    """

    value: Annotated[Number | None, says("the number", "as the quantity it belongs to")] = None
    std: Annotated[
        Number | None, says("its total sigma, in the same unit", "as the quantity it belongs to")
    ] = None
    std_noise: Annotated[
        Number | None,
        says("the part of std that noise alone explains", "as the quantity it belongs to"),
    ] = None


class TimeConstant(Part, frozen=True):
    """The time constant of a real mode in s, negative where it diverges, and its sigma."""

    time_constant_s: Annotated[
        Number, says("until it has decayed to 1/e; negative where it grows", "s")
    ]
    std: Annotated[Number | None, says("its total sigma", "as the quantity it belongs to")] = None


class Orders(Part, frozen=True):
    """The orders of the ARMAX model; nb and nk are those of every input."""

    na: Count
    nb: Count
    nc: Count
    nk: Count

    def __str__(self) -> str:
        """Return them as ``--orders`` takes them."""
        return f"{self.na},{self.nb},{self.nc},{self.nk}"


LOWEST, HIGHEST, POINTS = 0.6, 1.6, 21
"""Where the model of an answer holds, as parts of wn, and how many points of its response there its
covariance is made of. Below it a model of eq. 23 does not have the zeros of an aircraft: |G| was 6
times too high at .3 wn."""


class Response(Part, frozen=True, kw_only=True):
    """The transfer function of a manoeuvre's answer, from each input to the yaw rate.

    G(s) = sum of r / (s - p), and of the conjugate where p is complex. ``poles`` are [real,
    imaginary] in rad/s, one of each pair, the Dutch roll first, then the real ones; ``residues``
    has as many by the name of the input, in rad/s^2 per unit of it. ``covariance`` is that of wn
    and zeta of each pair, of each real pole, then of the residues of each input: both parts of a
    pair's, and a real one's.
    """

    poles: Annotated[
        list[list[Number]],
        says("[real, imaginary] in rad/s, one of each pair: the Dutch roll's first"),
    ]
    residues: Annotated[
        dict[str, list[list[Number]]],
        says(
            "[real, imaginary] in rad/s^2 per unit of an input, for each pole, by input",
            **named(rudder="from the rudder", aileron="from the aileron, where that is an input"),
        ),
    ]
    covariance: Annotated[
        list[list[Number]],
        says("of wn and zeta of each pair, each real pole, then the residues of each input"),
    ]


class OneStructure(Part, frozen=True, kw_only=True):
    """What one structure of the continuous-time fit found, and its weight in the answer."""

    wn_rad_s: Positive
    wn_std: Annotated[Number, says("sigma of wn_rad_s in this structure", "rad/s")]
    zeta: Number
    zeta_std: Annotated[Number, says("sigma of zeta in this structure", "1")]
    weight: Annotated[Number, says("of its result in the mean")]


class MethodSummary(Part, frozen=True, kw_only=True):
    """The results of one method, of the stream or of a manoeuvre.

    The recursive methods have orders and theta, whose sigmas (of noise) are by parameter names. The
    continuous-time fit (``ct``) has the ``response`` of its answer, its ``structure``, and what
    each of the ``structures`` found; ``roll_left_out`` says why roll was no output of it.
    ``yaw_acceleration`` is what a step of the rudder makes at once, K T wn^2 in rad/s^2 per unit;
    ``overshoot_pct`` and ``settling_s`` say how the yaw rate swings after it, of usable answers.
    """

    method: str
    orders: Annotated[Orders | None, says("orders of the ARMAX model")] = None
    sample_time_s: Positive
    forgetting_factor: Number | None = None
    updates: Count | None = None
    held: Annotated[Count | None, says("samples that did not move theta")] = None
    theta: Annotated[
        dict[str, Number] | None,
        says(
            unit="of the parameter",
            propertyNames={"pattern": r"^(a\d+|b\d+(_aileron)?|c\d+|bias)$"},
        ),
    ] = None
    theta_std: Annotated[
        dict[str, Number] | None,
        says(
            unit="of the parameter",
            propertyNames={"pattern": r"^(a\d+|b\d+(_aileron)?|c\d+|bias)$"},
        ),
    ] = None
    modes: Annotated[list[Mode] | None, says("every mode of the model, a pair of poles once")] = (
        None
    )
    dutch_roll: Annotated[
        DutchRoll | None,
        says("the answer, or what a method found; absent where no mode of the model is one"),
    ] = None
    physics: Annotated[
        dict[str, Value] | None,
        says("yaw rate over rudder by eq. 22-23; absent where those do not hold", **EQ_22_23),
    ] = None
    yaw_acceleration: Annotated[
        Value | None,
        says("of a step of the rudder, at once: K T_theta wn^2", "rad/s^2 per unit of rudder"),
    ] = None
    overshoot_pct: Value | None = None
    settling_s: Value | None = None
    response: Annotated[
        Response | None,
        says("transfer functions from the inputs to the yaw rate, with their covariance"),
    ] = None
    structure: Annotated[str | None, says("the structure that its response has")] = None
    structures: Annotated[
        dict[str, OneStructure] | None,
        says("what each structure found, by its name", propertyNames={"pattern": r"^\w+$"}),
    ] = None
    roll_left_out: Annotated[
        str | None, says("why roll was no output of the fit; absent where it was")
    ] = None
    fit: Annotated[
        Fit,
        says(
            "how much of the measurement the model explains: 100 (1 - |y - y_hat| / |y - mean y|)"
        ),
    ]


Row = dict[str, Any]
"""An answer's numbers and texts by the names of columns."""


def flat(part: Part | None, begin: str = "") -> Row:
    """Return the fields of an object, none of None, with ``begin`` before each name."""
    row: Row = {}
    for name in () if part is None else part.__struct_fields__:
        value = getattr(part, name)
        known = with_sigmas(name, value) if isinstance(value, Value) else {name: value}
        row |= {begin + each: number for each, number in known.items()}
    return row


def with_sigmas(name: str, value: Value, scale: float = 1.0) -> Row:
    """Return a value with its sigmas; those of ``kappa_rad_m`` are called ``kappa_std``."""
    row, stem = {name: value.value}, name.removesuffix("_rad_m")
    row |= {f"{stem}_std": value.std, f"{stem}_std_noise": value.std_noise}
    return {name: None if x is None else scale * x for name, x in row.items()}


def flat_answer(part: Part | None) -> Row:
    """Return an answer's fields, those of its orders, mode and fit, and its derivatives."""
    row = flat(part)
    for name in ("orders", "dutch_roll", "fit"):
        row |= flat(row.get(name))
    for name, value in (row.get("physics") or {}).items():
        row |= with_sigmas(name, value)
    return row
